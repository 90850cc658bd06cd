// Photographs that others took, calibrated here and by OpenCV: the table of docs/validation.md,
// "Photographs of strangers". OpenCV gets our points with our model and flags, and its own
// finders'. Then three photographs of each set are compared with their renderings from the set's
// calibration.
//
// Usage: strangers_photos FOLDER OUT, with the sets that are named below in FOLDER; those not there
// are skipped. OUT gets, by set, the calibration, the comparison's folder and JSON, and SET.jpg,
// the first one's rendering laid over the photograph.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "calib/files/camera_file.h"
#include "calib/intrinsics/calibrate.h"
#include "calib/intrinsics/calibration_outliers.h"
#include "compare/detect/board/calibration_target.h"
#include "core/file/text.h"

namespace {

using namespace etalon;

struct PhotoSet {
    const char *folder, *target;
    int chessboard_columns, chessboard_rows;  // for OpenCV's finders; 0: it has none
};
constexpr PhotoSet sets[] = {
    {"bumblebee-right", "chessboard:4x6@30mm", 4, 6},
    {"trinocular-right", "chessboard:13x9@30mm", 13, 9},
    {"gopro-wide", "chessboard:8x6@25mm", 8, 6},
    {"visp-circles", "circles:6x6@34mm/22.6667mm", -6, -6},
    {"sony-circles", "circles:10x8@25mm/15mm", -10, -8},
    {"sony-hexagonal", "hexcircles:28x24@12mm/10mm", 0, 0},
    {"sony-squares", "squares:4x3@30mm/30mm", 0, 0},
};

using Points = std::vector<std::vector<cv::Point3f>>;
using Pixels = std::vector<std::vector<cv::Point2f>>;

struct ByOpenCv {
    double rms = 0.0;
    cv::Mat k, d;
};

int flags_of(const std::string& model) {
    const int without_tangential = cv::CALIB_ZERO_TANGENT_DIST | cv::CALIB_FIX_K3;
    if (model == "pinhole")
        return without_tangential | cv::CALIB_FIX_K1 | cv::CALIB_FIX_K2;
    if (model == "radial")
        return without_tangential;
    if (model == "standard")
        return 0;
    if (model == "rational")
        return cv::CALIB_RATIONAL_MODEL;
    const int prism = cv::CALIB_RATIONAL_MODEL | cv::CALIB_THIN_PRISM_MODEL;
    return model == "prism" ? prism : prism | cv::CALIB_TILTED_MODEL;
}

ByOpenCv calibrated_by_opencv(const Points& points, const Pixels& pixels, cv::Size size,
                              const std::string& model) {
    ByOpenCv result;
    std::vector<cv::Mat> rotations, translations;
    const cv::TermCriteria until(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 300, 1e-12);
    result.rms = cv::calibrateCamera(points, pixels, size, result.k, result.d, rotations,
                                     translations, flags_of(model), until);
    return result;
}

// RMS over the points of photos left out in turn; the pose alone is fitted to each.
double left_out_by_opencv(const Points& points, const Pixels& pixels, cv::Size size,
                          const std::string& model) {
    double squares = 0.0, count = 0.0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        Points others = points;
        Pixels seen = pixels;
        others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
        seen.erase(seen.begin() + static_cast<std::ptrdiff_t>(i));
        const ByOpenCv camera = calibrated_by_opencv(others, seen, size, model);
        cv::Mat r, t;
        cv::solvePnP(points[i], pixels[i], camera.k, camera.d, r, t);
        cv::solvePnPRefineLM(points[i], pixels[i], camera.k, camera.d, r, t);
        std::vector<cv::Point2f> projected;
        cv::projectPoints(points[i], r, t, camera.k, camera.d, projected);
        for (std::size_t k = 0; k < projected.size(); ++k)
            squares += (projected[k] - pixels[i][k]).ddot(projected[k] - pixels[i][k]);
        count += static_cast<double>(projected.size());
    }
    return std::sqrt(squares / count);
}

