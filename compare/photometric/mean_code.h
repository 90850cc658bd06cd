// The mean of a sensor's code values, which is not the light's own value where the noise is small
// against a code: light at 16.3 codes with a noise of 0.17 codes is nearly always code 16. Dark
// cells of a camera with 8 bits are such places, and a lens' blur shows in what it spills there.
//
// A code is at least k where the linear signal s with its noise passes the threshold t_k at which
// the transfer curve reaches k - 1/2. Noise is normal (sim/sensor/sensor_model.h), so that
//     mean code = sum over k = 1 .. F of Phi((s - t_k) / sigma(s))
// exactly, with the ends of the scale and the curve's bend within it. The sawtooth about a straight
// line is 0.32 exp(-2 pi^2 sigma^2) codes high, sigma in codes: nothing beyond 0.6 (Widrow and
// Kollar, "Quantization Noise", Cambridge 2008, chapter 5, where a uniform quantiser's is derived).
#pragma once

#include <vector>

#include "calib/camera/camera_model.h"

namespace etalon {

// Made in some 5 ms for 8 bits. Safe from every thread.
class MeanCode {
public:
    // The codes are those of light itself: of a sensor whose noise is not stated, and beyond 10
    // bits, where rounding is below 0.06 gray however it falls.
    MeanCode() = default;
    explicit MeanCode(const Sensor& sensor);

    struct Point {
        double gray = 0.0, slope = 1.0;
        double by_log_noise = 0.0;  // gray: what a noise larger by the factor e would add, first order
    };
    // Of the gray that the light has without noise and rounding; any. Gray = code / F * 255.
    // Below 0.1 codes of noise the mean is a staircase, and that of 0.1 codes is given: steep, but
    // no step.
    Point at(double gray) const;

private:
    double codes_per_gray_ = 1.0;
    std::vector<double> mean_, by_log_noise_;  // in codes, from one code below 0 to one above F
};

}  // namespace etalon
