// A marker study without images: poses as in the published one, and errors of the kinds that
// detectors show there (growing with distance and tilt, biased in depth, flipped, missed).
#pragma once

#include "compare/expect/pose_statistics.h"
#include "core/statistics/random.h"

namespace etalon::test {

// z from 500 to 1500 mm within +-21 by +-16 degrees, roll and pitch +-45, yaw +-180 degrees.
inline std::vector<Rigid> study_poses(std::size_t count) {
    std::vector<Rigid> poses;
    for (std::size_t i = 0; i < count; ++i) {
        RandomStream random(23, 1, i);
        const auto within = [&](double reach) { return reach * (2.0 * random.uniform() - 1.0); };
        const double z = 1000.0 + within(500.0), x = within(0.38 * z), y = within(0.28 * z);
        const double rad = std::numbers::pi / 180.0;
        poses.push_back({rotation_from_roll_pitch_yaw(
                             {within(45.0 * rad), within(45.0 * rad), within(180.0 * rad)}),
                         {x, y, z}});
    }
    return poses;
}

// What a detector does: errors scale with `noise`, depth comes out too large by `bias` of itself.
struct SyntheticDetector {
    double noise = 1.0, bias = 0.0, flip_rate = 0.0, missed_when_far = 0.0;
};

inline DetectorErrors synthetic_errors(const SyntheticDetector& detector,
                                       const std::vector<Rigid>& poses, std::uint32_t stream) {
    DetectorErrors errors;
    for (std::size_t i = 0; i < poses.size(); ++i) {
        RandomStream random(29, stream, i);
        const Rigid& truth = poses[i];
        const double z = truth.translation.z(), far = (z - 500.0) / 1000.0;
        if (random.uniform() < detector.missed_when_far * far * far) {
            errors.push_back(std::nullopt);
            continue;
        }
        const double depth_noise = detector.noise * 2e-6 * z * z, shift = random.normal();
        const double depth = depth_noise * shift + detector.bias * z * (0.4 + far);
        const Eigen::Vector3d ray = truth.translation / z, angles = roll_pitch_yaw(truth.rotation);
        const bool flip = random.uniform() < detector.flip_rate * (0.3 + far);
        const double tilt_noise =
            detector.noise * 0.004 * (0.4 + far) / (0.3 + std::abs(angles.x()));
        Eigen::Vector3d turned =
            angles + tilt_noise * Eigen::Vector3d(random.normal(), random.normal(), 0.0);
        turned.z() += detector.noise * 0.0009 * (0.3 + far) * random.normal();
        if (flip)
            turned.head<2>() = -turned.head<2>();
        const Eigen::Vector3d side(random.normal(), random.normal(), 0.0);
        const Rigid estimated{rotation_from_roll_pitch_yaw(turned),
                              truth.translation + depth * ray + 4e-5 * detector.noise * z * side};
        errors.push_back(detected_error(estimated, truth, flip));
    }
    return errors;
}

inline std::vector<PoseComponents> components(const std::vector<Rigid>& poses) {
    std::vector<PoseComponents> rows;
    for (const Rigid& pose : poses)
        rows.push_back(pose_components(pose));
    return rows;
}

}  // namespace etalon::test
