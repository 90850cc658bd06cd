// A stage behind Modbus TCP or RTU, driven by a profile (stage/profile.h). What keeps it safe:
//
//   * status and position come from one request, so they belong together;
//   * targets are written in one block and read back before the start is given;
//   * a command whose reply is missing is read back before it is given again; targets are absolute
//     and the start is an edge of a level, so even a late first one moves nothing further;
//   * after any failure the axes are stopped first, then the error goes on, saying whether the
//     controller confirmed the stop;
//   * the controller's watchdog stops the axes when nobody is left to do it.
//
// One owner thread; trace() from any.
#pragma once

#include <functional>

#include "stage/modbus_link.h"
#include "stage/profile.h"
#include "stage/stage.h"

namespace etalon {

class ModbusStage final : public Stage {
public:
    // Connects and reads the status once; commands nothing. Throws ConfigError when the axes do not
    // fit the profile (number, counts beyond 32 bits) or the link's numbers are out of range,
    // DeviceError when nobody answers. The clock must outlive the stage. Without a transport
    // libmodbus is taken.
    ModbusStage(const StageLink& link, StageProfile profile, std::vector<Axis> axes, Clock& clock,
                std::unique_ptr<ModbusTransport> transport = nullptr);

    // Stops the axes if they were ever enabled by this object; leaves them enabled, since a
    // vertical axis may drop without its motor.
    ~ModbusStage() override;
    ModbusStage(const ModbusStage&) = delete;
    ModbusStage& operator=(const ModbusStage&) = delete;

    const std::vector<Axis>& axes() const override { return axes_; }

    // Also resets alarms that are left from before; one that stays is a DeviceError.
    void enable(std::stop_token stop) override;
    void home(std::stop_token stop) override;
    void move(std::span<const double> target, std::stop_token stop) override;
    void limit_speed(double share) override;
    std::vector<double> position() override;
    std::vector<AxisStatus> status() override;
    bool stop() noexcept override;
    std::string trace() const override;
    void set_trace(std::function<void(const std::string&)> line) override;

private:
    enum class State { connected, enabled, homed, faulted };
    using Done = std::function<bool(const std::vector<AxisStatus>&)>;

    void require_usable(const char* request) const;
    void guarded(const std::function<void()>& action);
    std::vector<AxisStatus> poll(int attempts = 3);
    std::vector<std::uint16_t> read(int address, int count, int attempts = 3);
    void write(int address, std::span<const std::uint16_t> values);
    void require_no_alarm(const std::vector<AxisStatus>& axes, const char* request) const;
    void require_healthy(const std::vector<AxisStatus>& axes, const char* request) const;
    void require_ready(const std::vector<AxisStatus>& axes) const;

    std::uint16_t command_word(std::initializer_list<int> bits) const;
    void set_command(std::initializer_list<int> bits);
    void write_and_verify(int address, const std::vector<std::uint16_t>& values);
    void keep_watchdog(bool at_once);
    void reset_alarms(std::stop_token stop);
    void write_targets(std::span<const double> target);
    void run_move(std::span<const double> target, std::stop_token stop);

    // Polls until `done`, at most until the limit; alarms and interruption throw at once.
    void wait_until(const Done& done, Duration limit, const char* request, std::stop_token stop);
    std::string describe(const std::vector<AxisStatus>& axes) const;
    bool is_at(const std::vector<AxisStatus>& axes, std::span<const double> target) const;
    Duration time_limit(const std::vector<AxisStatus>& axes, std::span<const double> target) const;

    void limit_requests_to(Instant deadline);
    bool stop_and_confirm(Instant deadline);
    bool stop_by(Instant deadline);

    StageLink link_settings_;
    StageProfile profile_;
    std::vector<Axis> axes_;
    Clock& clock_;
    ModbusLink link_;
    State state_ = State::connected;
    double speed_share_ = 1.0;  // of each axis' speed
    bool drives_on_ = false;      // the command register's enable bit, as last seen or written
    bool ever_enabled_ = false;   // by this object
    Instant watchdog_written_{};  // 0: never
};

}  // namespace etalon
