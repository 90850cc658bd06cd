// What a motor and the structure behind it make of a planned motion: lag, overshoot, a ringing
// carriage.
//
//   drive       w' = (r - w) / lag                                     r: the planned motion
//   motor       e'' = ws^2 (w - e) - 2 zs ws e'                        e: what the encoder sees
//   carriage    c'' = wr^2 (e - c) + 2 zr wr (e' - c')                 c: where the carriage is
//
// The carriage does not pull the stiff motor back. Positions mm or rad, times seconds. Linear
// dynamics x' = A x + b u(t) without discretisation error: u is a cubic of time, the state after it
// one matrix exponential of A beside the chain of u's derivatives (Van Loan, IEEE Trans. Automatic
// Control 23, 1978).
#pragma once

#include <Eigen/Core>
#include <limits>
#include <vector>

namespace etalon {

// A controller's planned motion of one axis: pieces of constant jerk, with an infinite one the
// trapezoid, with a finite one the S-curve of at most seven pieces (Biagiotti and Melchiorri,
// "Trajectory Planning for Automatic Machines and Robots", Springer 2008, 3.4).

struct MotionLimits {
    double speed = 0.0, acceleration = 0.0;                 // > 0, finite
    double jerk = std::numeric_limits<double>::infinity();  // > 0
};

// position + velocity s + acceleration s^2 / 2 + jerk s^3 / 6 for s seconds since its start.
struct MotionPiece {
    double duration = 0.0;
    double position = 0.0, velocity = 0.0, acceleration = 0.0, jerk = 0.0;

    MotionPiece after(double s) const;  // what is left of it
};

class Motion {
public:
    Motion() : Motion(0.0) {}         // at rest at 0
    explicit Motion(double rest_at);  // at rest

    // From rest to rest. A short move reaches neither the speed nor the acceleration. As fast as
    // the limits allow.
    static Motion between(double from, double to, const MotionLimits& limits);

    // To rest, as soon as the limits allow. |acceleration| <= limits.acceleration; it does not
    // matter when the jerk is infinite. The speed limit does not matter.
    static Motion braking(double from, double velocity, double acceleration,
                          const MotionLimits& limits);

    // What is left of it t seconds after its start; before it and after its end at rest.
    MotionPiece at(double t) const;
    double position(double t) const { return at(t).position; }

    double duration() const { return duration_; }
    double start() const { return start_; }
    double end() const { return end_; }
    const std::vector<MotionPiece>& pieces() const { return pieces_; }

private:
    void append(double duration, double acceleration, double jerk);

    double start_, end_;
    double duration_ = 0.0;
    double velocity_ = 0.0;  // at the end of the last piece
    std::vector<MotionPiece> pieces_;
};

// Small and without memory of the heap: at most 12 rows.
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 12, 12>;
using SmallVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 12, 1>;

// exp(m) - 1 of a square matrix, finite, whose exponential does not overflow (else NumericalError);
// in exp(m) a slow part beside a fast one would be lost in the 1. States should be scaled so that
// the entries of a row are as large as the rate of its state.
SmallMatrix exponential_minus_one(const SmallMatrix& m);

// Frequencies are natural frequencies, damping ratios relative to critical damping. All finite and
// > 0, except that a lag of 0 and a resonance of 0 Hz leave that part out.
struct ServoParameters {
    double drive_lag = 0.0;      // s
    double bandwidth_hz = 50.0;  // of the motor's loop
    double damping = 0.7;
    double resonance_hz = 0.0;  // of the carriage on its guide
    double resonance_damping = 0.02;
};

class Servo {
public:
    using State = SmallVector;

    // Throws NumericalError naming a parameter out of its range.
    explicit Servo(const ServoParameters& parameters);

    State at_rest(double position) const;

    // The motor stands from now on, as if jammed, while the carriage swings on behind it. The
    // motion that follows should rest there.
    State with_motor_stopped(State state) const;

    // The state at `to` seconds of the motion, given that at `from`; 0 <= from <= to. One matrix
    // exponential per piece in between.
    State advance(const State& state, const Motion& motion, double from, double to) const;

    double motor(const State& state) const { return state(motor_); }
    double carriage(const State& state) const { return state(carriage_); }

private:
    // `seconds` >= 0 after `state`, with u(s) the position of `piece` at s. About 10 us.
    State advance(const State& state, const MotionPiece& piece, double seconds) const;

    SmallMatrix a_;                  // 1/s
    SmallVector b_;                  // 1/s
    Eigen::Index motor_, carriage_;  // their places in the state
};

}  // namespace etalon
