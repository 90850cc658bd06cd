// `etalon detect`: the marker's poses, with both planar solutions, from a detector's corners or,
// with `--detector photometric`, from all pixels with standard deviations.
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <set>

#include "compare/make_detector.h"
#include "compare/match/photo_findings.h"
#include "compare/photo_pose.h"
#include "core/program/errors.h"
#include "core/program/print_stderr.h"
#include "report/json_text.h"
#include "report/number_text.h"
#include "station/compare/commands.h"
#include "station/shell/command.h"
#include "station/shell/photo_files.h"

namespace etalon {
namespace {

Json photo_json(const PhotoPose& pose) {
    Json json = {{"photo", pose.photo.string()}};
    if (pose.corners) {
        json["id"] = pose.corners->id;
        for (const Eigen::Vector2d& corner : pose.corners->pixels)
            json["corners_px"].push_back({corner.x(), corner.y()});
        if (!pose.corners->is_whole())
            json["points"] = pose.corners->points;
    }
    if (!pose.shown_as.empty())
        json["shown_as"] = pose.shown_as;
    if (!pose.failure.empty())
        json["failure"] = pose.failure;
    if (!pose.estimate)
        return json;
    json["camera_from_marker"] = pose_numbers(pose.estimate->camera_from_marker);
    json["reprojection_rms_px"] = pose.estimate->reprojection_rms_px;
    if (pose.estimate->alternative) {
        json["alternative"] = pose_numbers(*pose.estimate->alternative);
        json["alternative_rms_px"] = pose.estimate->alternative_rms_px;
    }
    json["covariance_per_px2"] = row_numbers(pose.estimate->covariance_per_px2);
    return json;
}

// A line per photograph, and below it the other planar solution, so that columns line up.
void print_row(const PhotoPose& pose, std::size_t width) {
    const PoseEstimate& estimate = *pose.estimate;
    fmt::print("{:<{}} {}  {:6.3f}  {}\n", pose.photo.filename().string(), width,
               pose_columns(estimate.camera_from_marker), estimate.reprojection_rms_px,
               pose.corners->pixels.size());
    if (estimate.alternative)
        fmt::print("{:<{}} {}  {:6.3f}\n", "  or", width, pose_columns(*estimate.alternative),
                   estimate.alternative_rms_px);
}

// Without a calibration there are corners, and no poses.
void print_corners(const std::vector<PhotoPose>& all) {
    fmt::print("{:>8} {:>8} {:>12} {:>12}  photo\n", "marker", "corner", "x px", "y px");
    for (const PhotoPose& one : all) {
        const std::string photo = one.photo.filename().string();
        if (!one.corners)
            fmt::print("{:>8} {:>8} {:>12} {:>12}  {}: {}\n", "-", "-", "-", "-", photo,
                       one.failure);
        for (std::size_t i = 0; one.corners && i < one.corners->pixels.size(); ++i)
            fmt::print("{:8} {:8} {:12.4f} {:12.4f}  {}\n", one.corners->id,
                       one.corners->is_whole() ? static_cast<int>(i) : one.corners->points[i],
                       one.corners->pixels[i].x(), one.corners->pixels[i].y(), photo);
    }
}

struct Found {
    std::filesystem::path photo;
    std::string failure;  // empty when there is a pose
    PhotometricPose pose;
    double cpu_ms = 0.0;  // of the fit, without that of the detector
};

// Why a pose that was fitted says nothing of where the marker is; empty when it does.
std::string doubt_about(const PhotometricPose& pose, const CodeImage& image, const Marker& marker,
                        const Projector& projector) {
    if (!pose.converged)
        return "not found: the fit of its pixels does not converge";
    const Findings findings = examine_marker(image, marker, compared_area(marker, {}, "--marker"),
                                             projector, pose.camera_from_marker);
    for (const Finding& finding : findings)
        if (finding.is_not_assessable || finding.name == "saturated")
            return "not found: " + finding.sentence;
    return "";
}

// Near `given`, or without one near what a detector finds.
Found find_in(const std::filesystem::path& photo, const CodeImage& image, const Rigid* given,
              Detector* starter, const PhotometricDetector& detector, const Marker& marker) {
    const Projector& projector = detector.camera()->projector();
    Found found{photo};
    Rigid start = given ? *given : Rigid{};
    if (!given) {
        const PhotoPose pose = find_as_drawn(photo, image, *starter, projector, marker);
        found.failure = pose.failure;
        if (!pose.estimate)
            return found;
        start = pose.estimate->camera_from_marker;
    }
    const double before = process_cpu_ms();
    auto pose = attempted([&] {
        // A stage's poses are right to a few pixels.
        return detector.find(
            image, start,
            given ? PhotometricDetector::basin_px : PhotometricDetector::detector_error_px);
    });
    if (pose)
        found.pose = *pose;
    found.failure = pose ? doubt_about(*pose, image, marker, projector) : pose.cause;
    found.cpu_ms = process_cpu_ms() - before;
    return found;
}

void print_row(const Found& found, std::size_t width) {
    const PhotometricPose& pose = found.pose;
    fmt::print("{:<{}} {}\n", found.photo.filename().string(), width,
               pose_columns(pose.camera_from_marker));
    fmt::print("{:<{}} {}\n", "  +-", width,
               deviation_columns(pose.covariance.diagonal().cwiseSqrt()));
    if (pose.other)
        fmt::print("{:<{}} {}  log-likelihood {:.1f} lower\n", "  or", width,
                   pose_columns(pose.other->camera_from_marker), pose.other->log_likelihood_ratio);
    fmt::print(
        "{:<{}} noise scale {:.2f}, chi-square {:.3f} per pixel over {} px, {:.0f} ms of CPU "
        "time{}\n",
        "", width, pose.noise_scale, pose.reduced_squares, pose.pixels, found.cpu_ms,
        pose.converged ? "" : ", NOT CONVERGED");
}

Json photo_json(const Found& found) {
    Json json = {{"photo", found.photo.string()}};
    if (!found.failure.empty()) {
        json["failure"] = found.failure;
        return json;
    }
    const PhotometricPose& pose = found.pose;
    json["camera_from_marker"] = pose_numbers(pose.camera_from_marker);
    json["covariance"] = row_numbers(pose.covariance);
    if (pose.other) {
        json["alternative"] = pose_numbers(pose.other->camera_from_marker);
        json["log_likelihood_ratio"] = pose.other->log_likelihood_ratio;
        json["alternative_loss"] = pose.other->loss;
    }
    json["loss"] = pose.loss;
    json["noise_scale"] = pose.noise_scale;
    json["chi_square_per_pixel"] = pose.reduced_squares;
    json["pixels"] = pose.pixels;
    json["converged"] = pose.converged;
    json["renderings"] = pose.renderings;
    json["cpu_ms"] = found.cpu_ms;
    return json;
}

template <class Result>
void print_table(const std::vector<Result>& all, const char* more_columns) {
    std::size_t width = 5;
    for (const Result& one : all)
        width = std::max(width, one.photo.filename().string().size());
    fmt::print("{:<{}} {}{}\n", "photo", width, pose_heading(), more_columns);
    for (const Result& one : all)
        if (one.failure.empty())
            print_row(one, width);
        else
            fmt::print("{:<{}} {}\n", one.photo.filename().string(), width, one.failure);
}

template <class Result>
void print_json(const DetectArguments& arguments, const char* kind, const std::string& detector,
                const std::vector<Result>& all) {
    const Json json = {
        {"etalon", kind},
        {"camera", arguments.camera.string()},
        {"marker", arguments.marker},
        {"detector", detector},
        {"photos", json_list(all, [](const Result& one) { return photo_json(one); })}};
    std::puts(text_of(json).c_str());
}

// One in which the marker was found is enough.
template <class Result>
int finish(const Marker& marker, const std::vector<Result>& all) {
    std::set<std::filesystem::path> photos, found;
    for (const Result& one : all) {
        photos.insert(one.photo);
        if (one.failure.empty())
            found.insert(one.photo);
    }
    if (found.empty())
        throw NumericalError(fmt::format("{} is not found in any of {} photographs ({}: {})",
                                         marker.spec, photos.size(), all.front().photo.string(),
                                         all.front().failure));
    print_stderr("found in {} of {} photographs\n", found.size(), photos.size());
    return 0;
}

void print_remarks(const std::vector<PhotoPose>& all) {
    for (std::size_t i = 0; i < all.size(); ++i) {
        if (!all[i].shown_as.empty())
            print_stderr("{}: the board that is seen is {}\n", all[i].photo.string(),
                         all[i].shown_as);
        if (i > 0 && all[i].photo == all[i - 1].photo)
            print_stderr("{}: the marker is seen more than once: a line for each\n",
                         all[i].photo.string());
    }
}

int run_photometric_detect(const DetectArguments& arguments) {
    if (arguments.camera.empty())
        throw ConfigError({"--camera"}, "a calibration is needed for poses");
    const Marker marker = parse_marker(arguments.marker, "--marker");
    // What tells where the marker is about: given poses, one a photograph, or a detector.
    std::vector<Rigid> starts;
    std::unique_ptr<Detector> starter;
    if (!arguments.poses.empty())
        starts = read_poses_for(arguments.poses, arguments.photos);
    else if (marker.kind == Marker::Kind::bitmap)
        throw ConfigError({"--poses"}, "no detector finds " + marker.spec +
                                           ": give a pose nearby for each photograph");
    else
        starter = make_detector("auto", marker, "--marker");
    const CameraModel camera = read_camera_for(arguments.camera, arguments.photos);
    const PhotometricDetector detector(camera, marker, "--marker");
    std::vector<Found> all;
    for (std::size_t i = 0; i < arguments.photos.size(); ++i) {
        const auto& photo = arguments.photos[i];
        const CodeImage image = read_photo(photo, camera, arguments.camera);
        all.push_back(
            find_in(photo, image, starter ? nullptr : &starts[i], starter.get(), detector, marker));
    }
    if (arguments.json)
        print_json(arguments, "photometric_poses/1", arguments.detector, all);
    else
        print_table(all, "");
    return finish(marker, all);
}

// With poses where there is a calibration.
std::vector<PhotoPose> found_in_photos(const DetectArguments& arguments, Detector& detector,
                                       const Marker& marker) {
    std::optional<CameraModel> camera;
    std::optional<Projector> projector;
    if (!arguments.camera.empty())
        projector.emplace(camera.emplace(read_camera_for(arguments.camera, arguments.photos)));
    std::vector<PhotoPose> all;
    for (const auto& photo : arguments.photos) {
        const CodeImage image =
            camera ? read_photo(photo, *camera, arguments.camera) : read_image(photo);
        for (PhotoPose& seen : find_markers(photo, image, detector))
            all.push_back(projector ? with_pose(std::move(seen), *projector, marker)
                                    : std::move(seen));
    }
    return all;
}

int run_corner_detect(const DetectArguments& arguments) {
    if (!arguments.poses.empty())
        throw ConfigError({"--poses"}, "only --detector photometric starts from poses");
    const Marker marker = parse_marker(arguments.marker, "--marker");
    const auto detector = make_detector(arguments.detector, marker, "--detector");
    const std::vector<PhotoPose> all = found_in_photos(arguments, *detector, marker);
    if (arguments.json)
        print_json(arguments, "detections/1", detector->name(), all);
    else if (arguments.camera.empty())
        print_corners(all);
    else
        print_table(all, "  RMS px  corners");
    print_remarks(all);
    if (arguments.camera.empty())
        print_stderr("corners only: poses need a calibration: --camera FILE\n");
    return finish(marker, all);
}

}  // namespace

int run_detect(const DetectArguments& given) {
    const PhotoFiles files(given.photos);
    DetectArguments arguments = given;
    arguments.photos = files.paths();
    if (arguments.photos.empty())
        throw ConfigError({"PHOTOS"}, "no photograph given");
    return arguments.detector == "photometric" ? run_photometric_detect(arguments)
                                               : run_corner_detect(arguments);
}

void declare_detect(Command& program) {
    auto [command, asked] =
        program.add(run_detect, "detect", "find a marker in photographs, and its pose",
                    pose_help + "\n" + marker_help);
    command.required("PHOTOS", asked->photos, "photographs to look at");
    command.required("--marker", asked->marker, "what to look for, see below", "M");
    command.option("--camera", asked->camera,
                   "calibration, for poses; without it corners are printed", "FILE");
    command.option(
        "--detector", asked->detector,
        "apriltag, aruco, topotag, chessboard, charuco, stag,\naprilgrid, circles, squares; auto: "
        "the marker's\nown; or photometric: the pose from all pixels,\nfor any marker or board",
        "NAME");
    command.option("--poses", asked->poses,
                   "where the marker is about (photometric only):\na pose for each photo, the "
                   "image right to 5 px",
                   "FILE");
}

}  // namespace etalon
