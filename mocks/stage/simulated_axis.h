// The physics of one axis: the motion that its controller plans, the servo that follows it, the
// carriage with its errors. Everything is a closed form of the time since the last command (of the
// servo: one matrix exponential per piece of motion); nothing is integrated step by step.
//
// Not a controller: whether a command is allowed is its caller's business
// (mocks/stage/simulated_stage.h). Times are seconds since power-on, and never before that of the
// last command. Positions mm or rad.
#pragma once

#include <limits>
#include <optional>

#include "mocks/stage/stage_errors.h"
#include "sim/twin/servo.h"

namespace etalon {

struct AxisDynamics {
    double acceleration = 1.0;                              // > 0
    double jerk = std::numeric_limits<double>::infinity();  // > 0
    std::optional<ServoParameters> servo;                   // nothing: follows its plan exactly
    double window = 1e-9;  // "in position" within so much of the target; > 0
};

class SimulatedAxis {
public:
    // At rest. Throws NumericalError for a servo that cannot be.
    SimulatedAxis(const AxisDynamics& dynamics, const AxisErrors& errors, double rest_at);

    // From rest to `target` as the encoder counts it. `drawn` is this move's own error, taken on
    // along the way.
    void move_to(double target, double speed, double drawn, double t);

    // The same, to where the motor truly is at `zero`; the encoder counts right from now on.
    void find_zero(double zero, double speed, double drawn, double t);

    void brake(double t);

    // Stops dead. Until the next command it claims to move.
    void seize(double t);

    // The encoder reads so much more from now on; nothing moves.
    void jump_encoder(double size) { encoder_offset_ += size; }

    double target() const { return target_; }
    bool runs(double t) const;  // its planned motion is not over, or it is stuck
    double ends() const { return started_ + motion_.duration(); }  // when that will be, if not
    bool is_at_target(double t) const;
    double encoder(double t) const;  // without noise
    double true_position(double t, double kelvin) const;

private:
    double since_start(double t) const { return t - started_; }
    Servo::State servo_state(double t) const;
    double motor(double t) const;
    double play(double t) const;
    double drawn(double t) const;
    void plan(const Motion& motion, double drawn, double t);

    AxisDynamics dynamics_;
    AxisErrors errors_;
    std::optional<Servo> servo_;

    // As of the last command.
    Motion motion_;
    double started_ = 0.0;
    Servo::State state_;
    double play_ = 0.0;
    double drawn_before_ = 0.0, drawn_after_ = 0.0;  // over the motion

    double target_;
    double encoder_offset_ = 0.0;
    bool stuck_ = false;
};

}  // namespace etalon
