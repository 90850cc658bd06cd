// The stage's axes as station.yaml lists them: geometry, limits, errors, declared uncertainties.
//
//     base_from_carriage(q) = M_1 A_1(d_1) M_2 A_2(d_2) ... M_n A_n(d_n)
//     d_i = q_i - zero_i + error_i(q_i)         how far axis i truly is; axis 1 is next to the base
//
// M_i is how axis i is mounted on what the one before it carries (identity unless declared). A
// linear axis translates by d along `direction`, a rotary one turns by d about `direction` through
// `point_mm`, in the mounted frame. Positions q are the controller's, mm or rad.
#pragma once

#include <span>

#include "core/geometry/rigid.h"
#include "core/geometry/units.h"
#include "stage/axes/error_map.h"

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

    // How the controller counts it; nothing: as the profile says, and the link's unit.
    std::optional<int> unit;                // Modbus unit that drives it
    std::optional<double> counts_per_unit;  // per mm or rad, not 0; negative: it counts backwards
    std::optional<double> lead;             // mm or rad per turn of the motor, > 0

    // Geometry as measured.
    Rigid previous_from_mount;       // M above
    double zero = 0.0;               // the position at which it sits as mounted, mm or rad
    std::optional<ErrorMap> errors;  // covers the soft limits
    double backlash = 0.0;           // on reversal, >= 0, mm or rad

    // Every position is approached from below (+1) or from above (-1) over at least `overrun`, mm
    // or rad, so that the backlash is always on the same side; 0: from either side.
    int approach = 0;
    double overrun = 0.0;

    // Declared standard uncertainties like the above.
    std::optional<double> backlash_uncertainty;   // mm or rad
    std::optional<double> read_noise;             // of a single read-back, mm or rad
    std::optional<double> direction_uncertainty;  // rad, in each of the two ways it can lean
    std::optional<double> point_uncertainty;      // mm, of a rotary axis, across its direction
};

// Reads a list of axes, first the one nearest to the base:
//     linear: {name, kind: linear, direction, travel: [low, high] mm, speed mm/s}
//     rotary: {name, kind: rotary, direction, point_mm, travel_deg: [low, high], speed_deg per s}
// The direction is any vector but zero and is made a unit vector. Names are unique. Optional, with
// lengths in um (rotary: angles in degrees, `_deg` instead of `_um`):
//     unit; counts_per_mm or counts_per_deg; lead_mm or lead_deg; zero in mm or zero_deg
//     mount: {rotation_deg: [rx, ry, rz], translation_mm: [x, y, z]}     rotation vector
//     error_map (stage/axes/error_map.h); backlash_um; approach: {from: below or above, overrun_um}
//     scale_uncertainty_ppm, repeatability_um, backlash_uncertainty_um, read_noise_um,
//     direction_uncertainty_urad, point_uncertainty_um (rotary)
// Throws ConfigError.
std::vector<Axis> read_axes(const Value& list);

// The numbers of an axis as people write them: lengths in mm and small ones in um, angles in
// degrees, as the keys say: travel or travel_deg, lead_mm or lead_deg, backlash_um or backlash_deg.
struct AxisUnits {
    bool is_rotary;

    explicit AxisUnits(Axis::Kind kind) : is_rotary(kind == Axis::Kind::rotary) {}
    const Unit& large() const { return is_rotary ? units::deg : units::mm; }
    const Unit& small() const { return is_rotary ? units::deg : units::um; }
    double per_large() const { return is_rotary ? rad_per_deg : 1.0; }  // mm or rad
    double per_small() const { return is_rotary ? rad_per_deg : 1e-3; }
    std::string key(const std::string& name) const { return name + (is_rotary ? "_deg" : ""); }
    std::string mm_key(const std::string& name) const {
        return name + (is_rotary ? "_deg" : "_mm");
    }
    std::string um_key(const std::string& name) const {
        return name + (is_rotary ? "_deg" : "_um");
    }

    // [low, high] in large units with low < high, as mm or rad.
    std::array<double, 2> interval(const Value& value) const;
};

// A position in the unit that people type: "12.5 mm", "90 deg".
std::string as_typed(const Axis& axis, double position);

// Throws ConfigError at `place` when the numbers of axes and positions differ.
void require_same_count(std::size_t axes, std::size_t positions, const SourcePlace& place);

// The same, and for the first axis outside its soft limits (these are inside, NaN is outside).
void require_within_limits(std::span<const Axis> axes, std::span<const double> positions,
                           const SourcePlace& place);

}  // namespace etalon
