// A camera's codes as the radiances at which they step: one look-up and one comparison a pixel, or
// none where the curve is smooth (PiecewisePolynomial). Cells of floats, by exponent and first bits
// of the mantissa, hold one step or none.
#pragma once

#include <cmath>
#include <functional>
#include <vector>

#include "sim/sensor/sensor_simd.h"

namespace etalon {

// `steps`, fewer than 2^bits, ascending: number c is the least radiance whose code is above c. A
// quartic through five steps is taken when it rises all over its piece and misses no step, and none
// of the codes at its ends, by `doubt` less the rounding of L and t: right at every float not in
// doubt, and at every radiance that rounds to one.
PiecewisePolynomial fit_pieces(const std::vector<double>& steps, int bits);

// Safe from every thread once built.
class QuantizationThresholds {
public:
    // `code_of` gives whole codes 0..2^bits - 1 for every finite radiance and never falls;
    // `step_near` about where the code above `code` begins: the nearer, the sooner it is found.
    // Bits 1..16: 16 bits of Rec. 709 take 15 ms and 5 MB, 12 bits 1 ms and 0.3 MB.
    QuantizationThresholds(int bits, const std::function<double(double radiance)>& code_of,
                           const std::function<double(int code)>& step_near);

    // code_of(radiance), exactly; finite.
    std::uint16_t code_at(double radiance) const;

    // The codes of up to `max_at_once` radiances; `values` are these, or the nearest floats
    // (`is_rounded`); `radiance_at(i)` in double. False, and any codes, where one is not finite.
    static constexpr int max_at_once = 512;
    template <class Code, class RadianceAt>
    bool put_codes(const float* values, bool is_rounded, int count, const RadianceAt& radiance_at,
                   Code* codes) const {
        std::uint16_t doubtful[max_at_once];
        const int doubts =
            step_codes(cells_, entries_.data(), values, is_rounded, count, codes, doubtful);
        for (int i = 0; i < doubts; ++i) {
            const double radiance = radiance_at(doubtful[i]);
            if (!std::isfinite(radiance))
                return false;
            codes[doubtful[i]] = static_cast<Code>(code_near(codes[doubtful[i]], radiance));
        }
        return true;
    }

private:
    // code_at(), sooner when it is the guess or beside it.
    std::uint16_t code_near(int guess, double radiance) const;
    void add_cells(const std::vector<std::int32_t>& across, std::ptrdiff_t code, int direction);

    std::vector<double> steps_;  // [c]: the least radiance whose code is above c; ascending, finite
    StepCells cells_;
    std::vector<std::uint32_t> entries_;
};

}  // namespace etalon
