// `etalon compare`: every photograph against its rendering from the calibration alone.
#include <fmt/format.h>

#include <opencv2/imgproc.hpp>

#include "compare/make_detector.h"
#include "core/file/file_writing.h"
#include "core/file/text.h"
#include "core/program/print_stderr.h"
#include "report/svg_plot.h"
#include "station/compare/commands.h"
#include "station/compare/comparison.h"
#include "station/shell/command.h"
#include "station/shell/photo_files.h"

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

// Everything that is checked before the first file is written.
struct Job {
    Marker marker;
    ComparedArea area;
    CameraModel camera;
    std::vector<Rigid> poses;            // one per photograph, or none
    std::unique_ptr<Detector> detector;  // when there are no poses
    std::optional<ComparisonSummary> baseline;
};

// A given pose must show the marker: a wrong sign is an input error, found before anything starts.
std::vector<Rigid> given_poses(const CompareArguments& arguments, const Job& job) {
    const std::vector<Rigid> poses = read_poses_for(arguments.poses, arguments.photos);
    if (!job.camera.projection.is_flat())  // may see behind itself
        return poses;
    const ComparedArea& area = job.area;
    for (std::size_t i = 0; i < poses.size(); ++i)
        for (const double x : {area.low_mm.x(), area.high_mm.x()})
            for (const double y : {area.low_mm.y(), area.high_mm.y()})
                if (!((poses[i] * Eigen::Vector3d(x, y, 0)).z() > 0))
                    throw ConfigError(
                        {arguments.poses.string()},
                        fmt::format("pose {}: the marker is behind the camera", i + 1));
    return poses;
}

ComparisonSummary checked_baseline(const CompareArguments& arguments, const Job& job) {
    std::error_code ignored;
    if (std::filesystem::equivalent(arguments.baseline, arguments.out, ignored))
        throw ConfigError({"--baseline"}, "is the folder of --out, which is written again");
    ComparisonSummary earlier = read_comparison(arguments.baseline);
    require_same_camera(
        earlier, {job.camera.serial, job.camera.width, job.camera.height, job.marker.spec, {}});
    return earlier;
}

Job checked_job(const CompareArguments& arguments) {
    if (arguments.photos.empty())
        throw ConfigError({"PHOTOS"}, "no photograph given");
    Job job;
    job.marker = marker_of(arguments);
    job.area = compared_area(job.marker, margin_of(arguments, job.marker), "--score-margin");
    if (arguments.poses.empty())
        job.detector = make_detector(arguments.detector, job.marker, "--detector");
    if (arguments.out.empty())
        throw ConfigError({"--out"}, "no folder given");
    std::error_code ignored;
    if (std::filesystem::exists(arguments.out, ignored) &&
        !std::filesystem::is_directory(arguments.out, ignored))
        throw ConfigError({"--out"}, arguments.out.string() + " is there already and is no folder");
    job.camera = read_camera_for(arguments.camera, arguments.photos);
    if (!arguments.poses.empty())
        job.poses = given_poses(arguments, job);
    if (!arguments.baseline.empty())
        job.baseline = checked_baseline(arguments, job);
    return job;
}

struct FoundPoses {
    std::vector<ComparedPhoto> photos;
    std::string shown_as;  // the board's name where they show another that is drawn otherwise
};

// First pass: finds every pose, so that input errors show before anything is written.
FoundPoses find_poses(const CompareArguments& arguments, const Job& job,
                      const Projector& projector) {
    FoundPoses all;
    for (std::size_t i = 0; i < arguments.photos.size(); ++i) {
        const auto& path = arguments.photos[i];
        const CodeImage image = read_photo(path, job.camera, arguments.camera);
        ComparedPhoto photo;
        photo.photo = path;
        photo.is_jpeg = is_jpeg(path);
        if (!job.detector) {
            photo.under_test = job.poses[i];
        } else {
            const PhotoPose found =
                find_as_drawn(path, image, *job.detector, projector, job.marker);
            photo.failure = found.failure;
            if (!found.shown_as.empty())
                all.shown_as = found.shown_as;
            if (!found.corners) {
                photo.findings = examine_missing_marker(image, *job.detector);
                photo.pictures = pictures_of_photo(image, path);
            }
            photo.estimate = found.estimate;
            if (found.estimate)
                photo.under_test = found.estimate->camera_from_marker;
        }
        all.photos.push_back(photo);
    }
    return all;
}

