// Well-spread points of the unit cube, for plans that must cover a volume of poses evenly with as
// few poses as a stage can afford. Plain points: what the coordinates mean is the plan's part.
//
// Halton's sequence (Numerische Mathematik 2, 1960): the radical inverse of the index in the first
// prime bases. From the fifth base or so its first points lie on lines; a seed therefore permutes
// the digits, every digit position of every base by a random permutation of its own (random digit
// scrambling; Matousek, J. Complexity 14, 1998). It keeps the stratification and makes each point
// uniform.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

namespace etalon {

// The index's digits in `base`, mirrored at the point: 6 = 110b -> 0.011b = 0.375. In [0, 1).
double radical_inverse(std::uint64_t index, int base);

// Immutable, safe from every thread. point() costs a multiplication per digit and dimension.
class HaltonSequence {
public:
    // 1 to 20 dimensions (NumericalError otherwise); without a seed the digits are not permuted.
    HaltonSequence(int dimensions, std::optional<std::uint64_t> seed);

    // One coordinate in [0, 1) per dimension. Of base^m points that start at a multiple of base^m,
    // exactly one lies in each of the base^m equal intervals of that base's dimension, permuted or
    // not. Point 0 of the unpermuted sequence is the origin: plans usually begin at 1.
    std::vector<double> point(std::uint64_t index) const;

private:
    struct Dimension {
        int base;
        std::vector<std::vector<int>> permutations;  // by digit position; empty: none
    };
    std::vector<Dimension> dimensions_;
};

}  // namespace etalon
