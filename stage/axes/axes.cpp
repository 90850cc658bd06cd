#include "stage/axes/axes.h"

#include <fmt/format.h>

#include <cmath>

namespace etalon {
namespace {

Eigen::Vector3d read_direction(const Value& value) {
    const std::vector<double> numbers = value.numbers(3, units::one.either_sign());
    const Eigen::Vector3d direction(numbers[0], numbers[1], numbers[2]);
    const double length = direction.stableNorm();
    if (!(length > 0.0) || !std::isfinite(length))
        value.fail("must be a direction, not zero");
    return (direction / length).normalized();
}

std::optional<double> optional_number(const Value& item, const std::string& key, Range range,
                                      double unit) {
    const auto value = item.find(key);
    return value ? std::optional(value->number(range) * unit) : std::nullopt;
}

// A length in um or an angle in degrees.
std::optional<double> small_size(const Value& item, const std::string& name,
                                 const AxisUnits& units) {
    return optional_number(item, units.um_key(name), units.small().non_negative(),
                           units.per_small());
}

void read_controller(const Value& item, const AxisUnits& units, Axis& axis) {
    if (const auto value = item.find("unit"))
        axis.unit = value->integer(0, 255);
    const std::string counts = units.mm_key("counts_per");
    if (const auto value = item.find(counts)) {
        const double per_unit = value->number(units::counts.either_sign());
        if (std::abs(per_unit) < units::counts.least)
            value->fail(
                fmt::format("must be at least {} in size, not {}", units::counts.least, per_unit));
        axis.counts_per_unit = per_unit / units.per_large();
    }
    axis.lead =
        optional_number(item, units.mm_key("lead"), units.large().positive(), units.per_large());
}

Rigid read_mount(const Value& mount) {
    const auto rotation = mount.at("rotation_deg").numbers(3, {-360.0, 360.0});
    const auto translation = mount.at("translation_mm").numbers(3, units::mm.either_sign());
    return {rotation_from_vector(Eigen::Vector3d(rotation.data()) * rad_per_deg),
            Eigen::Vector3d(translation.data())};
}

void read_errors(const Value& value, Axis& axis) {
    axis.errors = read_error_map(value, axis.kind == Axis::Kind::rotary);
    const auto& points = axis.errors->points();
    if (points.front().position > axis.low || points.back().position < axis.high)
        value.fail("does not cover the travel of axis " + axis.name);
}

void read_approach(const Value& value, const AxisUnits& units, Axis& axis) {
    axis.approach = value.at("from").one_of({"below", "above"}) == "below" ? 1 : -1;
    const Value overrun = value.at(units.um_key("overrun"));
    axis.overrun = overrun.number(units.small().positive()) * units.per_small();
    if (axis.overrun < axis.backlash)
        overrun.fail("must be at least the backlash");
}

void read_geometry(const Value& item, const AxisUnits& units, Axis& axis) {
    axis.direction = read_direction(item.at("direction"));
    if (units.is_rotary)
        axis.point_mm =
            Eigen::Vector3d(item.at("point_mm").numbers(3, units::mm.either_sign()).data());
    if (const auto mount = item.find("mount"))
        axis.previous_from_mount = read_mount(*mount);
    const auto [low, high] = units.interval(item.at(units.key("travel")));
    axis.low = low;
    axis.high = high;
    const Value speed = item.at(units.key("speed"));
    axis.speed = speed.number((units.is_rotary ? units::deg_per_s : units::mm_per_s).positive()) *
                 units.per_large();
    axis.zero =
        optional_number(item, units.key("zero"), units.large().either_sign(), units.per_large())
            .value_or(0.0);
    if (const auto map = item.find("error_map"))
        read_errors(*map, axis);
    axis.backlash = small_size(item, "backlash", units).value_or(0.0);
    if (const auto approach = item.find("approach"))
        read_approach(*approach, units, axis);
}

void read_uncertainties(const Value& item, const AxisUnits& units, Axis& axis) {
    axis.scale_uncertainty =
        optional_number(item, "scale_uncertainty_ppm", units::ppm.non_negative(), 1e-6);
    axis.repeatability = small_size(item, "repeatability", units);
    axis.backlash_uncertainty = small_size(item, "backlash_uncertainty", units);
    axis.read_noise = small_size(item, "read_noise", units);
    axis.direction_uncertainty =
        optional_number(item, "direction_uncertainty_urad", units::urad.non_negative(), 1e-6);
    if (units.is_rotary)
        axis.point_uncertainty =
            optional_number(item, "point_uncertainty_um", units::um.non_negative(), 1e-3);
}

Axis read_axis(const Value& item) {
    Axis axis;
    axis.name = item.at("name").text();
    if (axis.name.empty())
        item.at("name").fail("must not be empty");
    const bool is_rotary = item.at("kind").one_of({"linear", "rotary"}) == "rotary";
    axis.kind = is_rotary ? Axis::Kind::rotary : Axis::Kind::linear;
    const AxisUnits units(axis.kind);
    read_controller(item, units, axis);
    read_geometry(item, units, axis);
    read_uncertainties(item, units, axis);
    return axis;
}

}  // namespace

std::array<double, 2> AxisUnits::interval(const Value& value) const {
    const std::vector<double> ends = value.numbers(2, large().either_sign());
    if (ends[0] >= ends[1])
        value.fail(
            fmt::format("must be [low, high] with low < high, not [{}, {}]", ends[0], ends[1]));
    return {ends[0] * per_large(), ends[1] * per_large()};
}

std::string as_typed(const Axis& axis, double value) {
    return axis.kind == Axis::Kind::linear ? fmt::format("{:.6g} mm", value)
                                           : fmt::format("{:.6g} deg", value / rad_per_deg);
}

std::vector<Axis> read_axes(const Value& list) {
    std::vector<Axis> axes;
    for (const Value& item : list.items()) {
        axes.push_back(read_axis(item));
        for (std::size_t i = 0; i + 1 < axes.size(); ++i) {
            if (axes[i].name == axes.back().name)
                item.at("name").fail("two axes are called '" + axes[i].name + "'");
        }
    }
    if (axes.empty())
        list.fail("must have at least one axis");
    return axes;
}

void require_same_count(std::size_t axes, std::size_t positions, const SourcePlace& place) {
    if (axes != positions)
        throw ConfigError(place, fmt::format("{} positions for {} axes", positions, axes));
}

void require_within_limits(std::span<const Axis> axes, std::span<const double> positions,
                           const SourcePlace& place) {
    require_same_count(axes.size(), positions.size(), place);
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const Axis& axis = axes[i];
        if (!(positions[i] >= axis.low && positions[i] <= axis.high))
            throw ConfigError(
                place, fmt::format("axis {} at {} is outside its soft limits {} to {}", axis.name,
                                   as_typed(axis, positions[i]), as_typed(axis, axis.low),
                                   as_typed(axis, axis.high)));
    }
}

}  // namespace etalon
