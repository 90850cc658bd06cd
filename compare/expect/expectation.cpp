#include "compare/expect/expectation.h"

#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <Eigen/Dense>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "calib/camera/projector.h"
#include "compare/expect/expected_view.h"
#include "compare/expect/pose_statistics.h"
#include "compare/make_detector.h"
#include "core/program/errors.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

using Corners = std::optional<DetectedCorners>;

Eigen::VectorXd stacked(const std::vector<Eigen::Vector2d>& corners) {
    Eigen::VectorXd all(2 * corners.size());
    for (std::size_t i = 0; i < corners.size(); ++i)
        all.segment<2>(static_cast<Eigen::Index>(2 * i)) = corners[i];
    return all;
}

// Where the marker's points truly are; nothing when one has no projection.
std::optional<Eigen::VectorXd> true_pixels(const Projector& projector,
                                           const std::vector<Eigen::Vector3d>& points_mm,
                                           const Rigid& camera_from_marker) {
    std::vector<Eigen::Vector2d> pixels;
    for (const Eigen::Vector3d& point : points_mm) {
        const auto pixel = projector.project(camera_from_marker * point);
        if (!pixel)
            return std::nullopt;
        pixels.push_back(*pixel);
    }
    return stacked(pixels);
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

class NoisyPose {
public:
    NoisyPose(const ExpectedScene& scene, int frames, std::uint64_t seed)
        : scene_(scene), view_(scene), projector_(scene.camera), frames_(frames), seed_(seed) {}

    // Safe from every thread.
    std::optional<DetectorStatistics> at(const Rigid& camera_from_marker, std::size_t index) const {
        const auto truth = true_pixels(projector_, scene_.marker.points_mm, camera_from_marker);
        if (!truth)
            return std::nullopt;
        const ExpectedExposures exposures(view_, camera_from_marker);
        const auto detector = make_detector(scene_.detector, scene_.marker, scene_.detector);
        const Corners clean = exposures.without_noise(*detector);
        if (!clean || !clean->is_whole())
            return std::nullopt;
        DetectorStatistics pose;
        pose.bias = stacked(clean->pixels) - *truth;
        Eigen::MatrixXd differences(truth->size(), frames_);
        Eigen::Index seen = 0;
        for (int i = 0; i < frames_; ++i) {
            const auto frame =
                static_cast<std::uint32_t>(index) * 65536u + static_cast<std::uint32_t>(i);
            const Corners noisy = exposures.with_noise(*detector, {seed_, frame});
            if (noisy && noisy->is_whole())
                differences.col(seen++) = stacked(noisy->pixels) - stacked(clean->pixels);
        }
        if (2 * seen < frames_)
            return std::nullopt;
        fill_noise(differences.leftCols(seen), pose);
        return pose;
    }

private:
    const ExpectedScene& scene_;
    ExpectedView view_;
    Projector projector_;
    int frames_;
    std::uint64_t seed_;
};

void summarize(DetectorStudy& study) {
    double noise = 0.0, bias = 0.0, count = 0.0, mean = 0.0, chance = 0.0;
    for (const auto& pose : study.poses) {
        if (!pose)
            continue;
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
    const auto& sensor = scene.camera.sensor;
    if (!sensor || !(sensor->gain_e_per_dn > 0.0))
        throw NumericalError("detector study: the camera declares no sensor noise");
    if (frames < min_frames)
        throw NumericalError(fmt::format("detector study: {} frames a pose, at least {} are needed",
                                         frames, min_frames));
    const NoisyPose study(scene, frames, seed);
    DetectorStudy result;
    result.frames = frames;
    result.poses.resize(camera_from_marker.size());
    tbb::parallel_for(std::size_t{0}, camera_from_marker.size(), [&](std::size_t i) {
        result.poses[i] = study.at(camera_from_marker[i], i);
        if (step)
            step();
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
    const auto [near, far] = std::minmax_element(
        places_.begin(), places_.end(),
        [](const MarkerPlace& a, const MarkerPlace& b) { return a.depth_mm < b.depth_mm; });
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

MapValue ExpectationMap::value_of(const Row& row) const {
    Eigen::RowVectorXd all = row * drawn_;
    std::sort(all.begin(), all.end());
    return {row.dot(coefficients_), all[map_draws / 40], all[map_draws - 1 - map_draws / 40]};
}

MapValue ExpectationMap::at(const MarkerPlace& place) const {
    return value_of(row(place));
}

MapValue ExpectationMap::average_at(Variable variable, double x) const {
    Row sum = Row::Zero();
    for (MarkerPlace place : places_) {
        if (variable == Variable::depth)
            place.depth_mm = x;
        else if (variable == Variable::radius)
            place.radius_px = x;
        else
            place.tilt_rad = x;
        sum += row(place);
    }
    return value_of(sum / static_cast<double>(places_.size()));
}

MapValue ExpectationMap::mean() const {
    Row sum = Row::Zero();
    for (const MarkerPlace& place : places_)
        sum += row(place);
    return value_of(sum / static_cast<double>(places_.size()));
}

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

using SixOfPose = std::optional<SixErrors> ExpectedPose::*;

std::vector<double> values_of(const std::vector<ExpectedPose>& poses, SixOfPose six,
                              std::size_t component) {
    std::vector<double> values;
    for (const ExpectedPose& pose : poses)
        if (pose.*six)
            values.push_back((pose.*six)->at(component));
    return values;
}

// Of `mapped` values; nothing where too few poses have them.
std::optional<std::array<ExpectationMap, 6>> maps_of(const std::vector<ExpectedPose>& poses,
                                                     SixOfPose six, double (*mapped)(double),
                                                     std::uint64_t seed) {
    std::vector<MarkerPlace> places;
    for (const ExpectedPose& pose : poses)
        if (pose.*six)
            places.push_back(pose.place);
    if (std::ssize(places) < ExpectationMap::min_poses)
        return std::nullopt;
    const auto map = [&](std::size_t k) {
        std::vector<double> values = values_of(poses, six, k);
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
    return values_of(poses, &ExpectedPose::bias, static_cast<std::size_t>(component));
}

std::vector<double> Expectation::noises(int component) const {
    return values_of(poses, &ExpectedPose::noise, static_cast<std::size_t>(component));
}

void fit_maps(Expectation& expectation, std::uint64_t seed) {
    const auto itself = [](double bias) { return bias; };
    expectation.bias_maps = maps_of(expectation.poses, &ExpectedPose::bias, itself, seed);
    expectation.noise_maps = maps_of(expectation.poses, &ExpectedPose::noise, logarithm, seed + 6);
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