// To the profiles of the pose that it was made at.
void add_scored(const PhotoFit& fit, const Projector& projector, const char* pose,
                std::vector<ResidualProfile>& profiles) {
    const cv::Mat& use = fit.use;
    const cv::Rect box = cv::boundingRect(use);
    const PlaneSight sight(projector, fit.state.camera_from_marker, box);
    const Eigen::Vector2d centre(0.5 * (use.cols - 1), 0.5 * (use.rows - 1));
    const auto first = std::ranges::find(profiles, std::string(pose), &ResidualProfile::pose);
    ResidualProfile &radius = first[0], &depth = first[2];
    for (int y = box.y; y < box.br().y; ++y)
        for (int x = box.x; x < box.br().x; ++x) {
            if (use.at<uchar>(y, x) != pixel_scored)
                continue;
            const double residual = fit.residual.at<float>(y, x);
            radius.add((Eigen::Vector2d(x, y) - centre).norm(), residual);
            if (const auto met = sight.at(x, y))
                depth.add(met->z(), residual);
        }
}

// With its edges and without its images.
ComparedFit compared_fit(const CodeImage& image, const CellGrid& marker,
                         const PhotometricCamera& camera, const PhotoFit& matched) {
    ComparedFit fit{matched};
    fit.predicted = fit.residual = fit.significance = fit.use = cv::Mat();
    const PhotoOfMarker photo{gray_of(image), marker, matched.use, pixel_fitted};
    fit.edges = edge_shifts(photo, camera, matched.state);
    fit.edge_summary = edge_summary(edges_of(fit.edges, pixel_scored));
    return fit;
}

// Sharp edges and blurred ones alike: the widest blur decides how far beside an edge is looked.
DefocusProfile defocus_of(const CodeImage& image, const Marker& marker, const ComparedArea& area,
                          const PhotometricCamera& camera, const ComparedFit& fit) {
    const RenderedImage rendering =
        camera.renderer().render({{{marker.grid, fit.camera_from_marker()}}, 1.0});
    EdgeSelection selection;
    const double beside = selection.half_width_px - selection.clearance_px;
    selection.clearance_px =
        std::max(selection.clearance_px, 1.5 + rendering.plan.max_blur_radius_px);
    selection.half_width_px = selection.clearance_px + beside;
    return defocus_profile(image, rendering.radiance, camera.projector(), marker.grid,
                           fit.camera_from_marker(), area, fit.edges, selection);
}

// Depths of the compared area at the poses under test, mm; (0, 1) where there are none.
std::pair<double, double> depth_range(const std::vector<ComparedPhoto>& photos,
                                      const ComparedArea& area) {
    double low = std::numeric_limits<double>::infinity(), high = 0.0;
    for (const ComparedPhoto& photo : photos)
        for (const double x : {area.low_mm.x(), area.high_mm.x()})
            for (const double y : {area.low_mm.y(), area.high_mm.y()}) {
                if (!photo.failure.empty())
                    continue;
                const double z = (photo.under_test * Eigen::Vector3d(x, y, 0)).z();
                low = std::min(low, z);
                high = std::max(high, z);
            }
    return low <= high ? std::pair(low, high) : std::pair(0.0, 1.0);
}

std::vector<ResidualProfile> empty_profiles(const Comparison& comparison,
                                            const ComparedArea& area) {
    const double corner =
        0.5 * std::hypot(comparison.camera.width - 1, comparison.camera.height - 1);
    const auto [near_mm, far_mm] = depth_range(comparison.photos, area);
    return {{"radius_px", "calibrated", 0.0, corner},
            {"radius_px", "refined", 0.0, corner},
            {"depth_mm", "calibrated", near_mm, far_mm},
            {"depth_mm", "refined", near_mm, far_mm}};
}

// Fills in `photo`, whose pose under test is known, and adds to the profiles where it has figures.
// Picture files go to `folder`, named by `number` (from 1) and the photograph.
void match(const CodeImage& image, const Job& job,
           const std::shared_ptr<const PhotometricCamera>& camera, ReportFolder& folder,
           std::size_t number, ComparedPhoto& photo, std::vector<ResidualProfile>& profiles) {
    const Marker& marker = job.marker;
    const Projector& projector = camera->projector();
    photo.findings = examine_marker(image, marker, job.area, projector, photo.under_test);
    if (is_refused(photo.findings)) {
        photo.pictures = pictures_of_photo(image, photo.photo);
        return;
    }
    const PhotoMatch match = match_photo(image, marker.grid, job.area, camera, photo.under_test);
    photo.calibrated = compared_fit(image, marker.grid, *camera, match.calibrated);
    photo.refined = compared_fit(image, marker.grid, *camera, match.refined);
    photo.photometric = match.pose;
    if (camera->model().lens)
        photo.defocus = defocus_of(image, marker, job.area, *camera, *photo.refined);
    photo.findings = examine_match(image, marker, job.area, *camera, match);
    photo.pictures = make_pictures(folder, number, photo.photo, match.calibrated, match.refined);
    if (!photo.has_figures())
        return;
    add_scored(match.calibrated, projector, "calibrated", profiles);
    add_scored(match.refined, projector, "refined", profiles);
}