CameraModel camera_of(const ByOpenCv& found, const CameraModel& like) {
    CameraModel camera = like;
    camera.covariance.reset();
    CameraParameters values = CameraParameters::Zero();
    values.head<4>() << found.k.at<double>(0, 0), found.k.at<double>(1, 1),
        found.k.at<double>(0, 2), found.k.at<double>(1, 2);
    for (int i = 0; i < std::min<int>(14, static_cast<int>(found.d.total())); ++i)
        values[4 + i] = found.d.at<double>(i);
    set_all_parameters(camera, values);
    return camera;
}

// Among the points, after the best rotation, RMS.
std::string difference_px(const CameraModel& ours, const ByOpenCv& theirs,
                          std::span<const CalibrationView> views) {
    auto rms = attempted([&] {
        const ImageRays rays = rays_among(image_rays(ours), all_pixels(views));
        const auto difference = projection_difference(
            camera_of(theirs, ours), rays, Eigen::VectorXd::Ones(std::ssize(rays.pixels)));
        double squares = 0.0;
        for (const Eigen::Vector2d& each : difference.differences_px)
            squares += each.squaredNorm();
        return std::sqrt(squares / static_cast<double>(difference.differences_px.size()));
    });
    return rms ? fmt::format("{:.3f}", *rms) : "none: " + rms.cause;
}

// By OpenCV's own finder; negative sizes are circles.
std::vector<cv::Point2f> found_by_opencv(const cv::Mat& image, const PhotoSet& set) {
    std::vector<cv::Point2f> pixels;
    const bool circles = set.chessboard_columns < 0;
    const cv::Size size(std::abs(set.chessboard_columns), std::abs(set.chessboard_rows));
    const bool found =
        circles ? cv::findCirclesGrid(image, size, pixels)
                : cv::findChessboardCornersSB(
                      image, size, pixels, cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_EXHAUSTIVE);
    return found ? pixels : std::vector<cv::Point2f>();
}

struct Observed {
    cv::Size size;
    std::vector<CalibrationView> views;
    Points of_opencv;
    Pixels by_opencv;
    std::vector<std::filesystem::path> seen_in;  // by view
    std::size_t photos = 0;
};

Observed observe_all(const std::filesystem::path& folder, const PhotoSet& set,
                     const CalibrationTarget& target) {
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(folder))
        files.push_back(entry.path());
    std::ranges::sort(files);
    std::vector<cv::Point3f> grid;
    const double step = target.board.size_mm;
    for (int row = 0; row < std::abs(set.chessboard_rows); ++row)
        for (int column = 0; column < std::abs(set.chessboard_columns); ++column)
            grid.emplace_back(step * column, step * row, 0.0f);
    Observed all;
    for (const auto& file : files) {
        const CodeImage image = read_image(file);
        all.size = image.pixels.size();
        ++all.photos;
        if (ObservedTarget seen = observe(target, image); seen.view) {
            all.views.push_back(std::move(*seen.view));
            all.seen_in.push_back(file);
        }
        if (set.chessboard_columns == 0)
            continue;
        if (auto pixels = found_by_opencv(image.pixels, set); !pixels.empty()) {
            all.of_opencv.push_back(grid);
            all.by_opencv.push_back(std::move(pixels));
        }
    }
    return all;
}

// The rendering of the first photograph laid over it, for looking at.
void write_small_overlay(const std::filesystem::path& folder, const std::filesystem::path& out) {
    constexpr double most_columns = 400.0;
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
        const std::string name = entry.path().filename().string();
        if (!name.starts_with("01-") || !name.ends_with("-overlay.png"))
            continue;
        const cv::Mat overlay = cv::imread(entry.path().string());
        const double scale = std::min(1.0, most_columns / overlay.cols);
        cv::Mat small;
        cv::resize(overlay, small, {}, scale, scale, cv::INTER_AREA);
        cv::imwrite(out.string(), small, {cv::IMWRITE_JPEG_QUALITY, 80});
    }
}

struct Program {
    std::filesystem::path etalon, out;
};

