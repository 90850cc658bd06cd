#include "calib/camera/valid_region.h"

#include <Eigen/Eigenvalues>
#include <cmath>

#include "calib/camera/distortion.h"

namespace etalon {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr int direction_count = 256;
constexpr double max_radius = 1e6;  // tangent of a ray 0.2" short of a right angle
constexpr double march_ratio = 1.05;

struct RadiusInterval {
    double low, high;
};

// The radii at which any two of the model's terms have the same size, with a margin.
RadiusInterval interesting_radii(const Distortion& d) {
    constexpr double margin = 50.0;
    constexpr std::array powers{0, 2, 4, 1, 1, 6, 2, 4, 6, 1, 3, 1, 3, 1, 1, 8};
    std::array<double, powers.size()> sizes{1.0};
    std::ranges::copy(d.coefficients(), sizes.begin() + 1);
    for (const std::size_t tilt : {13, 14})
        sizes[tilt] = std::tan(sizes[tilt]);
    RadiusInterval radii{infinity, 0.0};
    for (std::size_t a = 0; a < sizes.size(); ++a)
        for (std::size_t b = 0; b < sizes.size(); ++b) {
            if (sizes[a] == 0.0 || sizes[b] == 0.0 || powers[a] >= powers[b])
                continue;
            const double log_radius =
                (std::log(std::abs(sizes[a])) - std::log(std::abs(sizes[b]))) /
                (powers[b] - powers[a]);
            radii.low = std::min(radii.low, std::exp(log_radius) / margin);
            radii.high = std::max(radii.high, std::exp(log_radius) * margin);
        }
    return {std::max(radii.low, 1e-150), std::min(radii.high, max_radius)};
}

// First radius at which 1 + k4 s + k5 s^2 + k6 s^3 (s = r^2) is zero; infinity if it never is.
// A double root, where it only touches zero, counts.
double pole_radius(const Distortion& d) {
    Eigen::Matrix3d companion;  // its eigenvalues are 1/s, so that k6 = 0 needs no special case
    companion << -d.k4, -d.k5, -d.k6, 1, 0, 0, 0, 1, 0;
    const Eigen::Vector3cd inverse_roots = companion.eigenvalues();
    double first = infinity;
    for (const auto& inverse : inverse_roots)
        if (inverse.real() > 0.0 && std::abs(inverse.imag()) <= 1e-7 * inverse.real())
            first = std::min(first, 1.0 / std::sqrt(inverse.real()));
    return first;
}

// Marches along one direction from the axis.
struct Ray {
    const Distortion& distortion;
    const Eigen::Matrix3d* tilt;  // nothing for a sensor that is not tilted
    Eigen::Vector2d direction;

    Distorted at(double r) const {
        const Distorted before = distort_before_tilt(distortion, r * direction);
        return tilt ? apply_tilt(*tilt, before) : before;
    }
    double determinant(double r) const { return at(r).jacobian.determinant(); }

    double border(const RadiusInterval& radii) const {
        if (!at(0.0).is_regular())
            return 0.0;
        double before = 0.0, last = 0.0;
        double det_before = infinity, det_last = determinant(0.0);
        for (double r = radii.low; r <= radii.high; r *= march_ratio) {
            const Distorted here = at(r);
            if (!here.is_regular())
                return bisected(last, r);
            const double det = here.jacobian.determinant();
            if (det_last < det_before && det_last < det) {  // may dip below zero between the steps
                const double dip = minimum(before, r);
                if (!at(dip).is_regular())
                    return bisected(before, dip);
            }
            before = std::exchange(last, r);
            det_before = std::exchange(det_last, det);
        }
        return infinity;
    }

    // The last regular radius, to rounding.
    double bisected(double regular, double irregular) const {
        for (int i = 0; i < 60; ++i) {
            const double middle = 0.5 * (regular + irregular);
            (at(middle).is_regular() ? regular : irregular) = middle;
        }
        return regular;
    }

    // Of the determinant, by ternary search; ends early below zero.
    double minimum(double low, double high) const {
        for (int i = 0; i < 60 && at(low).is_regular() && at(high).is_regular(); ++i) {
            const double third = (high - low) / 3.0;
            const bool left = determinant(low + third) < determinant(high - third);
            (left ? high : low) = left ? high - third : low + third;
        }
        return at(low).is_regular() ? high : low;
    }
};

bool is_radial(const Distortion& d) {
    return d.p1 == 0 && d.p2 == 0 && d.s1 == 0 && d.s2 == 0 && d.s3 == 0 && d.s4 == 0 &&
           d.tau_x == 0 && d.tau_y == 0;
}

}  // namespace

ValidRegion::ValidRegion(const Distortion& distortion, double limit) {
    const int count = is_radial(distortion) ? 1 : direction_count;
    const RadiusInterval radii = interesting_radii(distortion);
    const double pole = pole_radius(distortion);
    const Eigen::Matrix3d tilt = tilt_matrix(distortion.tau_x, distortion.tau_y);
    const bool is_tilted = distortion.tau_x != 0.0 || distortion.tau_y != 0.0;
    // The border is good to a tenth of 1e-3. Of a radial model no direction lies between others,
    // and the image's radius is that there or a little farther out; at a fold it is largest there.
    constexpr double uncertain = 1e-4;
    const double safety = count == 1 ? 1.0 + 1e-6 : 1.001;
    border_.reserve(count);
    for (int i = 0; i < count; ++i) {
        const double angle = 2.0 * std::numbers::pi * i / count;
        const Eigen::Vector2d direction(std::cos(angle), std::sin(angle));
        const Ray ray{distortion, is_tilted ? &tilt : nullptr, direction};
        border_.push_back(std::min({ray.border(radii), pole, limit}));
        // The map is one to one within: its image ends at the border's.
        const auto radius_at = [&](double border) {
            return distort_before_tilt(distortion, border * direction).point.norm();
        };
        const double radius = safety * std::max(radius_at(border_.back()),
                                                radius_at((1.0 + uncertain) * border_.back()));
        const bool has_end = std::isfinite(border_.back()) && std::isfinite(radius);
        image_radius_ = has_end ? std::max(image_radius_, radius) : infinity;
    }
    safe_radius_ = *std::min_element(border_.begin(), border_.end());
}

double ValidRegion::border(const Eigen::Vector2d& direction) const {
    return border_.size() == 1 ? border_.front() : radius_in_direction(border_, direction);
}

double radius_in_direction(const std::vector<double>& radii, const Eigen::Vector2d& direction) {
    const double turns = std::atan2(direction.y(), direction.x()) / (2.0 * std::numbers::pi);
    if (!std::isfinite(turns))
        return 0.0;
    const std::size_t count = radii.size();
    const double position = (turns < 0.0 ? turns + 1.0 : turns) * static_cast<double>(count);
    const double index = std::floor(position);
    const double a = radii[static_cast<std::size_t>(index) % count];
    const double b = radii[(static_cast<std::size_t>(index) + 1) % count];
    if (!std::isfinite(a) || !std::isfinite(b))
        return std::min(a, b);  // next to a direction with a border, believe the border
    return a + (position - index) * (b - a);
}

}  // namespace etalon