[[noreturn]] void fail_without_photos(const Comparison& comparison) {
    const ComparedPhoto& first = comparison.photos.front();
    throw NumericalError(fmt::format("none of {} photographs could be compared ({}: {})",
                                     comparison.photos.size(), first.photo.string(),
                                     first.reason()));
}

void print_progress(const std::string& place, const ComparedPhoto& photo) {
    const std::string file = place + ": " + photo.photo.string();
    if (!photo.has_figures()) {
        print_stderr("{}: {}\n", file, photo.reason());
        return;
    }
    std::string line =
        fmt::format("{:.1f} gray, {:.1f} at the refined pose", photo.calibrated->scored.rms_gray,
                    photo.refined->scored.rms_gray);
    for (const std::string& finding : photo.names_of_findings())
        line += ", " + finding;
    print_stderr("{}: {}\n", file, line);
}

// Second pass over the photographs that have a pose. A run whose last hope fails writes no report.
void compare_all(const CompareArguments& arguments, const Job& job, ReportFolder& folder,
                 Comparison& comparison) {
    const auto camera = std::make_shared<const PhotometricCamera>(job.camera);
    comparison.profiles = empty_profiles(comparison, job.area);
    for (std::size_t i = 0; i < comparison.photos.size(); ++i) {
        ComparedPhoto& photo = comparison.photos[i];
        if (photo.failure.empty()) {
            const CodeImage image = read_photo(photo.photo, job.camera, arguments.camera);
            const auto matched = attempted(
                [&] { match(image, job, camera, folder, i + 1, photo, comparison.profiles); });
            if (!matched)
                photo.failure = matched.cause;
            if (!photo.has_figures()) {  // the pictures may show why; numbers would mislead
                photo.calibrated = photo.refined = std::nullopt;
                photo.photometric = std::nullopt;
                photo.defocus = std::nullopt;
            }
        }
        print_progress(fmt::format("{} of {}", i + 1, comparison.photos.size()), photo);
    }
    if (comparison.compared() == 0)
        fail_without_photos(comparison);
    const auto last = std::find_if(comparison.photos.rbegin(), comparison.photos.rend(),
                                   std::mem_fn(&ComparedPhoto::has_figures));
    const Scene scene{{{job.marker.grid, last->under_test}}, 1.0};
    comparison.render_plan = camera->renderer().render(scene).plan.describe();
    std::vector<EdgesOfPhoto> edges;
    for (const ComparedPhoto& photo : comparison.photos)
        if (photo.refined)
            edges.push_back({photo.refined->edges, photo.refined->camera_from_marker()});
    comparison.board = board_shifts(edges, Projector(job.camera), job.area);
}

void write_files(ReportFolder& folder, const Comparison& comparison) {
    const std::vector<ComparisonPlot> plots = comparison_plots(comparison);
    for (const ComparisonPlot& plot : plots)
        write_text(folder / plot.file, stand_alone_svg(plot.svg) + "\n");
    const double magnification = arrow_magnification(comparison);
    for (const ComparedPhoto& photo : comparison.photos)  // edges and their shifts
        if (photo.refined)
            write_text(folder / photo.pictures.edges_file,
                       stand_alone_svg(edge_map_svg(photo, magnification)) + "\n");
    write_text(folder / "comparison.csv", comparison_csv(comparison));
    write_text(folder / "photometry.csv", photometry_csv(comparison));
    write_text(folder / "edges.csv", edges_csv(comparison));
    write_text(folder / "profiles.csv", profiles_csv(comparison));
    if (comparison.camera.lens)
        write_text(folder / "defocus.csv", defocus_csv(comparison));
    if (comparison.baseline)
        write_text(folder / "baseline.csv", baseline_csv(*comparison.baseline));
    write_text(folder / "comparison.json", comparison_json(comparison) + "\n");
    write_text(folder / "report.html", comparison_html(comparison, plots));
    folder.finish();
}

