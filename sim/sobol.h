// Owen-scrambled Sobol points in six dimensions: each scramble is an independent randomisation of
// the same low-discrepancy set, so their spread is an honest standard error.
//
// Direction numbers: S. Joe and F. Y. Kuo, "Constructing Sobol sequences with better
// two-dimensional projections", SIAM J. Sci. Comput. 30 (2008), file new-joe-kuo-6.21201.
// Scrambling by hashing: B. Burley, "Practical hash-based Owen scrambling", JCGT 9(4) (2020).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace etalon {

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

}  // namespace etalon
