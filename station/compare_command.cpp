// `etalon compare`: every photograph against its rendering from the calibration alone.
#include <fmt/format.h>

#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <set>

#include "compare/overlay.h"
#include "core/errors.h"
#include "core/text.h"
#include "sim/pose_file.h"
#include "sim/renderer.h"
#include "station/commands.h"
#include "station/compare_report.h"
#include "station/html.h"

namespace etalon {
namespace {

Marker marker_of(const CompareArguments& arguments) {
    const bool board = !arguments.board.empty();
    if (board == !arguments.marker.empty())
        throw ConfigError({"--board"}, "give either a board with --square-mm or a marker");
    if (!board)
        return parse_marker(arguments.marker, "--marker");
    if (!(arguments.square_mm > 0) || !std::isfinite(arguments.square_mm))
        throw ConfigError({"--square-mm"}, "a board needs the side of its squares, above 0 mm");
    return parse_marker(
        fmt::format("chessboard:{}@{}mm", arguments.board, exact(arguments.square_mm)), "--board");
}

ScoreMargin margin_of(const CompareArguments& arguments, const Marker& marker) {
    if (arguments.score_margin.empty())
        return {};
    if (marker.kind != Marker::Kind::chessboard)
        throw ConfigError({"--score-margin"}, "is for chessboards; a marker is scored as a whole");
    const auto squares = parse_numbers(arguments.score_margin, 2, "--score-margin");
    return {squares[0], squares[1]};
}

void require_usable_folder(const std::filesystem::path& folder) {
    std::error_code ignored;
    if (folder.empty())
        throw ConfigError({"--out"}, "no folder given");
    if (std::filesystem::exists(folder, ignored) && !std::filesystem::is_directory(folder, ignored))
        throw ConfigError({"--out"}, folder.string() + " is there already and is no folder");
}

// A given pose must show the marker: a wrong sign is an input error, found before anything starts.
std::vector<Rigid> given_poses(const CompareArguments& arguments, const ComparedArea& area) {
    const std::vector<Rigid> poses = read_poses(arguments.poses);
    if (poses.size() != arguments.photos.size())
        throw ConfigError({arguments.poses.string()},
                          fmt::format("holds {} poses for {} photographs", poses.size(),
                                      arguments.photos.size()));
    for (std::size_t i = 0; i < poses.size(); ++i)
        for (const double x : {area.low_mm.x(), area.high_mm.x()})
            for (const double y : {area.low_mm.y(), area.high_mm.y()})
                if (!((poses[i] * Eigen::Vector3d(x, y, 0)).z() > 0))
                    throw ConfigError(
                        {arguments.poses.string()},
                        fmt::format("pose {}: the marker is behind the camera", i + 1));
    return poses;
}

// Everything that is checked before the first file is written.
struct Job {
    Marker marker;
    ComparedArea area;
    CameraModel camera;
    std::vector<Rigid> poses;            // one per photograph, or none
    std::unique_ptr<Detector> detector;  // when there are no poses
};

Job checked_job(const CompareArguments& arguments) {
    if (arguments.photos.empty())
        throw ConfigError({"PHOTOS"}, "no photograph given");
    Job job;
    job.marker = marker_of(arguments);
    job.area = compared_area(job.marker, margin_of(arguments, job.marker), "--score-margin");
    if (arguments.poses.empty())
        job.detector = make_detector(arguments.detector, job.marker, "--detector");
    else
        job.poses = given_poses(arguments, job.area);
    require_usable_folder(arguments.out);
    job.camera = read_camera_for(arguments.camera, arguments.photos);
    return job;
}

// First pass: every photograph is read and its pose found, so that an input error in the last one
// shows before anything is written.
std::vector<ComparedPhoto> find_poses(const CompareArguments& arguments, const Job& job,
                                      const Projector& projector) {
    std::vector<ComparedPhoto> photos;
    for (std::size_t i = 0; i < arguments.photos.size(); ++i) {
        const auto& path = arguments.photos[i];
        const CodeImage image = read_photo(path, job.camera, arguments.camera);
        ComparedPhoto photo;
        photo.photo = path;
        if (!job.detector) {
            photo.camera_from_marker = job.poses[i];
        } else {
            const PhotoPose found = find_marker(path, image, *job.detector, projector, job.marker);
            photo.failure = found.failure;
            photo.estimate = found.estimate;
            if (found.estimate)
                photo.camera_from_marker = found.estimate->camera_from_marker;
        }
        photos.push_back(photo);
    }
    return photos;
}

// The part of the image around the compared pixels, with room for the blur and for the eye.
cv::Rect surroundings(const cv::Mat& use, int room) {
    cv::Rect box = cv::boundingRect(use);
    box -= cv::Point(room, room);
    box += cv::Size(2 * room, 2 * room);
    return box & cv::Rect({0, 0}, use.size());
}

void add_radial(const PixelDifference& difference, RadialResidual& radial) {
    const cv::Mat& use = difference.use;
    const Eigen::Vector2d centre(0.5 * (use.cols - 1), 0.5 * (use.rows - 1));
    const double corner = centre.norm();
    for (int y = 0; y < use.rows; ++y)
        for (int x = 0; x < use.cols; ++x) {
            if (use.at<uchar>(y, x) != pixel_scored)
                continue;
            const double radius = (Eigen::Vector2d(x, y) - centre).norm();
            const int bin =
                std::min(static_cast<int>(radius / corner * radius_bins), radius_bins - 1);
            const double residual = difference.residual.at<float>(y, x);
            radial.squares[static_cast<std::size_t>(bin)] += residual * residual;
            radial.pixels[static_cast<std::size_t>(bin)] += 1.0;
        }
}

// The pictures of one photograph: whole as PNG files, the marker's part for the report.
void write_pictures(const std::filesystem::path& folder, const PixelDifference& difference,
                    std::size_t number, ComparedPhoto& photo) {
    constexpr int jpeg_quality = 85;
    const cv::Mat gray = difference.predicted + difference.residual;
    const cv::Mat overlay =
        red_cyan_overlay(gray, difference.predicted, difference.use, overlay_gain);
    const cv::Mat map = residual_map(difference.residual, difference.use, residual_map_scale_gray);
    const std::string stem = fmt::format("{:02}-{}", number, photo.photo.stem().string());
    photo.overlay_file = stem + "-overlay.png";
    photo.residual_file = stem + "-residual.png";
    write_picture(folder / photo.overlay_file, overlay);
    write_picture(folder / photo.residual_file, map);
    const cv::Rect part = surroundings(difference.use, 24);
    const std::string name = photo.photo.filename().string();
    photo.overlay_image = embedded_jpeg(overlay(part), jpeg_quality, "red/cyan overlay of " + name);
    photo.residual_image = embedded_jpeg(map(part), jpeg_quality, "residual map of " + name);
}

// Renders one photograph's pose and compares. A marker that is outside the image or cannot be
// rendered there is this photograph's failure, not the run's.
void compare_photo(const CompareArguments& arguments, const Job& job, const Renderer& renderer,
                   const Projector& projector, std::size_t number, ComparedPhoto& photo,
                   Comparison& comparison) {
    const CodeImage image = read_photo(photo.photo, job.camera, arguments.camera);
    const cv::Mat use = pixel_uses(projector, photo.camera_from_marker, job.area);
    if (cv::countNonZero(use) == 0) {
        photo.failure = "no part of the marker is inside the image";
        return;
    }
    RenderOptions options;
    options.region = surroundings(use, 20);
    const RenderedImage rendered =
        renderer.render({{{job.marker.grid, photo.camera_from_marker}}, 1.0}, options);
    const PixelDifference difference = pixel_difference(image, rendered.radiance, use, job.camera);
    photo.model = difference.model;
    photo.fitted = difference.fitted;
    photo.scored = difference.scored;
    comparison.render_plan = rendered.plan.describe();
    add_radial(difference, comparison.radial);
    write_pictures(arguments.out, difference, number, photo);
}

void create_folder(const std::filesystem::path& folder) {
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error)
        throw ConfigError({"--out"}, folder.string() + " cannot be made: " + error.message());
}

[[noreturn]] void fail_without_photos(const Comparison& comparison) {
    const ComparedPhoto& first = comparison.photos.front();
    throw NumericalError(fmt::format("none of {} photographs could be compared ({}: {})",
                                     comparison.photos.size(), first.photo.string(),
                                     first.failure));
}

// Second pass over the photographs that have a pose. A run whose last hope fails writes no report.
void compare_all(const CompareArguments& arguments, const Job& job, const Projector& projector,
                 Comparison& comparison) {
    if (comparison.compared() == 0)
        fail_without_photos(comparison);
    const Renderer renderer(job.camera);
    create_folder(arguments.out);
    for (std::size_t i = 0; i < comparison.photos.size(); ++i) {
        ComparedPhoto& photo = comparison.photos[i];
        if (photo.failure.empty()) {
            try {
                compare_photo(arguments, job, renderer, projector, i + 1, photo, comparison);
            } catch (const NumericalError& error) {
                photo.failure = error.what();
            }
        }
        if (photo.failure.empty())
            fmt::print(stderr, "{}: {:.1f} gray\n", photo.photo.string(), photo.scored.rms_gray);
        else
            fmt::print(stderr, "{}: {}\n", photo.photo.string(), photo.failure);
    }
    if (comparison.compared() == 0)
        fail_without_photos(comparison);
}

void print_result(const CompareArguments& arguments, const Comparison& comparison) {
    const std::size_t compared = comparison.compared();
    if (compared < comparison.photos.size())
        fmt::print(stderr, "{} of {} photographs could not be compared\n",
                   comparison.photos.size() - compared, comparison.photos.size());
    if (arguments.json) {
        std::puts(comparison_json(comparison).c_str());
        return;
    }
    fmt::print("mean residual {:.1f} gray over {} photos\n", comparison.mean_rms_gray(), compared);
    fmt::print("report {}\n", (arguments.out / "report.html").string());
}

}  // namespace

int run_compare(const CompareArguments& arguments) {
    const Job job = checked_job(arguments);
    const Projector projector(job.camera);
    Comparison comparison;
    comparison.camera_file = arguments.camera;
    comparison.camera = job.camera;
    comparison.marker = job.marker.spec;
    comparison.detector = job.detector ? job.detector->name() : "";
    comparison.poses = arguments.poses.string();
    comparison.is_chessboard = job.marker.kind == Marker::Kind::chessboard;
    comparison.margin = margin_of(arguments, job.marker);
    comparison.photos = find_poses(arguments, job, projector);
    compare_all(arguments, job, projector, comparison);
    write_comparison_csv(arguments.out / "comparison.csv", comparison);
    write_text(arguments.out / "comparison.json", comparison_json(comparison) + "\n");
    write_text(arguments.out / "report.html", comparison_html(comparison));
    print_result(arguments, comparison);
    return 0;
}

}  // namespace etalon
