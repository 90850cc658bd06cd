// A stage without motion or device, for unit tests of whatever drives one: every move arrives at
// once, and failures happen when the test says so. For one thread.
#pragma once

#include "stage/motion/stage.h"
#include "stage/motion/stage_unit.h"

namespace etalon {

class FakeStage : public Stage {
public:
    explicit FakeStage(std::vector<Axis> axes) : axes_(std::move(axes)), position_(axes_.size()) {}

    const std::vector<Axis>& axes() const override { return axes_; }
    void enable(std::stop_token stop) override {
        require_going_on(stop);
        enabled_ = true;
    }
    void home(std::stop_token stop) override {
        require_going_on(stop);
        require(enabled_, "home", "the axes are not enabled");
        homed_ = true;
        position_.assign(axes_.size(), 0.0);
    }
    void resume() override { require(enabled_ && homed_, "resume", "the axes are not homed"); }
    void move(std::span<const double> target, std::stop_token stop) override {
        require(homed_, "move", "the axes are not homed");
        require_within_limits(axes_, target, {"fake stage", 0, "move"});
        require_going_on(stop);
        moves.emplace_back(target.begin(), target.end());
        speed_shares.push_back(speed_share_);
        if (before_move)
            before_move(target);
        position_.assign(target.begin(), target.end());
        for (std::size_t i = 0; i < read_back_error.size() && i < position_.size(); ++i)
            position_[i] += read_back_error[i];
    }
    void limit_speed(double share) override { speed_share_ = share; }
    std::vector<double> position() override {
        const std::vector<AxisStatus> axes = status();
        static const StageProfile profile;
        const std::string cause =
            disturbance(axes_, axes, std::array{pressed, at_limit, alarmed}, profile);
        require(cause.empty(), "read the positions", cause.c_str());
        std::vector<double> positions;
        for (const AxisStatus& axis : axes)
            positions.push_back(axis.position);
        return positions;
    }
    std::vector<AxisStatus> status() override {
        std::vector<AxisStatus> axes;
        for (const double position : position_)
            axes.push_back({enabled_, homed_, false, true, 0, position});
        if (on_status)
            on_status(axes);
        return axes;
    }
    bool stop() noexcept override {
        ++stops;
        return true;
    }

    // What happened so far.
    int stops = 0;
    std::vector<std::vector<double>> moves;  // targets, in order
    std::vector<double> speed_shares;        // of each move

    // Called in move() before it arrives; throws what the move is to fail with.
    std::function<void(std::span<const double> target)> before_move;

    // Called in status() and changes what it tells: an alarm, a pressed emergency stop.
    std::function<void(std::vector<AxisStatus>&)> on_status;

    // Added to the target to give the position that is read back; empty: nothing.
    std::vector<double> read_back_error;

private:
    static void require(bool condition, const char* request, const char* cause) {
        if (!condition)
            throw DeviceError("fake stage", request, cause);
    }

    static void require_going_on(const std::stop_token& stop) {
        if (stop.stop_requested())
            throw Interrupted();
    }

    std::vector<Axis> axes_;
    std::vector<double> position_;
    double speed_share_ = 1.0;
    bool enabled_ = false, homed_ = false;
};

}  // namespace etalon
