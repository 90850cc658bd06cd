// A camera's code values as the radiances at which they step: the exact transfer curve, evaluated
// once per camera instead of once per pixel.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

namespace etalon {

// Safe from every thread once built.
class SensorSteps {
public:
    // `code_of` gives whole codes 0..2^bits - 1 for every finite radiance and never falls. Bits
    // 1..16. Calls it 64 times a code: 8 bits cost about 0.5 ms of Rec. 709, 12 bits 8 ms.
    SensorSteps(int bits, const std::function<double(double)>& code_of);

    // code_of(radiance), exactly; finite.
    std::uint16_t code_at(double radiance) const {
        if (radiance < -1.0)
            return code_below_cells(radiance);
        // Rounded towards 0, which is upwards for a negative one: the cell below.
        const auto cell = static_cast<std::ptrdiff_t>(std::min(radiance, 1.0) * cells_) -
                          static_cast<std::ptrdiff_t>(radiance < 0.0);
        auto code = code_of_cell_[code_of_cell_.size() / 2 + static_cast<std::size_t>(cell)];
        // One step without a branch that the processor could guess wrongly; more are rare.
        code = static_cast<std::uint16_t>(code + (radiance >= steps_[code]));
        while (radiance >= steps_[code])
            ++code;
        return code;
    }

private:
    std::uint16_t code_below_cells(double radiance) const;

    std::vector<double> steps_;  // [c]: the least radiance whose code is above c; last infinity
    double cells_;               // of radiance 0..1; a power of two, so that no index is rounded
    // At its lower end, of the cells -cells_ - 1 to cells_; number 0 begins with radiance 0.
    std::vector<std::uint16_t> code_of_cell_;
};

}  // namespace etalon
