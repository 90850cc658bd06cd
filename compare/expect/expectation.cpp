#include "compare/expect/expectation.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <cmath>

#include "calib/camera/viewing_geometry.h"
#include "compare/expect/expected_view.h"
#include "compare/expect/pose_statistics.h"
#include "compare/make_detector.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double mrad = 1000.0;

// `v` made a unit vector, or `otherwise` where it is too short to tell.
Eigen::Vector3d unit_or(const Eigen::Vector3d& v, const Eigen::Vector3d& otherwise) {
    return v.norm() > 1e-9 ? v.normalized() : otherwise;
}

std::string why_no_noise(const ExpectationRequest& request) {
    if (request.frames == 0)
        return "no frames with noise were asked for";
    if (!request.scene.camera.sensor || request.scene.camera.sensor->gain_e_per_dn <= 0.0)
        return "the calibration declares no sensor noise";
    return "";
}

class PoseStudy {
public:
    explicit PoseStudy(const ExpectationRequest& request)
        : request_(request), view_(request.scene), projector_(request.scene.camera) {}

    ExpectedPose at(const Rigid& camera_from_marker, std::size_t index, int frames,
                    Detector& detector) const {
        ExpectedPose pose{camera_from_marker, place_of(projector_, camera_from_marker)};
        const ExpectedExposures exposures(view_, camera_from_marker);
        if (const auto bias = bias_of(exposures.without_noise(detector), camera_from_marker))
            pose.bias = components_of(*bias->b2, camera_from_marker);
        ErrorSpread spread;
        for (int frame = 0; frame < frames; ++frame) {
            const NoiseKey key{request_.seed + index, static_cast<std::uint32_t>(frame)};
            const auto corners = exposures.with_noise(detector, key);
            const auto seen = bias_of(corners, camera_from_marker);
            if (!seen)
                continue;
            ++pose.detections;
            pose.flips += fits_better_flipped(*corners, camera_from_marker);
            spread.add(components_of(*seen->b2, camera_from_marker));
        }
        pose.noise = spread.deviations();
        return pose;
    }

private:
    bool fits_better_flipped(const DetectedCorners& corners,
                             const Rigid& camera_from_marker) const {
        const auto best = estimate_pose(projector_, seen_points_mm(request_.scene.marker, corners),
                                        corners.pixels);
        return best && is_flip(*best, camera_from_marker);
    }

    // B2 where the pose is known; nothing when the marker was not detected.
    std::optional<PoseBias> bias_of(const std::optional<DetectedCorners>& corners,
                                    const Rigid& camera_from_marker) const {
        if (!corners)
            return std::nullopt;
        const PoseBias bias = pose_bias(projector_, seen_points_mm(request_.scene.marker, *corners),
                                        camera_from_marker, corners->pixels, {});
        return bias.b2 ? std::optional(bias) : std::nullopt;
    }

    const ExpectationRequest& request_;
    ExpectedView view_;
    Projector projector_;
};

std::array<ExpectationMap, 6> maps_of(const std::vector<MarkerPlace>& places,
                                      const std::array<std::vector<double>, 6>& values,
                                      std::uint64_t seed) {
    const auto map = [&](std::size_t k) { return ExpectationMap(places, values[k], seed + k); };
    return {map(0), map(1), map(2), map(3), map(4), map(5)};
}

// Of twice as many while too few of them are rendered.
std::vector<Rigid> poses_of(const ExpectationRequest& request) {
    constexpr int most = 64;
    const CellGrid& grid = request.scene.marker.grid;
    const auto wanted = static_cast<std::size_t>(request.poses);
    for (int times = 1; times <= most; times *= 2) {
        std::vector<Rigid> poses = volume_poses(request.scene.camera, grid, times * request.poses,
                                                request.seed, request.volume);
        std::erase_if(poses, [&](const Rigid& pose) {
            return !is_rendered(grid, pose, request.scene.camera);
        });
        if (poses.size() < wanted)
            continue;
        poses.resize(wanted);
        return poses;
    }
    throw NumericalError("hardly any pose of the volume is rendered: it lies too far aside");
}

// A deviation of zero, of a noise below the last digit, has no logarithm.
double logarithm(double deviation) {
    return std::log(std::max(deviation, 1e-12));
}

}  // namespace

void ErrorSpread::add(const SixErrors& errors) {
    ++count_;
    for (std::size_t k = 0; k < 6; ++k) {
        const double before = errors[k] - mean_[k];
        mean_[k] += before / count_;
        squares_[k] += before * (errors[k] - mean_[k]);
    }
}

std::optional<SixErrors> ErrorSpread::deviations() const {
    if (count_ < 2)
        return std::nullopt;
    SixErrors result;
    for (std::size_t k = 0; k < 6; ++k)
        result[k] = std::sqrt(squares_[k] / (count_ - 1));
    return result;
}

