#include "compare/expect/expectation.h"

#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <Eigen/Dense>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "compare/make_detector.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

// Has each pose studied with a detector, in parallel. Isolated: a thread that waits in its detector
// must not begin another pose with it.
void study_poses(const ExpectedScene& scene, const std::string& place, std::size_t poses,
                 const std::function<void()>& step,
                 const std::function<void(std::size_t, Detector&)>& study) {
    tbb::enumerable_thread_specific<std::unique_ptr<Detector>> detectors(
        [&] { return make_detector(scene.detector, scene.marker, place); });
    detectors.local();  // throws where there is none
    tbb::parallel_for(std::size_t{0}, poses, [&](std::size_t i) {
        tbb::this_task_arena::isolate([&] { study(i, *detectors.local()); });
        if (step)
            step();
    });
}

// Mean and covariance of the noisy frames' differences from the one without noise, by columns.
void fill_noise(const Eigen::MatrixXd& differences, DetectorStatistics& pose) {
    pose.frames = static_cast<int>(differences.cols());
    pose.noise_bias = differences.rowwise().mean();
    const Eigen::MatrixXd deviations =
        (differences.colwise() - pose.noise_bias) / std::sqrt(pose.frames - 1.0);
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(deviations, Eigen::ComputeThinU);
    pose.noise_factor = svd.matrixU() * svd.singularValues().asDiagonal();
}

// `truth`: where the corners are. `first`: noise of the first frame.
std::optional<DetectorStatistics> statistics_of(const ExpectedExposures& exposures,
                                                Detector& detector, const Eigen::VectorXd& truth,
                                                const NoiseKey& first, int frames) {
    const auto clean = exposures.without_noise(detector);
    if (!clean || !clean->is_whole())
        return std::nullopt;
    DetectorStatistics pose;
    pose.bias = stacked(clean->pixels) - truth;
    Eigen::MatrixXd differences(truth.size(), frames);
    Eigen::Index seen = 0;
    for (int i = 0; i < frames; ++i) {
        const auto noisy = exposures.with_noise(
            detector, {first.seed, first.frame + static_cast<std::uint32_t>(i)});
        if (noisy && noisy->is_whole())
            differences.col(seen++) = stacked(noisy->pixels) - stacked(clean->pixels);
    }
    if (2 * seen < frames)
        return std::nullopt;
    fill_noise(differences.leftCols(seen), pose);
    return pose;
}

void summarize(DetectorStudy& study) {
    double noise = 0.0, bias = 0.0, count = 0.0, mean = 0.0, chance = 0.0;
    study.asked = static_cast<int>(study.poses.size());
    for (const auto& pose : study.poses) {
        if (!pose)
            continue;
        ++study.seen;
        const double variance = pose->noise_factor.squaredNorm();
        noise += variance;
        bias += pose->bias.squaredNorm();
        count += static_cast<double>(pose->bias.size());
        mean += pose->noise_bias.squaredNorm();
        chance += variance / pose->frames;
    }
    if (count == 0.0)
        return;
    study.noise_px = std::sqrt(noise / count);
    study.bias_px = std::sqrt(bias / count);
    study.noise_bias_share = mean > chance ? 1.0 - chance / mean : 0.0;
    study.noise_bias_px = study.noise_bias_share * std::sqrt(mean / count);
    for (auto& pose : study.poses)
        if (pose)
            pose->noise_bias *= study.noise_bias_share;
}

}  // namespace

DetectorStudy study_detector(const ExpectedScene& scene, std::span<const Rigid> camera_from_marker,
                             int frames, std::uint64_t seed, const std::function<void()>& step) {
    constexpr int min_frames = 8;
    if (!states_noise(scene.camera))
        throw NumericalError("detector study: the camera declares no sensor noise");
    if (frames < min_frames)
        throw NumericalError(fmt::format("detector study: {} frames a pose, at least {} are needed",
                                         frames, min_frames));
    const ExpectedView view(scene);
    const Projector projector(scene.camera);
    DetectorStudy result;
    result.frames = frames;
    result.poses.resize(camera_from_marker.size());
    study_poses(scene, scene.detector, result.poses.size(), step, [&](std::size_t i, Detector& by) {
        const Rigid& pose = camera_from_marker[i];
        auto truth = attempted([&] { return projected(projector, scene.marker.points_mm, pose); });
        if (truth)
            result.poses[i] = statistics_of({view, pose}, by, stacked(*truth),
                                            {seed, static_cast<std::uint32_t>(i) * 65536u}, frames);
    });
    summarize(result);
    return result;
}

