#include "compare/diagnosis/outlier_poses.h"

#include <fmt/format.h>

#include <numeric>

#include "core/statistics/distributions.h"

namespace etalon {
namespace {

constexpr double far_deviations = 8.0;

// Its length in the sample's standard deviations along and across its axis.
double deviations(const FieldSample& sample, const Eigen::Vector3d& off) {
    const double along = sample.axis.dot(off);
    const double across = (off - along * sample.axis).norm();
    return std::hypot(along / sample.sigma_along, across / sample.sigma_across);
}

using Indices = std::vector<std::size_t>;

Eigen::Vector3d off_field(const FieldSample& sample, const BiasField& field) {
    return sample.error - field.at(sample.position_mm);
}

// Of those that are left the one that is farthest from their field; nothing where it is not
// outlying.
std::optional<std::size_t> farthest(std::span<const FieldSample> samples, const Indices& left,
                                    const BiasField& field, double least) {
    constexpr double usual_length = 1.54;  // median of three standard normal deviates'
    std::vector<double> all;
    for (const std::size_t i : left)
        all.push_back(deviations(samples[i], off_field(samples[i], field)));
    const auto longest = std::ranges::max_element(all);
    const std::size_t index = left[static_cast<std::size_t>(longest - all.begin())];
    const bool is_outlying = *longest > far_deviations * median(all) / usual_length &&
                             off_field(samples[index], field).norm() > least;
    return is_outlying ? std::optional(index) : std::nullopt;
}

}  // namespace

std::size_t max_outlying(std::size_t poses) {
    return std::max<std::size_t>(1, poses / 20);
}

std::vector<OutlierPose> outlying_samples(std::span<const FieldSample> samples,
                                          const BiasField& field, double least_mm) {
    Indices left(samples.size()), taken;
    std::iota(left.begin(), left.end(), std::size_t{0});
    BiasField of_left = field;
    while (const auto found = farthest(samples, left, of_left, least_mm)) {
        if (taken.size() == max_outlying(samples.size()))
            return {};
        std::erase(left, *found);
        taken.push_back(*found);
        std::vector<FieldSample> fitted;
        for (const std::size_t i : left)
            fitted.push_back(samples[i]);
        of_left = fit_smooth_field(fitted, field.basis);
    }
    std::vector<OutlierPose> outlying;
    for (const std::size_t i : taken)
        outlying.push_back({i, off_field(samples[i], of_left)});
    return outlying;
}

std::vector<OutlierPose> outlying_registered(const Projector& projector,
                                             const ObjectPoints& points_mm,
                                             const BiasCorrectedRegistration& registration,
                                             std::span<const RegistrationPose> poses,
                                             double least_mm) {
    std::vector<Rigid> predicted;
    std::vector<double> lengths;  // of the corners from the predicted ones, px
    for (const std::size_t i : registration.used) {
        predicted.push_back(
            registration.registration.camera_from_marker(poses[i].base_from_carriage));
        double squares = 0.0;
        for (const Eigen::Vector2d& off :
             differences(registration.corrected_px[lengths.size()],
                         projected(projector, points_mm, predicted.back())))
            squares += off.squaredNorm();
        lengths.push_back(std::sqrt(squares));
    }
    const double far_px = far_deviations * median(lengths);
    std::vector<OutlierPose> outlying;
    for (std::size_t i = 0; i < lengths.size(); ++i) {
        if (!(lengths[i] > far_px))
            continue;
        const auto seen =
            estimate_pose_near(projector, points_mm, registration.corrected_px[i], predicted[i]);
        if (!seen)
            continue;
        const Eigen::Vector3d off = seen->camera_from_marker.translation - predicted[i].translation;
        if (off.norm() > least_mm)
            outlying.push_back({registration.used[i], off});
    }
    return outlying.size() > max_outlying(lengths.size()) ? std::vector<OutlierPose>{} : outlying;
}

std::string off_text(const Eigen::Vector3d& off, std::span<const StageAxisMotion> axes,
                     const Rigid& base_from_carriage, const Rigid& carriage_from_marker,
                     std::size_t pose) {
    constexpr double alike = 0.98;  // of the cosine
    const Eigen::Vector3d here = base_from_carriage * carriage_from_marker.translation;
    for (const StageAxisMotion& axis : axes) {
        const Eigen::Vector3d moved =
            axis.advanced.at(pose) * carriage_from_marker.translation - here;
        if (std::abs(off.dot(moved)) > alike * off.norm() * moved.norm())
            return fmt::format(" along {} by {:.3g} mm", axis.name, off.norm());
    }
    return fmt::format(" by {:.3g} mm", off.norm());
}

}  // namespace etalon
