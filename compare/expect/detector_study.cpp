#include "compare/expect/detector_study.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/SVD>
#include <cmath>

#include "compare/expect/expected_view.h"
#include "compare/make_detector.h"
#include "core/program/errors.h"

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
std::optional<Eigen::VectorXd> projected(const Projector& projector,
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
        const auto truth = projected(projector_, scene_.marker.points_mm, camera_from_marker);
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

}  // namespace etalon
