// Low-discrepancy points of the unit cube, for plans and studies of a volume of poses
// (sim/scene/pose_volume.h).
//
// Halton's sequence (Numerische Mathematik 2, 1960): the index's digits in the first prime bases,
// mirrored at the point and permuted: at random (Matousek, J. Complexity 14, 1998), or by Faure's
// permutations of the smallest discrepancy (J. Number Theory 42, 1992), whose bases a seed starts
// at random indices (X. Wang and F. J. Hickernell, Math. Comput. Modelling 32, 2000; G. Okten, J.
// Complexity 25, 2009). With a seed each point is uniform, and the strata stay.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

namespace etalon {

// Owen-scrambled Sobol points. Direction numbers: S. Joe and F. Y. Kuo, SIAM J. Sci. Comput. 30
// (2008), file new-joe-kuo-6.21201. SobolSequence, for plans and studies: any index, scrambled as
// by A. B. Owen (Lecture Notes in Statistics 106, Springer 1995). SobolPoints, for millions of
// integrals: six dimensions, a prepared number of points, scrambled by hashing (B. Burley, JCGT
// 9(4), 2020) in a few ns.

// By digit of the index, the last first: what it adds modulo 2 to the point, of which the first
// binary digit is the highest bit.
using SobolDirections = std::array<std::uint64_t, 64>;

// Immutable, safe from every thread. point() costs 0.3 us per dimension, unscrambled 0.1 us.
class SobolSequence {
public:
    static constexpr int max_dimensions = 16;

    // 1 to 16 dimensions (NumericalError otherwise); without a seed the points are not scrambled.
    SobolSequence(int dimensions, std::optional<std::uint64_t> seed);

    // One coordinate in [0, 1) per dimension, 53 bits, in the index's order. Of 2^m points from a
    // multiple of 2^m one lies in each of the 2^m equal intervals of every dimension, and of the
    // first two in each rectangle of area 2^-m. Point 0 of the unscrambled sequence is the origin.
    std::vector<double> point(std::uint64_t index) const;

private:
    std::vector<SobolDirections> directions_;  // by dimension
    std::optional<std::uint64_t> seed_;
};

class SobolPoints {
public:
    static constexpr int dimensions = 6;
    using Point = std::array<double, dimensions>;
    using Scramble = std::array<std::uint32_t, dimensions>;

    // The first `count` points.
    explicit SobolPoints(int count);

    int count() const { return static_cast<int>(reversed_.size()); }

    // Point `index` under a scramble (one seed per dimension), each coordinate in (0, 1).
    Point point(int index, const Scramble& scramble) const;

private:
    std::vector<std::array<std::uint32_t, dimensions>> reversed_;  // first digit in the lowest bit
};

// Uniform points of the unit disk from the unit square: the concentric map of P. Shirley and
// K. Chiu, "A low distortion map between disk and square", JGT 2(3) (1997).
Eigen::Vector2d concentric_disk(double u, double v);

// Independent seeds for a pixel's scramble.
SobolPoints::Scramble make_scramble(std::uint64_t seed, std::uint32_t pixel_x,
                                    std::uint32_t pixel_y, std::uint32_t number);

// Faure's permutation of the digits 0 to base - 1, base >= 2: (0 3 2 1 4) for 5.
std::vector<int> faure_permutation(int base);

// Immutable, safe from every thread. point() costs about 80 ns per dimension.
class HaltonSequence {
public:
    // Without a seed random digits are not permuted, and Faure's start at index 0.
    enum class Digits { random, faure };

    // 1 to 20 dimensions (NumericalError otherwise).
    HaltonSequence(int dimensions, std::optional<std::uint64_t> seed,
                   Digits digits = Digits::random);

    // One coordinate in [0, 1) per dimension. Of base^m points that start at a multiple of base^m
    // (with Faure's permutations: anywhere) exactly one lies in each of the base^m equal intervals
    // of that base's dimension. Point 0 of an unseeded sequence is the origin.
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

    std::vector<Dimension> dimensions_;
};

enum class SequenceKind {
    halton,        // random digit permutations
    halton_faure,  // Faure's permutations, random start
    sobol,         // Owen's nested uniform scrambling
};

// One of them, randomised by the seed: over the seeds every point is uniform in the cube.
// Immutable, safe from every thread.
class PointSequence {
public:
    static constexpr int max_dimensions = 16;

    // 1 to 16 dimensions (NumericalError otherwise). Further dimensions do not change the first.
    PointSequence(SequenceKind kind, int dimensions, std::uint64_t seed);

    // One coordinate in [0, 1) per dimension. Index 0 is as good as any.
    std::vector<double> point(std::uint64_t index) const { return point_(index); }

private:
    std::function<std::vector<double>(std::uint64_t)> point_;
};

}  // namespace etalon
