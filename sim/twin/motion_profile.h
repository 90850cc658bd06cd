// The motion that a stage's controller plans for one axis: pieces of constant jerk, so position is
// a cubic of time in each and known exactly at any time. With an infinite jerk the profile is the
// trapezoid of constant accelerations, with a finite one the S-curve of at most seven pieces
// (Biagiotti and Melchiorri, "Trajectory Planning for Automatic Machines and Robots", Springer
// 2008, 3.4). What the motor makes of it is sim/twin/servo.h.
//
// Positions are mm or rad, times seconds. Pure functions of their arguments.
#pragma once

#include <limits>
#include <vector>

namespace etalon {

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

    // At t seconds after its start; before it the start, after its end the end, both at rest.
    double position(double t) const;
    double velocity(double t) const;
    double acceleration(double t) const;

    double duration() const { return duration_; }
    double start() const { return start_; }
    double end() const { return end_; }
    const std::vector<MotionPiece>& pieces() const { return pieces_; }

private:
    void append(double duration, double acceleration, double jerk);
    MotionPiece at(double t) const;

    double start_, end_;
    double duration_ = 0.0;
    double velocity_ = 0.0;  // at the end of the last piece
    std::vector<MotionPiece> pieces_;
};

}  // namespace etalon
