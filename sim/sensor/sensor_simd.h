// The inner loops of the sensor model, vectorised with Google Highway: the best instruction set of
// the machine is chosen at run time, and every set gives the same bits.
#pragma once

#include <bit>
#include <cstdint>

namespace etalon {

// A camera's curve from radiance to code as 16 quartics, where it is smooth: arithmetic, sooner
// than a table in memory. Two pieces an octave from 2^-8 to 1, by a float's bits; the first reaches
// down to 0. At radiance L of piece i, with u = L - centre[i],
//     t = sum over n of factor[n][i] u^n
// is the value in codes: the code is t rounded, unless within `doubt` of the middle between two. A
// piece that does not follow the curve has a NaN: all in doubt.
struct PiecewisePolynomial {
    static constexpr int count = 16, degree = 4, shift = 22;
    static constexpr std::int32_t first = (std::bit_cast<std::int32_t>(1.0f) >> shift) - count;
    float centre[count];
    float factor[degree + 1][count];
    float doubt;
    bool follow;  // else a look-up in the first place is sooner
};

// Cells of floats by the bits of their size (without the sign): bits >> shift, limited to
// first..last; entries of positive floats, then of negative ones: the code at the cell's start <<
// 16 | the place of the step, where the code becomes one more (negative: less); or `doubtful`. A
// cell without a step has one at place 0, and the code from before it.
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

// What the noise of an image is a pure function of, together with the pixel.
struct NoiseKey {
    std::uint64_t seed = 0;
    std::uint32_t frame = 0;
};

// Of a signal whose full scale is 1.
struct SensorNoise {
    double shot_variance;  // of the signal 1
    double read_variance;
};

// signal + sqrt(max(signal, 0) shot_variance + read_variance) * deviate for the `count` signals of
// the pixels from `first_pixel` on; what is not finite stays so. A pixel's deviate is the first
// normal() of RandomStream(seed, frame, pixel), bit for bit. 4 to 11 ns a pixel. Any thread.
void add_noise(SensorNoise noise, const NoiseKey& key, std::uint64_t first_pixel, int count,
               double* signals);

}  // namespace etalon
