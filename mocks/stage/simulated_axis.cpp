#include "mocks/stage/simulated_axis.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace etalon {
namespace {

bool is_usable(const AxisErrors& e) {
    const bool signed_ones_finite =
        std::isfinite(e.scale + e.periodic + e.phase + e.expansion + e.drift);
    const bool others_finite =
        std::isfinite(e.repeatability + e.backlash + e.period + e.encoder_noise);
    return signed_ones_finite && others_finite && e.repeatability >= 0.0 && e.backlash >= 0.0 &&
           e.period > 0.0 && e.encoder_noise >= 0.0;
}

void require_lean(const std::vector<Axis>& axes, std::size_t axis,
                  const std::vector<double>& lean) {
    const SourcePlace place{"simulated stage"};
    if (!lean.empty() && lean.size() != axes.size())
        throw ConfigError(place, fmt::format("axis '{}': lean towards {} of {} axes",
                                             axes[axis].name, lean.size(), axes.size()));
    for (std::size_t i = 0; i < lean.size(); ++i) {
        const bool possible = i != axis && axes[axis].kind == Axis::Kind::linear &&
                              axes[i].kind == Axis::Kind::linear && std::isfinite(lean[i]);
        if (lean[i] != 0.0 && !possible)
            throw ConfigError(place, fmt::format("axis '{}' cannot lean towards '{}'",
                                                 axes[axis].name, axes[i].name));
    }
}

double error_on_map(const ErrorMap& map, double motor) {
    const auto& points = map.points();
    return map.at(std::clamp(motor, points.front().position, points.back().position))->error;
}

}  // namespace

double StageTemperature::at(double seconds) const {
    return seconds > 0.0 ? -change * std::expm1(-seconds / time_constant) : 0.0;
}

double error_at(const AxisErrors& errors, double motor, double kelvin) {
    const double turns = motor / errors.period;
    const double mapped = errors.map ? error_on_map(*errors.map, motor) : 0.0;
    return mapped + motor * (errors.scale + errors.expansion * kelvin) + errors.drift * kelvin +
           errors.periodic * std::sin(2.0 * std::numbers::pi * turns + errors.phase);
}

std::vector<double> with_lean(const std::vector<AxisErrors>& errors,
                              std::vector<double> positions) {
    const std::vector<double> upright = positions;
    for (std::size_t from = 0; from < errors.size(); ++from)
        for (std::size_t to = 0; to < errors[from].lean.size(); ++to)
            positions[to] += errors[from].lean[to] * upright[from];
    return positions;
}

double play_after(double play, double way, double backlash) {
    return std::clamp(play - way, 0.0, backlash);
}

void require_usable(const std::vector<AxisErrors>& errors, const std::vector<Axis>& axes) {
    const SourcePlace place{"simulated stage"};
    if (errors.size() != axes.size())
        throw ConfigError(place,
                          fmt::format("{} axis errors for {} axes", errors.size(), axes.size()));
    for (std::size_t i = 0; i < axes.size(); ++i) {
        if (!is_usable(errors[i]))
            throw ConfigError(place, fmt::format("axis '{}': errors out of range", axes[i].name));
        require_lean(axes, i, errors[i].lean);
    }
}

}  // namespace etalon
