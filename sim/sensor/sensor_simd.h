// The inner loops of the sensor model, vectorised with Google Highway: the best instruction set of
// the machine is chosen at run time, and every set gives the same codes.
#pragma once

#include <cstdint>

#include "sim/sensor/curve_pieces.h"

namespace etalon {

// Cells of floats, by the bits of their size (without the sign): bits >> shift, limited to
// first..last. One entry each, first those of positive floats, then those of negative ones:
// the code at the cell's start << 16 | the place of the step within it, where the code becomes one
// more (negative: less); or `doubtful` in place of that. A cell without a step has one at place 0,
// and the code from before it.
struct StepCells {
    static constexpr int place_bits = 15;
    static constexpr std::uint32_t doubtful = 1u << place_bits;
    int shift;  // place_bits at most
    std::int32_t first, last;
    PiecewisePolynomial pieces;  // sooner than the entries, where they leave no doubt
};

// The codes of `count` values; those of which single precision cannot tell, and those that are not
// finite, are left to the caller: their places go to `doubtful` (room for `count`), their number is
// returned. `is_rounded`: the values are those nearest to what counts.
int step_codes(const StepCells& cells, const std::uint32_t* entries, const float* values,
               bool is_rounded, int count, std::uint8_t* codes, std::uint16_t* doubtful);
int step_codes(const StepCells& cells, const std::uint32_t* entries, const float* values,
               bool is_rounded, int count, std::uint16_t* codes, std::uint16_t* doubtful);

// Whether none of them is NaN or infinite.
bool all_finite(const float* values, int count);

}  // namespace etalon
