// The inner loops of the sensor model, vectorised with Google Highway: the best instruction set of
// the machine is chosen at run time. Every set gives the same codes: each pixel's operations are
// those of the scalar formula, in double precision and one by one (none is fused), or in single
// precision where its rounding cannot change the code.
#pragma once

#include <cstdint>

namespace etalon {

// A sensor of linear transfer without noise, DN.
struct LinearSensor {
    double range;   // full scale less black
    double offset;  // black + 0.5: what is left after it is rounded down

    // floor(range min(p, 1) + offset), at least 0; p = radiance times response, finite. It is at
    // most full scale, because the rounding errors of the sum are far below 0.5.
    std::uint16_t code_of(double p) const {
        const double code = range * (p < 1.0 ? p : 1.0) + offset;
        return static_cast<std::uint16_t>(code > 0.0 ? code : 0.0);
    }
};

// Codes of `count` pixels; `response` may be null for 1. False, and codes without meaning, when a
// radiance is NaN or infinite. About 0.3 ns a pixel, a third of that where neighbours are equal.
bool linear_codes(LinearSensor sensor, const float* radiance, const float* response, int count,
                  std::uint8_t* codes);
bool linear_codes(LinearSensor sensor, const float* radiance, const float* response, int count,
                  std::uint16_t* codes);

// Of signals p, finite.
void linear_codes(LinearSensor sensor, const double* signals, int count, std::uint8_t* codes);
void linear_codes(LinearSensor sensor, const double* signals, int count, std::uint16_t* codes);

// Whether none of them is NaN or infinite.
bool all_finite(const float* values, int count);

}  // namespace etalon
