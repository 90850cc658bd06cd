// `etalon detect --detector photometric`: the marker's pose from all of its pixels, with standard
// deviations and the other planar solution.
#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "compare/detect/calibration_target.h"
#include "compare/detect/photo_pose.h"
#include "compare/make_detector.h"
#include "compare/photometric/photometric_detector.h"
#include "core/cpu_time.h"
#include "core/errors.h"
#include "core/pose_numbers.h"
#include "report/json_text.h"
#include "station/compare/commands.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

// Detectors are right to some tenths of a pixel; a stage's poses to a few.
constexpr double detector_error_px = 0.5;
constexpr double stage_error_px = PhotometricDetector::basin_px;

struct Start {
    std::optional<Rigid> camera_from_marker;
    std::string failure;
};

struct Found {
    std::filesystem::path photo;
    std::string failure;  // empty when there is a pose
    PhotometricPose pose;
    double cpu_ms = 0.0;  // of the fit, without that of the detector
};

// Boards that a calibration finds, and no detector.
bool is_board(const Marker& marker) {
    return marker.kind == Marker::Kind::aprilgrid || marker.kind == Marker::Kind::circles ||
           marker.kind == Marker::Kind::acircles;
}

// The target's points that are seen, as a calibration finds them.
Start start_from_board(const CodeImage& image, const CalibrationTarget& target,
                       const Projector& projector) {
    const auto view = observe(target, image);
    if (!view)
        return {{}, "marker not found"};
    const auto pose = estimate_pose(projector, view->points_mm, view->pixels);
    if (!pose)
        return {{}, "its points determine no pose in front of the camera"};
    return {pose->camera_from_marker, {}};
}

// Where the marker is about, by photograph.
class Starts {
public:
    Starts(const DetectArguments& arguments, const Marker& marker) : marker_(marker) {
        if (!arguments.poses.empty())
            poses_ = read_poses_for(arguments.poses, arguments.photos);
        else if (marker.kind == Marker::Kind::bitmap)
            throw ConfigError({"--poses"}, "no detector finds " + marker.spec +
                                               ": give a pose nearby for each photograph");
        else if (is_board(marker))
            target_ = parse_calibration_target(marker.spec, "--marker");
        else
            detector_ = make_detector("auto", marker, "--marker");
    }

    double error_px() const { return poses_.empty() ? detector_error_px : stage_error_px; }

    Start of(std::size_t i, const std::filesystem::path& photo, const CodeImage& image,
             const Projector& projector) {
        if (!poses_.empty())
            return {poses_[i], {}};
        if (target_)
            return start_from_board(image, *target_, projector);
        const PhotoPose pose = find_marker(photo, image, *detector_, projector, marker_);
        if (!pose.estimate)
            return {{}, pose.failure};
        return {pose.estimate->camera_from_marker, {}};
    }

private:
    const Marker& marker_;
    std::vector<Rigid> poses_;
    std::optional<CalibrationTarget> target_;
    std::unique_ptr<Detector> detector_;
};

Found find_in(const std::filesystem::path& photo, const CodeImage& image, const Start& start,
              double start_error_px, const PhotometricDetector& detector) {
    Found found{photo, start.failure, {}};
    if (!start.camera_from_marker)
        return found;
    const double before = process_cpu_ms();
    auto pose = attempted(
        [&] { return detector.find(image, *start.camera_from_marker, start_error_px); });
    if (pose)
        found.pose = *pose;
    found.failure = pose.cause;
    found.cpu_ms = process_cpu_ms() - before;
    return found;
}

// Small ones: two more digits.
std::string six_deviations(const Matrix6d& covariance) {
    const Vector6d v = covariance.diagonal().cwiseSqrt();
    return fmt::format("{:9.1e} {:9.1e} {:9.1e} {:9.4f} {:9.4f} {:9.4f}", v[0], v[1], v[2], v[3],
                       v[4], v[5]);
}

void print_found(const Found& found, std::size_t width) {
    const std::string name = found.photo.filename().string();
    if (!found.failure.empty()) {
        fmt::print("{:<{}} {}\n", name, width, found.failure);
        return;
    }
    const PhotometricPose& pose = found.pose;
    fmt::print("{:<{}} {}\n", name, width, pose_columns(pose.camera_from_marker));
    fmt::print("{:<{}} {}\n", "  +-", width, six_deviations(pose.covariance));
    if (pose.other)
        fmt::print("{:<{}} {}  log-likelihood {:.1f} lower\n", "  or", width,
                   pose_columns(pose.other->camera_from_marker), pose.other->log_likelihood_ratio);
    fmt::print(
        "{:<{}} noise scale {:.2f}, chi-square {:.3f} per pixel over {} px, {:.0f} ms of CPU "
        "time{}\n",
        "", width, pose.noise_scale, pose.reduced_squares, pose.pixels, found.cpu_ms,
        pose.converged ? "" : ", NOT CONVERGED");
}

void print_table(const std::vector<Found>& all) {
    std::size_t width = 5;
    for (const Found& found : all)
        width = std::max(width, found.photo.filename().string().size());
    fmt::print("{:<{}} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}\n", "photo", width, "rx rad", "ry", "rz",
               "tx mm", "ty", "tz");
    for (const Found& found : all)
        print_found(found, width);
}

ordered_json photo_json(const Found& found) {
    ordered_json json = {{"photo", found.photo.string()}};
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

void print_json(const DetectArguments& arguments, const std::vector<Found>& all) {
    ordered_json json = {{"etalon", "photometric_poses/1"},
                         {"camera", arguments.camera.string()},
                         {"marker", arguments.marker},
                         {"detector", arguments.detector}};
    for (const Found& found : all)
        json["photos"].push_back(photo_json(found));
    std::puts(text_of(json).c_str());
}

}  // namespace

int run_photometric_detect(const DetectArguments& arguments) {
    const Marker marker = parse_marker(arguments.marker, "--marker");
    Starts starts(arguments, marker);
    const CameraModel camera = read_camera_for(arguments.camera, arguments.photos);
    const PhotometricDetector detector(camera, marker, "--marker");
    std::vector<Found> all;
    for (std::size_t i = 0; i < arguments.photos.size(); ++i) {
        const auto& photo = arguments.photos[i];
        const CodeImage image = read_photo(photo, camera, arguments.camera);
        const Start start = starts.of(i, photo, image, detector.camera()->projector());
        all.push_back(find_in(photo, image, start, starts.error_px(), detector));
    }
    if (arguments.json)
        print_json(arguments, all);
    else
        print_table(all);
    const auto found =
        std::count_if(all.begin(), all.end(), [](const Found& one) { return one.failure.empty(); });
    if (found == 0)
        throw NumericalError(fmt::format("{} has no pose in any of {} photographs ({}: {})",
                                         marker.spec, all.size(), all.front().photo.string(),
                                         all.front().failure));
    fmt::print(stderr, "found in {} of {} photographs\n", found, all.size());
    return 0;
}

}  // namespace etalon