// "2 of 3 | sharpened 1 | 4.84 | 0.076": matched, findings, residual and edge shift, by the program
// `etalon compare` on the first photograph, one in the middle and the last.
std::string compared(const Program& program, const PhotoSet& set, const CameraModel& camera,
                     const std::vector<std::filesystem::path>& photos) {
    const std::filesystem::path base = program.out / set.folder;
    write_camera(base.string() + ".yml", camera);
    const std::string command = fmt::format(
        "'{}' compare --camera '{}.yml' --marker '{}' '{}' '{}' '{}' --out '{}' --json > '{}.json'",
        program.etalon.string(), base.string(), set.target, photos.front().string(),
        photos[photos.size() / 2].string(), photos.back().string(), base.string(), base.string());
    if (std::system(command.c_str()) != 0)
        return "failed | | |";
    write_small_overlay(base, base.string() + ".jpg");
    const auto json = nlohmann::json::parse(read_text(base.string() + ".json"));
    std::map<std::string, int> findings;
    for (const auto& photo : json["photos"])
        for (const auto& finding : photo["findings"])
            ++findings[finding["name"]];
    std::string names;
    for (const auto& [name, count] : findings)
        names += fmt::format("{}{} {}", names.empty() ? "" : ", ", name, count);
    const nlohmann::json::json_pointer shift("/edges/calibrated/shift_rms_px");
    return fmt::format(
        "{} of {} | {} | {:.2f} | {}", json["photos_matched"].get<int>(), json["photos"].size(),
        names.empty() ? "none" : names, json["mean_residual_gray"].get<double>(),
        json.contains(shift) ? fmt::format("{:.3f}", json[shift].get<double>()) : "no edges");
}

void print_row(const std::filesystem::path& folder, const PhotoSet& set, const Program& program) {
    const CalibrationTarget target = parse_calibration_target(set.target, "target");
    Observed all = observe_all(folder, set, target);
    all.views = with_circle_centres(target, all.views, all.size);
    const CameraCalibration ours = calibrate_camera(all.views, all.size, {.resamples = 0});
    Points points;
    Pixels pixels;
    std::vector<CalibrationView> used;
    for (std::size_t v = 0; v < all.views.size(); ++v) {
        if (!ours.views[v].used())
            continue;
        used.push_back(without_points(all.views[v], ours.views[v].left_out));
        points.emplace_back();
        pixels.emplace_back();
        for (std::size_t i = 0; i < used.back().pixels.size(); ++i) {
            const Eigen::Vector3d& mm = used.back().points_mm[i];
            points.back().emplace_back(mm.x(), mm.y(), 0.0f);
            pixels.back().emplace_back(used.back().pixels[i].x(), used.back().pixels[i].y());
        }
    }
    const std::string& model = ours.model.name;
    const ByOpenCv same = calibrated_by_opencv(points, pixels, all.size, model);
    const std::string own =
        set.chessboard_columns == 0
            ? "no finder"
            : fmt::format("{} found, {:.3f}", all.by_opencv.size(),
                          calibrated_by_opencv(all.of_opencv, all.by_opencv, all.size, model).rms);
    fmt::print("| {} | {} of {} | {} | {:.3f}, {:.3f} | {:.3f}, {:.3f} | {} | {} | {} |\n",
               set.folder, all.views.size(), all.photos, model, ours.rms_px,
               ours.leave_one_out_rms_px.value_or(0.0), same.rms,
               left_out_by_opencv(points, pixels, all.size, model),
               difference_px(ours.camera, same, used), own,
               compared(program, set, ours.camera, all.seen_in));
    std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 3) {
        fmt::print(stderr, "usage: strangers_photos FOLDER OUT\n");
        return 3;
    }
    // This program is build/release/tests/evidence/strangers_photos.
    const Program program{std::filesystem::absolute(argv[0]).parent_path() / "../../etalon",
                          argv[2]};
    std::filesystem::create_directories(program.out);
    fmt::print(
        "| set | found | model | ours: fit, left out / px | OpenCV on our points / px | "
        "projections apart / px | OpenCV on its own points / px | compared: matched | "
        "findings | residual / gray | edge shift / px |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|\n");
    for (const PhotoSet& set : sets) {
        const std::filesystem::path folder = std::filesystem::path(argv[1]) / set.folder;
        if (std::filesystem::is_directory(folder))
            print_row(folder, set, program);
        else
            fmt::print(stderr, "skipped: no {}\n", folder.string());
    }
    return 0;
}