SixErrors components_of(const PoseError& error, const Rigid& camera_from_marker) {
    const Eigen::Vector3d sight = camera_from_marker.translation.normalized();
    const Eigen::Vector3d off_axis(sight.x(), sight.y(), 0.0);
    const Eigen::Vector3d outwards =
        unit_or(off_axis - sight * sight.dot(off_axis), Eigen::Vector3d::UnitX());
    const Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  // marker frame from here on
    const Eigen::Vector3d sight_marker = camera_from_marker.rotation.conjugate() * sight;
    const Eigen::Vector3d tilt_axis = unit_or(sight_marker.cross(normal), Eigen::Vector3d::UnitX());
    return {sight.dot(error.translation_mm),
            outwards.dot(error.translation_mm),
            sight.cross(outwards).dot(error.translation_mm),
            mrad * error.rotation_rad.z(),
            mrad * tilt_axis.dot(error.rotation_rad),
            mrad * normal.cross(tilt_axis).dot(error.rotation_rad)};
}

MarkerPlace place_of(const Projector& projector, const Rigid& camera_from_marker) {
    const Eigen::Vector3d& p = camera_from_marker.translation;
    const Intrinsics& k = projector.camera().intrinsics;
    const auto pixel = projector.project(p);
    const Eigen::Vector3d normal = camera_from_marker.rotation * Eigen::Vector3d::UnitZ();
    const double cosine = std::clamp(normal.dot(p.normalized()), -1.0, 1.0);
    return {depth_mm(projector.camera().projection, p),
            pixel ? (*pixel - Eigen::Vector2d(k.cx, k.cy)).norm() : 0.0, std::acos(cosine)};
}

int Expectation::detected() const {
    return static_cast<int>(std::count_if(
        poses.begin(), poses.end(), [](const ExpectedPose& p) { return p.bias.has_value(); }));
}

double Expectation::detection_rate() const {
    int found = detected();
    for (const ExpectedPose& pose : poses)
        found += pose.detections;
    const double asked = static_cast<double>(poses.size()) * (1.0 + frames);
    return asked > 0.0 ? found / asked : 0.0;
}

double Expectation::flip_rate() const {
    int flips = 0, found = 0;
    for (const ExpectedPose& pose : poses) {
        flips += pose.flips;
        found += pose.detections;
    }
    return found > 0 ? static_cast<double>(flips) / found : 0.0;
}

std::vector<double> Expectation::biases(int component) const {
    std::vector<double> values;
    for (const ExpectedPose& pose : poses)
        if (pose.bias)
            values.push_back(pose.bias->at(static_cast<std::size_t>(component)));
    return values;
}

std::vector<double> Expectation::noises(int component) const {
    std::vector<double> values;
    for (const ExpectedPose& pose : poses)
        if (pose.noise)
            values.push_back(pose.noise->at(static_cast<std::size_t>(component)));
    return values;
}

void fit_maps(Expectation& expectation, std::uint64_t seed) {
    std::vector<MarkerPlace> bias_places, noise_places;
    std::array<std::vector<double>, 6> bias, noise;
    for (const ExpectedPose& pose : expectation.poses) {
        if (pose.bias)
            bias_places.push_back(pose.place);
        if (pose.noise)
            noise_places.push_back(pose.place);
        for (std::size_t k = 0; k < 6; ++k) {
            if (pose.bias)
                bias[k].push_back((*pose.bias)[k]);
            if (pose.noise)
                noise[k].push_back(logarithm((*pose.noise)[k]));
        }
    }
    if (std::ssize(bias_places) >= ExpectationMap::min_poses)
        expectation.bias_maps = maps_of(bias_places, bias, seed);
    if (std::ssize(noise_places) >= ExpectationMap::min_poses)
        expectation.noise_maps = maps_of(noise_places, noise, seed + 6);
}

Expectation expect_errors(const ExpectationRequest& request, const std::function<void()>& step) {
    const auto new_detector = [&] {
        return make_detector(request.scene.detector, request.scene.marker, "--detector");
    };
    new_detector();  // whether there is one
    const std::vector<Rigid> poses = poses_of(request);
    Expectation result;
    result.no_noise = why_no_noise(request);
    result.frames = result.no_noise.empty() ? request.frames : 0;
    result.poses.resize(poses.size());
    const PoseStudy study(request);
    tbb::enumerable_thread_specific<std::unique_ptr<Detector>> detectors(new_detector);
    tbb::parallel_for(std::size_t{0}, poses.size(), [&](std::size_t i) {
        result.poses[i] = study.at(poses[i], i, result.frames, *detectors.local());
        if (step)
            step();
    });
    fit_maps(result, request.seed);
    return result;
}

}  // namespace etalon
