#include "stage/axes.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

namespace etalon {
namespace {

constexpr double rad_per_deg = std::numbers::pi / 180.0;

Eigen::Vector3d read_direction(const Value& value) {
    const std::vector<double> numbers = value.numbers(3);
    const Eigen::Vector3d direction(numbers[0], numbers[1], numbers[2]);
    const double length = direction.stableNorm();
    if (!(length > 0.0) || !std::isfinite(length))
        value.fail("must be a direction, not zero");
    return (direction / length).normalized();
}

void read_travel(const Value& value, double unit, Axis& axis) {
    const std::vector<double> travel = value.numbers(2);
    if (travel[0] >= travel[1])
        value.fail(
            fmt::format("must be [low, high] with low < high, not [{}, {}]", travel[0], travel[1]));
    axis.low = travel[0] * unit;
    axis.high = travel[1] * unit;
}

void read_linear(const Value& item, Axis& axis) {
    axis.kind = Axis::Kind::linear;
    read_travel(item.at("travel"), 1.0, axis);
    axis.speed = item.at("speed").number(positive);
    if (const auto value = item.find("repeatability_um"))
        axis.repeatability = value->number(non_negative) * 1e-3;
}

void read_rotary(const Value& item, Axis& axis) {
    axis.kind = Axis::Kind::rotary;
    const std::vector<double> point = item.at("point_mm").numbers(3);
    axis.point_mm = {point[0], point[1], point[2]};
    read_travel(item.at("travel_deg"), rad_per_deg, axis);
    axis.speed = item.at("speed_deg").number(positive) * rad_per_deg;
    if (const auto value = item.find("repeatability_deg"))
        axis.repeatability = value->number(non_negative) * rad_per_deg;
}

Axis read_axis(const Value& item) {
    Axis axis;
    axis.name = item.at("name").text();
    if (axis.name.empty())
        item.at("name").fail("must not be empty");
    axis.direction = read_direction(item.at("direction"));
    if (item.at("kind").one_of({"linear", "rotary"}) == "linear")
        read_linear(item, axis);
    else
        read_rotary(item, axis);
    if (const auto value = item.find("scale_uncertainty_ppm"))
        axis.scale_uncertainty = value->number(non_negative) * 1e-6;
    return axis;
}

Rigid motion(const Axis& axis, double position) {
    if (axis.kind == Axis::Kind::linear)
        return {Eigen::Quaterniond::Identity(), axis.direction * position};
    const Eigen::Quaterniond turn = rotation_from_vector(axis.direction * position);
    return {turn, axis.point_mm - turn * axis.point_mm};
}

// In the unit that people type: mm or degrees.
std::string as_typed(const Axis& axis, double value) {
    return axis.kind == Axis::Kind::linear ? fmt::format("{:.6g} mm", value)
                                           : fmt::format("{:.6g} deg", value / rad_per_deg);
}

void require_same_count(std::size_t axes, std::size_t positions, const SourcePlace& place) {
    if (axes != positions)
        throw ConfigError(place, fmt::format("{} positions for {} axes", positions, axes));
}

}  // namespace

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

Rigid base_from_carriage(std::span<const Axis> axes, std::span<const double> positions) {
    require_same_count(axes.size(), positions.size(), {"stage axes"});
    Rigid base_from_moved;
    for (std::size_t i = 0; i < axes.size(); ++i)
        base_from_moved = base_from_moved * motion(axes[i], positions[i]);
    return base_from_moved;
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
