#include "mocks/stage/simulated_stage_options.h"

#include <fmt/format.h>

#include <cmath>

#include "core/time/clock.h"

namespace etalon {
namespace {

bool is_usable(const StageFault& fault, std::size_t axes) {
    const bool alarm_fits =
        fault.kind != StageFault::Kind::alarm || (fault.code >= 1 && fault.code <= 65535);
    return fault.axis < axes && fault.at.value >= 0 && std::isfinite(fault.size) && alarm_fits;
}

void require_options(const std::vector<Axis>& axes, const SimulatedStageOptions& options) {
    const SourcePlace place{"simulated stage"};
    if (axes.empty())
        throw ConfigError(place, "needs at least one axis");
    if (!options.errors.empty())
        require_usable(options.errors, axes);
    if (!options.servos.empty() && options.servos.size() != axes.size())
        throw ConfigError(place,
                          fmt::format("{} servos for {} axes", options.servos.size(), axes.size()));
    for (const auto& servo : options.servos)
        if (servo && !(servo->window > 0.0 && std::isfinite(servo->window)))
            throw ConfigError(place, "a servo's window must be finite and more than 0");
    if (!options.power_on_position.empty())
        require_within_limits(axes, options.power_on_position, place);
    if (options.ramp.count() <= 0 || options.homing.count() < 0 || options.jerk.count() < 0)
        throw ConfigError(place, "the ramp must be longer than 0 ms, homing and jerk not negative");
    const StageTemperature& temperature = options.temperature;
    if (!(std::isfinite(temperature.change) && std::isfinite(temperature.time_constant) &&
          temperature.time_constant > 0.0))
        throw ConfigError(place, "the temperature's time constant must be more than 0 s");
    for (const StageFault& fault : options.faults)
        if (!is_usable(fault, axes.size()))
            throw ConfigError(place, "a fault of an axis, at a time, or with a size that is none");
}

}  // namespace

SimulatedStageOptions complete(SimulatedStageOptions options, const std::vector<Axis>& axes) {
    require_options(axes, options);
    options.errors.resize(axes.size());
    options.power_on_position.resize(axes.size(), 0.0);
    options.servos.resize(axes.size());
    return options;
}

std::vector<StageController> controllers_of(const std::vector<Axis>& axes) {
    std::vector<StageController> controllers;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        if (i == 0 || axes[i].unit != axes[i - 1].unit)
            controllers.push_back({axes[i].unit, i, 0});
        ++controllers.back().count;
    }
    return controllers;
}

AxisDynamics dynamics_of(const SimulatedStageOptions& options, const std::vector<Axis>& axes,
                         std::size_t axis) {
    const auto in_seconds = [](Duration time) {
        return std::chrono::duration<double>(time).count();
    };
    AxisDynamics dynamics{.acceleration = axes[axis].speed / in_seconds(options.ramp)};
    if (options.jerk.count() > 0)
        dynamics.jerk = dynamics.acceleration / in_seconds(options.jerk);
    if (const auto& servo = options.servos[axis]) {
        dynamics.servo = servo->parameters;
        dynamics.window = servo->window;
    }
    return dynamics;
}

}  // namespace etalon
