// A stage behind Modbus TCP or RTU: carries out the sequences of a profile
// (stage/profile/profile.h) on all units that drive its axes. What keeps it safe:
//
//   * targets are written in one block and read back, where the profile allows it, before the
//     start;
//   * a command for motion whose reply is missing is read back before it is given again. Where
//     reading back tells nothing it is not given again: the axes must be seen to start. Targets
//     are absolute, so even a late first command moves nothing further;
//   * an emergency stop, alarm or limit switch in any poll ends the run; so does a position that no
//     axis can have reached;
//   * after any failure the axes are stopped first, then the error goes on, and says whether the
//     controllers confirmed the stop;
//   * the controller's watchdog, where there is one, stops the axes when nobody is left to do it.
//
// One owner thread; trace() from any.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "stage/link/modbus_link.h"
#include "stage/motion/stage.h"
#include "stage/motion/stage_unit.h"
#include "stage/profile/profile.h"

namespace etalon {

class ModbusStage final : public Stage {
public:
    // Connects and reads the status once; commands nothing. Consecutive axes of the same unit are
    // one controller's. Throws ConfigError when the axes do not fit the profile (number, counts,
    // units) or the link's numbers are out of range, DeviceError when nobody answers. The clock
    // must outlive the stage. Without a transport libmodbus is taken.
    ModbusStage(const StageLink& link, StageProfile profile, std::vector<Axis> axes, Clock& clock,
                std::unique_ptr<ModbusTransport> transport = nullptr,
                Opening opening = Opening::asks);

    // Stops the axes if they were ever enabled by this object; leaves them enabled, since a
    // vertical axis may drop without its motor.
    ~ModbusStage() override;
    ModbusStage(const ModbusStage&) = delete;
    ModbusStage& operator=(const ModbusStage&) = delete;

    const std::vector<Axis>& axes() const override { return axes_; }

    // Also resets alarms that are left from before; one that stays is a DeviceError.
    void enable(std::stop_token stop) override;
    void home(std::stop_token stop) override;
    void resume() override;
    void take_for_homed() override { taken_for_homed_ = true; }
    void move(std::span<const double> target, std::stop_token stop) override;
    void limit_speed(double share) override;
    std::vector<double> position() override;
    std::vector<AxisStatus> status() override;
    bool stop() noexcept override;
    std::string trace() const override;
    void set_trace(std::function<void(const std::string&)> line) override;

private:
    // At most 200 polls a second.
    static constexpr std::chrono::milliseconds poll_period{5};

    enum class State { connected, enabled, homed, faulted };
    using Statuses = std::vector<AxisStatus>;

    // One sequence that is being carried out.
    struct Run {
        const char* request;          // "move", for errors
        std::vector<Condition> ends;  // end it as soon as a poll shows one of an axis
        std::stop_token stop;
        std::span<const double> target;  // of a move
        Statuses before;                 // when it began
        std::vector<bool> started;       // axes that were seen to start since then
        Statuses now;                    // the last poll
        Instant polled{};                // when that began
        bool fresh = false;              // nothing was written since then
    };

    // modbus_stage.cpp
    void require_usable(const char* request) const;
    void guarded(const std::function<void()>& action);
    Run begin(const char* request, std::vector<Condition> ends, std::stop_token stop);
    void require_left_alone(const char* request, const Statuses& axes) const;
    void require_own_commands(const Run& run);
    void require_homed(const Statuses& axes) const;
    void require_seen_to_home(const Run& run) const;
    bool is_stop_left_on() const;
    std::string describe(const Statuses& axes) const;

    // modbus_stage_run.cpp: sequences and waiting
    Statuses poll(int attempts = 3);
    void poll(Run& run);
    void carry_out(const std::vector<Step>& steps, Run& run);
    void give(const Step& step, Run& run);
    void give_to(StageUnit& unit, const Step& step, Run& run, std::size_t first_axis);
    void confirm_start(Run& run, std::size_t first_axis, std::size_t count);
    void require_conditions(const Step& step, Run& run);
    void wait(const Step& step, Run& run);
    void wait_done(Run& run);
    void wait_until(Run& run, const std::function<bool(const Statuses&)>& done, Duration held,
                    Duration limit);
    void check_plausible(const Run& run, const Statuses& axes, Instant now) const;
    bool has_started(const Run& run, const Statuses& axes, std::size_t axis) const;
    bool is_at(const AxisStatus& status, std::size_t axis, double target) const;
    Duration time_limit(const Run& run) const;
    void keep_watchdog(bool at_once);

    // modbus_stage_stop.cpp
    Duration stop_time() const;
    void hurry_unit(Instant deadline);
    bool stop_by(Instant deadline);
    bool stop_once(Instant deadline);
    bool tell(const Step& step, Instant deadline);
    bool confirm(const Step& step, Instant deadline);

    StageProfile profile_;
    std::vector<Axis> axes_;
    Clock& clock_;
    ModbusLink link_;
    std::vector<StageUnit> units_;  // in the order of the axes
    State state_ = State::connected;
    bool ever_enabled_ = false;  // by this object
    bool taken_for_homed_ = false;
    double speed_share_ = 1.0;     // of each axis' speed
    std::vector<double> left_at_;  // by the last homing or move; empty: unknown
    std::optional<Instant> watchdog_written_;
};

}  // namespace etalon