void print_result(const CompareArguments& arguments, const Comparison& comparison) {
    const std::size_t compared = comparison.compared();
    if (compared < comparison.photos.size())
        print_stderr("{} of {} photographs could not be compared\n",
                     comparison.photos.size() - compared, comparison.photos.size());
    if (arguments.json) {
        std::puts(comparison_json(comparison).c_str());
        return;
    }
    fmt::print("mean residual {:.1f} gray over {} photos\n", comparison.mean_rms_gray(), compared);
    print_report(arguments.out);
    fmt::print("matched {} of {} photos\n", comparison.matched(), comparison.photos.size());
    fmt::print("residual at the refined poses {:.1f} gray\n", comparison.refined_mean_rms_gray());
    if (const auto edges = comparison.edge_summaries())
        fmt::print("edge shift {:.3f} px, {:.3f} px at the refined poses\n",
                   edges->first.shift.rms_px, edges->second.shift.rms_px);
    if (const std::string board = comparison.board_in_words(); !board.empty())
        print_stderr("{}\n", board);
    if (comparison.baseline)
        fmt::print("{}", baseline_text(*comparison.baseline));
}

}  // namespace

int run_compare(const CompareArguments& given) {
    const PhotoFiles files(given.photos);
    CompareArguments arguments = given;
    arguments.photos = files.paths();
    Job job = checked_job(arguments);
    const Projector projector(job.camera);
    FoundPoses found = find_poses(arguments, job, projector);
    if (!found.shown_as.empty()) {
        print_stderr("the board that is seen is {}: compared as that\n", found.shown_as);
        arguments.board.clear();
        arguments.marker = found.shown_as;
        job = checked_job(arguments);
        found = find_poses(arguments, job, projector);
    }
    Comparison comparison;
    comparison.camera_file = arguments.camera;
    comparison.camera = job.camera;
    comparison.marker = job.marker;
    comparison.detector = job.detector ? job.detector->name() : "";
    comparison.poses = arguments.poses.string();
    comparison.margin = margin_of(arguments, job.marker);
    comparison.photos = std::move(found.photos);
    if (std::ranges::none_of(comparison.photos, &std::string::empty, &ComparedPhoto::failure))
        fail_without_photos(comparison);
    ReportFolder folder(arguments.out, "compare");
    compare_all(arguments, job, folder, comparison);
    if (job.baseline)
        comparison.baseline =
            compare_with_baseline(*job.baseline, comparison.summary(), arguments.baseline);
    write_files(folder, comparison);
    print_result(arguments, comparison);
    return 0;
}

void declare_compare(Command& program) {
    auto [command, asked] = program.add(
        run_compare, "compare", "compare photographs with renders from a calibration",
        "Renders every photograph at its pose and reports how they differ: prints\n"
        "`mean residual x gray over n photos`; the report, tables, overlays and plots\n"
        "go to DIR. Each photograph is compared at its pose and at the pose refined on\n"
        "its pixels.\n"
        "Poses are estimated from the photographs unless --poses gives them.\n\n"
        "Example:\n"
        "  etalon compare --camera camera.yml --board 9x6 --square-mm 25 \\\n"
        "      left*.jpg --out differences\n\n" +
            marker_help);
    command.required("PHOTOS", asked->photos, "photographs to compare");
    command.required("--camera", asked->camera, "calibration: ours, OpenCV's or ROS'", "FILE");
    const Option board =
        command.option("--board", asked->board, "inner corners of a chessboard: 9x6", "CxR");
    const Option square =
        command.option("--square-mm", asked->square_mm, "side of its squares", "MM").positive();
    const Option marker =
        command.option("--marker", asked->marker, "a marker in place of a board", "M");
    board.needs(square).excludes(marker);
    square.needs(board);
    command.required("--out", asked->out, "folder to write to", "DIR");
    command.option("--poses", asked->poses,
                   "CSV with the header rx,ry,rz,tx,ty,tz, one row\nper photograph, or JSON",
                   "FILE");
    command.option(
        "--detector", asked->detector,
        "apriltag, aruco, topotag, chessboard, charuco, stag,\nor auto: the marker's own", "NAME");
    command.option("--score-margin", asked->score_margin,
                   "how far around a board's inner corners residuals\n"
                   "count, in squares (default 0.3,0.65)",
                   "X,Y");
    command.option("--baseline", asked->baseline,
                   "folder of an earlier comparison of this camera:\nwhat changed since", "DIR");
}

}  // namespace etalon
