// How a stage's carriage differs from what its encoders say, and the encoders from a ruler: the
// errors that a laboratory finds with an interferometer, as closed forms. Lengths are mm, angles
// rad, temperatures K from power-on. Pure functions.
#pragma once

#include <optional>
#include <vector>

#include "stage/axes/axes.h"
#include "stage/axes/error_map.h"

namespace etalon {

// Of one axis, at the position m of its motor; all finite:
//     true = m (1 + scale + expansion T) + drift T + periodic sin(2 pi m / period + phase)
//            + what the map says + what is drawn for each move + backlash + what other axes lean
//            this way
struct AxisErrors {
    double scale = 0.0;           // relative; 0.002 = 0.2 % too far
    double repeatability = 0.0;   // standard deviation, drawn anew for each move; >= 0
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

// Lost motion: where in its gap the carriage is, 0 (pushed from below) to `backlash` (from above),
// after the motor has gone `way` in one direction.
double play_after(double play, double way, double backlash);

// Throws ConfigError at "simulated stage" for a value out of range, or a lean that does not fit.
void require_usable(const std::vector<AxisErrors>& errors, const std::vector<Axis>& axes);

}  // namespace etalon