namespace {

constexpr int map_draws = 400;

// Least squares; a direction that the poses do not show (all at one depth) stays zero.
Eigen::VectorXd fitted(const Eigen::MatrixXd& rows, const Eigen::VectorXd& values) {
    Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> decomposition;
    decomposition.setThreshold(1e-9);
    decomposition.compute(rows);
    return decomposition.solve(values);
}

}  // namespace

ExpectationMap::ExpectationMap(std::span<const MarkerPlace> places, std::span<const double> values,
                               std::uint64_t seed)
    : places_(places.begin(), places.end()) {
    if (std::ssize(places) < min_poses || places.size() != values.size())
        throw NumericalError(
            fmt::format("expectation map: {} values at {} poses, at least {} needed", values.size(),
                        places.size(), min_poses));
    const auto [near, far] = std::ranges::minmax_element(places_, {}, &MarkerPlace::depth_mm);
    middle_mm_ = 0.5 * (near->depth_mm + far->depth_mm);
    half_mm_ = std::max(0.5 * (far->depth_mm - near->depth_mm), 1e-9);
    largest_px_ = largest_rad_ = 1e-9;
    for (const MarkerPlace& place : places_) {
        largest_px_ = std::max(largest_px_, place.radius_px);
        largest_rad_ = std::max(largest_rad_, place.tilt_rad);
    }
    const auto count = std::ssize(places);
    Eigen::MatrixXd rows(count, terms);
    for (Eigen::Index i = 0; i < count; ++i)
        rows.row(i) = row(places_[static_cast<std::size_t>(i)]);
    const Eigen::VectorXd all = Eigen::Map<const Eigen::VectorXd>(values.data(), count);
    if (!rows.allFinite() || !all.allFinite())
        throw NumericalError("expectation map: a value is not finite");
    coefficients_ = fitted(rows, all);
    scatter_ = std::sqrt((all - rows * coefficients_).squaredNorm() / static_cast<double>(count));
    Eigen::Index worst = 0;
    (rows * coefficients_).cwiseAbs().maxCoeff(&worst);
    worst_ = static_cast<std::size_t>(worst);
    drawn_.resize(terms, map_draws);
    for (int draw = 0; draw < map_draws; ++draw) {
        RandomStream random(seed, 300, static_cast<std::uint64_t>(draw));
        Eigen::MatrixXd some_rows(count, terms);
        Eigen::VectorXd some(count);
        for (Eigen::Index i = 0; i < count; ++i) {
            const auto k = static_cast<Eigen::Index>(random.uniform() * static_cast<double>(count));
            some_rows.row(i) = rows.row(k);
            some[i] = all[k];
        }
        drawn_.col(draw) = fitted(some_rows, some);
    }
}

ExpectationMap::Row ExpectationMap::row(const MarkerPlace& place) const {
    const double z = (place.depth_mm - middle_mm_) / half_mm_;
    const double r = place.radius_px / largest_px_;
    const double t = std::pow(place.tilt_rad / largest_rad_, 2);
    return (Row() << 1.0, z, z * z, r, r * r, t, z * r, z * t).finished();
}

MapValue ExpectationMap::average(const std::vector<MarkerPlace>& places) const {
    Row sum = Row::Zero();
    for (const MarkerPlace& place : places)
        sum += row(place);
    sum /= static_cast<double>(places.size());
    Eigen::RowVectorXd all = sum * drawn_;
    std::sort(all.begin(), all.end());
    return {sum.dot(coefficients_), all[map_draws / 40], all[map_draws - 1 - map_draws / 40]};
}

MapValue ExpectationMap::average_at(double MarkerPlace::*variable, double x) const {
    std::vector<MarkerPlace> places = places_;
    for (MarkerPlace& place : places)
        place.*variable = x;
    return average(places);
}

