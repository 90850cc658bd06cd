// Stopping: every unit is told before any is asked, over fresh connections as long as there is
// time.
#include <algorithm>

#include "stage/motion/axis_signals.h"
#include "stage/motion/modbus_stage.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;

constexpr auto pause = 20ms;  // between attempts

}  // namespace

// All of stopping, fresh connections included.
Duration ModbusStage::stop_time() const {
    Duration time{};
    for (const Step& step : profile_.sequences.stop)
        time += step.within;
    return time;
}

bool ModbusStage::stop_by(Instant deadline) {
    for (;;) {
        if (stop_once(deadline))
            return true;
        if (clock_.now() + pause >= deadline)
            return false;
        clock_.wait_for(pause, {});
    }
}

// Steps after the confirmation only tidy up: the axes rest already.
bool ModbusStage::stop_once(Instant deadline) {
    bool told = true, confirmed = false;
    for (const Step& step : profile_.sequences.stop) {
        if (step.kind != Step::Kind::wait) {
            told = tell(step, deadline) && told;
        } else {
            if (!confirmed && !(told && confirm(step, deadline)))
                return false;
            confirmed = true;
        }
    }
    return confirmed;
}

// A stop is harmless to repeat, so it is written without reading back. A unit that does not answer,
// or a trace that cannot be written, keeps none of the others from being told.
bool ModbusStage::tell(const Step& step, Instant deadline) {
    bool all = true;
    for (StageUnit& unit : units_) {
        try {
            hurry_unit(deadline);
            unit.set_at_once(step.input, step.kind != Step::Kind::clear);
            if (step.kind == Step::Kind::pulse &&
                profile_.inputs.at(step.input).act != InputPoint::Act::code)
                unit.set_at_once(step.input, false);
        } catch (const std::exception&) {
            link_.close();
            all = false;
        }
    }
    return all;
}

bool ModbusStage::confirm(const Step& step, Instant deadline) {
    const auto rests = [&](const AxisStatus& axis) {
        return std::ranges::all_of(
            step.conditions, [&](const Condition& condition) { return holds(axis, condition); });
    };
    for (int resting = 0; resting < profile_.done.stable_polls;) {
        if (clock_.now() >= deadline)
            return false;
        link_.hurry(deadline);
        try {
            resting = std::ranges::all_of(poll(1), rests) ? resting + 1 : 0;
        } catch (const std::exception&) {
            link_.close();
            return false;
        }
        clock_.wait_for(poll_period, {});
    }
    return true;
}

// With several units a silent one may not use up the others' time.
void ModbusStage::hurry_unit(Instant deadline) {
    const Instant now = clock_.now();
    link_.hurry(now + (deadline - now) / static_cast<int>(units_.size()));
}

}  // namespace etalon
