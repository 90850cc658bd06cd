// Pose errors with a known smooth field and known noise, for the tests of the field's fit.
#pragma once

#include <Eigen/Geometry>
#include <cmath>

#include "compare/uncertainty/bias_field.h"
#include "core/statistics/random.h"

namespace etalon::field_samples {

inline Eigen::Vector3d position(std::size_t i, std::uint64_t seed = 11) {
    RandomStream random(seed, 7, i);
    const double x = random.uniform(), y = random.uniform(), z = random.uniform();
    return {240 * x - 120, 160 * y - 80, 350 + 300 * z};
}

inline std::vector<Eigen::Vector3d> positions(std::size_t count) {
    std::vector<Eigen::Vector3d> all;
    for (std::size_t i = 0; i < count; ++i)
        all.push_back(position(i));
    return all;
}

// A field with every kind of term: constant, linear, distortion, depth squared.
inline Eigen::Vector3d truth(const Eigen::Vector3d& p) {
    const double rho2 = p.head<2>().squaredNorm() / (p.z() * p.z());
    return Eigen::Vector3d(0.02 + 1e-4 * p.x() - 3e-4 * p.z(), -0.05 + 2e-4 * p.y(),
                           0.1 - 5e-4 * p.x() + 7e-4 * p.z() + 1e-6 * p.z() * p.z()) +
           rho2 * Eigen::Vector3d(0.004 * p.x(), 0.004 * p.y(), -0.003 * p.z());
}

// Noise along the line of sight ten times that across it, and growing with the distance.
inline std::vector<FieldSample> samples(std::size_t count, double size, double noise_mm,
                                        std::uint64_t seed) {
    std::vector<FieldSample> all;
    for (std::size_t i = 0; i < count; ++i) {
        RandomStream random(seed, 8, i);
        FieldSample sample;
        sample.position_mm = position(i);
        sample.axis = sample.position_mm.normalized();
        sample.sigma_along = std::pow(sample.position_mm.z() / 500, 2);
        sample.sigma_across = 0.1 * sample.sigma_along;
        const Eigen::Vector3d across = sample.axis.unitOrthogonal();
        const double along_noise = noise_mm * sample.sigma_along * random.normal();
        const double first = noise_mm * sample.sigma_across * random.normal();
        const double second = noise_mm * sample.sigma_across * random.normal();
        sample.error = size * truth(sample.position_mm) + along_noise * sample.axis +
                       first * across + second * sample.axis.cross(across);
        all.push_back(sample);
    }
    return all;
}

}  // namespace etalon::field_samples
