// A camera's curve from radiance to code as 16 quartics, where it is smooth: most pixels of a
// blurred image get their code by arithmetic, sooner than any table in memory gives it.
#pragma once

#include <bit>
#include <cstdint>
#include <vector>

namespace etalon {

// Two pieces an octave from 2^-8 to 1, by the bits of a float; the first reaches down to 0. At
// radiance L of piece i, with u = L - centre[i],
//     t = sum over n of factor[n][i] u^n
// is the curve's value in codes: the code is t rounded, unless t is within `doubt` of the middle
// between two. A piece that does not follow the curve so well has a NaN, which leaves
// all in doubt.
struct PiecewisePolynomial {
    static constexpr int count = 16, degree = 4, shift = 22;
    static constexpr std::int32_t first = (std::bit_cast<std::int32_t>(1.0f) >> shift) - count;
    float centre[count];
    float factor[degree + 1][count];
    float doubt;
    bool follow;  // else a look-up in the first place is sooner
};

// `steps`, of fewer than 2^bits: number c is the least radiance whose code is above c; ascending.
// A quartic goes through five of the steps. It is taken when it rises all over its piece and misses
// no step, and none of the codes at its ends, by as much as `doubt` without the rounding of L and
// t: then it is right at every float that is not in doubt, and at every radiance that rounds to
// one.
PiecewisePolynomial fit_pieces(const std::vector<double>& steps, int bits);

}  // namespace etalon
