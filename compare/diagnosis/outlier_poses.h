// Outlier poses are left out of registration and field, and withhold PASS: the stage was not where
// it said, the camera showed an old frame, or the detector took something else for the marker.
#pragma once

#include "compare/diagnosis/error_candidates.h"
#include "compare/uncertainty/bias_field.h"

namespace etalon {

// Index among those that were given, and where the marker is less where it should be, camera frame.
struct OutlierPose {
    std::size_t index = 0;
    Eigen::Vector3d off_mm = Eigen::Vector3d::Zero();
};

// How many of so many poses may be outliers: 1 in 20, one at least. Where more are, the functions
// below give none.
std::size_t max_outlying(std::size_t poses);

// Samples off the smooth field of the others by more than 8 robust standard deviations and by more
// than `least_mm`, the farthest first. `field` is that of all samples; each that is found costs
// another fit. Throws what fit_smooth_field throws.
std::vector<OutlierPose> outlying_samples(std::span<const FieldSample> samples,
                                          const BiasField& field, double least_mm);

// Of the `poses` given to the registration those whose corners lie more than 8 times as far from
// the predicted ones as the median pose's, and the marker by more than `least_mm`.
std::vector<OutlierPose> outlying_registered(const Projector& projector,
                                             const ObjectPoints& points_mm,
                                             const BiasCorrectedRegistration& registration,
                                             std::span<const RegistrationPose> poses,
                                             double least_mm);

// " along x by 96.1 mm", where one axis (at pose `pose` of the motions) moves the marker that way;
// else " by 96.1 mm". `off` is in the frame of the stage's base, mm.
std::string off_text(const Eigen::Vector3d& off, std::span<const StageAxisMotion> axes,
                     const Rigid& base_from_carriage, const Rigid& carriage_from_marker,
                     std::size_t pose);

}  // namespace etalon
