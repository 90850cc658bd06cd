// A stage without motion or device, for unit tests of whatever drives one: every move arrives at
// once, and failures happen when the test says so. For one thread.
#pragma once

#include "stage/motion/stage.h"

namespace etalon {

class FakeStage final : public Stage {
public:
    explicit FakeStage(std::vector<Axis> axes);

    const std::vector<Axis>& axes() const override { return axes_; }
    void enable(std::stop_token stop) override;
    void home(std::stop_token stop) override;
    void resume() override;
    void move(std::span<const double> target, std::stop_token stop) override;
    void limit_speed(double share) override { speed_share_ = share; }
    std::vector<double> position() override;
    std::vector<AxisStatus> status() override;
    bool stop() noexcept override;

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
    std::vector<Axis> axes_;
    std::vector<double> position_;
    double speed_share_ = 1.0;
    bool enabled_ = false, homed_ = false;
};

}  // namespace etalon