namespace {

constexpr double mrad = 1000.0;

// `v` made a unit vector, or `otherwise` where it is too short to tell.
Eigen::Vector3d unit_or(const Eigen::Vector3d& v, const Eigen::Vector3d& otherwise) {
    return v.norm() > 1e-9 ? v.normalized() : otherwise;
}

// B2 where the pose is known; nothing when the marker was not detected.
std::optional<SixErrors> errors_of(const Projector& projector, const Marker& marker,
                                   const std::optional<DetectedCorners>& corners,
                                   const Rigid& camera_from_marker) {
    if (!corners)
        return std::nullopt;
    const PoseBias bias = pose_bias(projector, seen_points_mm(marker, *corners), camera_from_marker,
                                    corners->pixels, {});
    return bias.b2 ? std::optional(components_of(*bias.b2, camera_from_marker)) : std::nullopt;
}

ExpectedPose expected_pose(const ExpectationRequest& request, const ExpectedExposures& exposures,
                           const Projector& projector, Detector& detector, std::size_t index,
                           int frames, const Rigid& camera_from_marker) {
    const Marker& marker = request.scene.marker;
    ExpectedPose pose{camera_from_marker, place_of(projector, camera_from_marker)};
    pose.bias = errors_of(projector, marker, exposures.without_noise(detector), camera_from_marker);
    std::vector<SixErrors> seen;
    for (int frame = 0; frame < frames; ++frame) {
        const auto corners = exposures.with_noise(
            detector, {request.seed + index, static_cast<std::uint32_t>(frame)});
        const auto errors = errors_of(projector, marker, corners, camera_from_marker);
        if (!errors)
            continue;
        ++pose.detections;
        const auto best =
            estimate_pose(projector, seen_points_mm(marker, *corners), corners->pixels);
        pose.flips += best && is_flip(*best, camera_from_marker);
        seen.push_back(*errors);
    }
    pose.noise = deviations_of(seen);
    return pose;
}

// Of `mapped` values; nothing where too few poses have them.
std::optional<std::array<ExpectationMap, 6>> maps_of(const Expectation& expectation,
                                                     Expectation::Six six, double (*mapped)(double),
                                                     std::uint64_t seed) {
    std::vector<MarkerPlace> places;
    for (const ExpectedPose& pose : expectation.poses)
        if (pose.*six)
            places.push_back(pose.place);
    if (std::ssize(places) < ExpectationMap::min_poses)
        return std::nullopt;
    const auto map = [&](std::size_t k) {
        std::vector<double> values = expectation.values(six, k);
        std::ranges::transform(values, values.begin(), mapped);
        return ExpectationMap(places, values, seed + k);
    };
    return std::array<ExpectationMap, 6>{map(0), map(1), map(2), map(3), map(4), map(5)};
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

}  // namespace

std::optional<SixErrors> deviations_of(std::span<const SixErrors> errors) {
    if (errors.size() < 2)
        return std::nullopt;
    SixErrors result;
    for (std::size_t k = 0; k < result.size(); ++k) {
        RunningMoments moments;
        for (const SixErrors& each : errors)
            moments.add(each[k]);
        result[k] = *moments.standard_deviation();
    }
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
    return static_cast<int>(values(&ExpectedPose::bias, 0).size());
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

std::vector<double> Expectation::values(Six six, std::size_t component) const {
    std::vector<double> values;
    for (const ExpectedPose& pose : poses)
        if (pose.*six)
            values.push_back((pose.*six)->at(component));
    return values;
}

void Expectation::fit_maps(std::uint64_t seed) {
    const auto itself = [](double bias) { return bias; };
    // A deviation of zero, of a noise below the last digit, has no logarithm.
    const auto logarithm = [](double deviation) { return std::log(std::max(deviation, 1e-12)); };
    bias_maps = maps_of(*this, &ExpectedPose::bias, itself, seed);
    noise_maps = maps_of(*this, &ExpectedPose::noise, logarithm, seed + 6);
}

Expectation expect_errors(const ExpectationRequest& request, const std::function<void()>& step) {
    Expectation result;
    if (request.frames == 0)
        result.no_noise = "no frames with noise were asked for";
    else if (!states_noise(request.scene.camera))
        result.no_noise = "the calibration declares no sensor noise";
    result.frames = result.no_noise.empty() ? request.frames : 0;
    make_detector(request.scene.detector, request.scene.marker, "--detector");  // or throws
    const std::vector<Rigid> poses = poses_of(request);
    result.poses.resize(poses.size());
    const ExpectedView view(request.scene);
    const Projector projector(request.scene.camera);
    study_poses(request.scene, "--detector", poses.size(), step, [&](std::size_t i, Detector& by) {
        result.poses[i] =
            expected_pose(request, {view, poses[i]}, projector, by, i, result.frames, poses[i]);
    });
    result.fit_maps(request.seed);
    return result;
}

}  // namespace etalon
