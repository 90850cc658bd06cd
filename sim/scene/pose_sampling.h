// Well-spread points of the unit cube, for plans and studies that must cover a volume of poses
// evenly with as few poses as they can afford. Plain points: what the coordinates mean is for the
// plan to say (for a study: sim/scene/pose_volume.h).
//
// Halton's sequence (Numerische Mathematik 2, 1960): the index's digits in the first prime bases,
// mirrored at the point: 6 = 110b -> 0.011b = 0.375. From the fifth base or so its first points lie
// on lines, so the digits are permuted:
//   - every digit position of every base by a random permutation of its own (random digit
//     scrambling; Matousek, J. Complexity 14, 1998): each point is uniform; or
//   - by Faure's permutations (H. Faure, "Good permutations for extreme discrepancy", J. Number
//     Theory 42, 1992), one per base, found for the smallest discrepancy in each dimension. They
//     leave nothing to chance; a seed then lets every base start at a random index of its own
//     (random start: X. Wang and F. J. Hickernell, Math. Comput. Modelling 32, 2000; with permuted
//     digits G. Okten, J. Complexity 25, 2009). That makes each point uniform as well, and keeps
//     the stratification, which a random shift of the points modulo 1 would not.
// Sobol's sequence is in sim/scene/sobol.h.
#pragma once

#include <cstdint>
#include <optional>
#include <variant>
#include <vector>

#include "sim/scene/sobol.h"

namespace etalon {

// Faure's permutation of the digits 0 to base - 1, base >= 2: (0 3 2 1 4) for 5. An even base takes
// 2 s and then 2 s + 1 of the permutation s of its half; an odd one puts its middle digit into the
// middle of the permutation of base - 1.
std::vector<int> faure_permutation(int base);

// Immutable, safe from every thread. point() costs about 80 ns per dimension.
class HaltonSequence {
public:
    // Random digit permutations. 1 to 20 dimensions (NumericalError otherwise); without a seed the
    // digits are not permuted.
    HaltonSequence(int dimensions, std::optional<std::uint64_t> seed);

    // Faure's permutations from random starts; without a seed every base starts at index 0.
    static HaltonSequence with_faure_permutations(int dimensions,
                                                  std::optional<std::uint64_t> seed);

    // One coordinate in [0, 1) per dimension. Of base^m points that start at a multiple of base^m,
    // exactly one lies in each of the base^m equal intervals of that base's dimension, permuted or
    // not; with Faure's permutations of any base^m points that follow each other. Point 0 of an
    // unseeded sequence is the origin: plans usually begin at 1.
    std::vector<double> point(std::uint64_t index) const;

private:
    // By digit position: what each digit adds to the coordinate, `base` entries a position, and the
    // digit that index 0 has there.
    struct Dimension {
        int base;
        std::vector<double> terms;
        std::vector<int> start;

        void add_position(const std::vector<int>& permutation, int first_digit);
        double coordinate(std::uint64_t index) const;
    };

    HaltonSequence() = default;
    std::vector<Dimension> dimensions_;
};

enum class SequenceKind {
    halton,        // random digit permutations
    halton_faure,  // Faure's permutations, random start
    sobol,         // Owen's nested uniform scrambling
};

// One of them, randomised by the seed: over the seeds every point is uniform in the cube, so the
// mean of any function over the points is free of bias. Immutable, safe from every thread.
class PointSequence {
public:
    static constexpr int max_dimensions = 16;

    // 1 to 16 dimensions (NumericalError otherwise). Further dimensions do not change the first.
    PointSequence(SequenceKind kind, int dimensions, std::uint64_t seed);

    // One coordinate in [0, 1) per dimension. Index 0 is as good as any.
    std::vector<double> point(std::uint64_t index) const;

private:
    std::variant<HaltonSequence, SobolSequence> sequence_;
};

}  // namespace etalon
