#include "mocks/stage/simulated_axis.h"

#include <cmath>

namespace etalon {

SimulatedAxis::SimulatedAxis(const AxisDynamics& dynamics, const AxisErrors& errors, double rest_at)
    : dynamics_(dynamics), errors_(errors), motion_(rest_at), target_(rest_at) {
    if (dynamics.servo) {
        servo_.emplace(*dynamics.servo);
        state_ = servo_->at_rest(rest_at);
    }
}

// The state of everything that has a memory at t becomes the new beginning.
void SimulatedAxis::plan(const Motion& motion, double drawn_after, double t) {
    if (servo_)
        state_ = servo_state(t);
    play_ = play(t);
    drawn_before_ = drawn(t);
    drawn_after_ = drawn_after;
    motion_ = motion;
    started_ = t;
    stuck_ = false;
}

void SimulatedAxis::move_to(double target, double speed, double drawn_error, double t) {
    const double from = motion_.end(), to = target - encoder_offset_;
    target_ = target;
    plan(Motion::between(from, to, {speed, dynamics_.acceleration, dynamics_.jerk}),
         to == from ? drawn(t) : drawn_error, t);
}

void SimulatedAxis::find_zero(double zero, double speed, double drawn_error, double t) {
    encoder_offset_ = 0.0;
    move_to(zero, speed, drawn_error, t);
}

void SimulatedAxis::brake(double t) {
    const double s = since_start(t);
    plan(Motion::braking(motion_.position(s), motion_.at(s).velocity, motion_.at(s).acceleration,
                         {1.0, dynamics_.acceleration, dynamics_.jerk}),
         drawn(t), t);
}

void SimulatedAxis::seize(double t) {
    plan(Motion(motor(t)), drawn(t), t);
    if (servo_)
        state_ = servo_->with_motor_stopped(state_);
    stuck_ = true;
}

bool SimulatedAxis::runs(double t) const {
    return stuck_ || since_start(t) < motion_.duration();
}

bool SimulatedAxis::is_at_target(double t) const {
    return std::abs(encoder(t) - target_) <= dynamics_.window;
}

Servo::State SimulatedAxis::servo_state(double t) const {
    return servo_->advance(state_, motion_, 0.0, since_start(t));
}

double SimulatedAxis::motor(double t) const {
    return servo_ ? servo_->motor(servo_state(t)) : motion_.position(since_start(t));
}

double SimulatedAxis::encoder(double t) const {
    return motor(t) + encoder_offset_;
}

double SimulatedAxis::play(double t) const {
    return play_after(play_, motion_.position(since_start(t)) - motion_.start(), errors_.backlash);
}

double SimulatedAxis::drawn(double t) const {
    const double way = motion_.end() - motion_.start();
    const double done =
        way == 0.0 ? 1.0 : (motion_.position(since_start(t)) - motion_.start()) / way;
    return drawn_before_ + done * (drawn_after_ - drawn_before_);
}

double SimulatedAxis::true_position(double t, double kelvin) const {
    const double carriage =
        servo_ ? servo_->carriage(servo_state(t)) : motion_.position(since_start(t));
    return carriage + error_at(errors_, carriage, kelvin) + drawn(t) + play(t);
}

}  // namespace etalon
