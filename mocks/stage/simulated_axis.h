// The physics of one axis: the controller's planned motion, the servo that follows it, the carriage
// with its errors. Closed forms of the time since the last command (servo: one matrix exponential
// per piece of motion). Whether a command is allowed is the caller's business
// (mocks/stage/simulated_stage.h). Times are seconds since power-on and never go back. Positions mm
// or rad.
#pragma once

#include "sim/twin/servo.h"
#include "stage/axes/axes.h"

namespace etalon {

// How a carriage differs from its encoder, and the encoder from a ruler. Temperatures are K from
// power-on. Of one axis, at the position m of its motor; all finite:
//     true = m (1 + scale + expansion T) + drift T + periodic sin(2 pi m / period + phase)
//            + what the map says + what is drawn for each move + backlash + what other axes lean
//            this way
struct AxisErrors {
    double scale = 0.0;           // relative; 0.002 = 0.2 % too far
    double repeatability = 0.0;   // standard deviation, drawn again for each move; >= 0
    double backlash = 0.0;        // >= 0; the carriage is that much above when it came from above
    double periodic = 0.0;        // amplitude, of a screw's turn or a scale's division
    double period = 1.0;          // > 0
    double phase = 0.0;           // rad
    double expansion = 0.0;       // relative per K
    double drift = 0.0;           // per K
    double encoder_noise = 0.0;   // standard deviation of each reading; >= 0
    std::optional<ErrorMap> map;  // what an interferometer would find; its ends count beyond them
    // Out of square: how far the carriage goes along each of the axes, in their order, per way
    // along this one, rad. Empty: 0. Between linear axes only.
    std::vector<double> lean;
};

// Warms up (or cools down) exponentially after power-on.
struct StageTemperature {
    double change = 0.0;         // K, in the end
    double time_constant = 1.0;  // s, > 0

    double at(double seconds) const;  // K, 0 at power-on
};

// true - m without what depends on the way there (drawn, backlash) and on other axes.
double error_at(const AxisErrors& errors, double motor, double kelvin);

// Adds what each axis leans towards the others. One entry of `errors` per position.
std::vector<double> with_lean(const std::vector<AxisErrors>& errors, std::vector<double> positions);

// Backlash: where in its gap the carriage is, 0 (pushed from below) to `backlash` (from above),
// after the motor has gone `way` in one direction.
double play_after(double play, double way, double backlash);

// Throws ConfigError at "simulated stage" for a value out of range, or a lean that does not fit.
void require_usable(const std::vector<AxisErrors>& errors, const std::vector<Axis>& axes);

// How an axis follows its plan.
struct AxisServo {
    ServoParameters parameters;
    double window = 0.0;  // "in position" within so much of the target; mm or rad, > 0
};

struct AxisDynamics {
    double acceleration = 1.0;                              // > 0
    double jerk = std::numeric_limits<double>::infinity();  // > 0
    std::optional<AxisServo> servo;                         // nothing: follows its plan exactly
};

class SimulatedAxis {
public:
    // At rest. Throws NumericalError for a servo that cannot be.
    SimulatedAxis(const AxisDynamics& dynamics, const AxisErrors& errors, double rest_at)
        : dynamics_(dynamics), errors_(errors), motion_(rest_at), target_(rest_at) {
        if (dynamics.servo) {
            servo_.emplace(dynamics.servo->parameters);
            state_ = servo_->at_rest(rest_at);
        }
    }

    // From rest to `target` as the encoder counts it. `drawn_error` is taken on along the way.
    void move_to(double target, double speed, double drawn_error, double t) {
        const double from = motion_.end(), to = target - encoder_offset_;
        target_ = target;
        plan(Motion::between(from, to, {speed, dynamics_.acceleration, dynamics_.jerk}),
             to == from ? drawn(t) : drawn_error, t);
    }

    // The same, to where the motor truly is at `zero`; the encoder counts right from now on.
    void find_zero(double zero, double speed, double drawn_error, double t) {
        encoder_offset_ = 0.0;
        move_to(zero, speed, drawn_error, t);
    }

    void brake(double t) {
        const double s = since_start(t);
        plan(
            Motion::braking(motion_.position(s), motion_.at(s).velocity, motion_.at(s).acceleration,
                            {1.0, dynamics_.acceleration, dynamics_.jerk}),
            drawn(t), t);
    }

    // Stops dead. Until the next command it claims to move.
    void seize(double t) {
        plan(Motion(motor(t)), drawn(t), t);
        if (servo_)
            state_ = servo_->with_motor_stopped(state_);
        stuck_ = true;
    }

    // The encoder reads so much more from now on; nothing moves.
    void jump_encoder(double size) { encoder_offset_ += size; }

    double target() const { return target_; }
    // Its planned motion is not over, or it is stuck.
    bool runs(double t) const { return stuck_ || since_start(t) < motion_.duration(); }
    double ends() const { return started_ + motion_.duration(); }  // when that will be, if not
    bool is_at_target(double t) const {
        constexpr double rounding = 1e-9;
        const double window = dynamics_.servo ? dynamics_.servo->window : rounding;
        return std::abs(encoder(t) - target_) <= window;
    }
    double encoder(double t) const { return motor(t) + encoder_offset_; }  // without noise
    double true_position(double t, double kelvin) const {
        const double carriage =
            servo_ ? servo_->carriage(servo_state(t)) : motion_.position(since_start(t));
        return carriage + error_at(errors_, carriage, kelvin) + drawn(t) + play(t);
    }

private:
    double since_start(double t) const { return t - started_; }
    Servo::State servo_state(double t) const {
        return servo_->advance(state_, motion_, 0.0, since_start(t));
    }
    double motor(double t) const {
        return servo_ ? servo_->motor(servo_state(t)) : motion_.position(since_start(t));
    }
    double play(double t) const {
        return play_after(play_, motion_.position(since_start(t)) - motion_.start(),
                          errors_.backlash);
    }
    double drawn(double t) const {
        const double way = motion_.end() - motion_.start();
        const double done =
            way == 0.0 ? 1.0 : (motion_.position(since_start(t)) - motion_.start()) / way;
        return drawn_before_ + done * (drawn_after_ - drawn_before_);
    }
    void plan(const Motion& motion, double drawn_after, double t) {
        // The state of everything that has a memory at t becomes the new beginning.
        if (servo_)
            state_ = servo_state(t);
        play_ = play(t);
        drawn_before_ = drawn(t);
        drawn_after_ = drawn_after;
        motion_ = motion;
        started_ = t;
        stuck_ = false;
    }

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
