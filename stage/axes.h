// The stage's axes as geometry: from axis positions to the transform of what they carry.
//
//     base_from_carriage(q) = A_1(q_1) A_2(q_2) ... A_n(q_n)      first axis nearest to the base
//
// A linear axis translates along `direction`, a rotary one turns by q about `direction` through
// `point_mm`, both given in the frame that the axis sits in at q = 0 of the axes before it.
// Positions are mm or rad. Pure functions, no device.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/rigid.h"
#include "core/strict_reader.h"

namespace etalon {

struct Axis {
    enum class Kind { linear, rotary };

    std::string name;  // "x", "rz"
    Kind kind = Kind::linear;
    Eigen::Vector3d direction{0, 0, 1};                  // unit
    Eigen::Vector3d point_mm = Eigen::Vector3d::Zero();  // on a rotary axis
    double low = 0.0, high = 0.0;                        // soft limits, mm or rad
    double speed = 0.0;                                  // mm/s or rad/s, > 0
    // Declared standard uncertainties; nothing when the maker or a calibration does not say.
    std::optional<double> scale_uncertainty;  // relative (1e-6 = 1 ppm)
    std::optional<double> repeatability;      // mm or rad
};

// Reads a list of axes, first the one nearest to the base:
//     linear: {name, kind: linear, direction, travel: [low, high] mm, speed mm/s}
//     rotary: {name, kind: rotary, direction, point_mm, travel_deg: [low, high], speed_deg per s}
// and optionally scale_uncertainty_ppm, repeatability_um or repeatability_deg. The direction is any
// vector but zero and is made a unit vector. Names are unique. Throws ConfigError.
std::vector<Axis> read_axes(const Value& list);

// positions.size() == axes.size(), else ConfigError. The limits are not looked at.
Rigid base_from_carriage(std::span<const Axis> axes, std::span<const double> positions);

// Throws ConfigError at `place` naming the first axis and position outside its soft limits (the
// limits themselves are inside, NaN is outside), or when the numbers of axes and positions differ.
void require_within_limits(std::span<const Axis> axes, std::span<const double> positions,
                           const SourcePlace& place);

}  // namespace etalon
