#include "sim/sobol.h"

#include <cmath>
#include <numbers>

#include "core/random.h"

namespace etalon {
namespace {

constexpr int bits = 32;

struct Polynomial {
    int degree;
    std::uint32_t coefficients;
    std::array<std::uint32_t, 4> initial;
};

// Dimensions 2 to 6; the first is van der Corput's sequence.
constexpr std::array<Polynomial, SobolPoints::dimensions - 1> polynomials{{
    {1, 0, {1}},
    {2, 1, {1, 3}},
    {3, 1, {1, 3, 1}},
    {3, 2, {1, 1, 1}},
    {4, 1, {1, 1, 3, 3}},
}};

std::array<std::uint32_t, bits> direction_numbers(int dimension) {
    std::array<std::uint32_t, bits> v{};
    if (dimension == 0) {
        for (std::size_t i = 0; i < bits; ++i)
            v[i] = std::uint32_t{1} << (bits - 1 - i);
        return v;
    }
    const Polynomial& p = polynomials[static_cast<std::size_t>(dimension - 1)];
    const auto degree = static_cast<std::size_t>(p.degree);
    for (std::size_t i = 0; i < bits; ++i) {
        if (i < degree) {
            v[i] = p.initial[i] << (bits - 1 - i);
            continue;
        }
        v[i] = v[i - degree] ^ (v[i - degree] >> degree);
        for (std::size_t k = 1; k < degree; ++k)
            if ((p.coefficients >> (degree - 1 - k)) & 1u)
                v[i] ^= v[i - k];
    }
    return v;
}

std::uint32_t bit_reversed(std::uint32_t x) {
    x = (x << 16) | (x >> 16);
    x = ((x & 0x00ff00ffu) << 8) | ((x & 0xff00ff00u) >> 8);
    x = ((x & 0x0f0f0f0fu) << 4) | ((x & 0xf0f0f0f0u) >> 4);
    x = ((x & 0x33333333u) << 2) | ((x & 0xccccccccu) >> 2);
    return ((x & 0x55555555u) << 1) | ((x & 0xaaaaaaaau) >> 1);
}

// A permutation in which every bit depends only on itself and the bits below it: applied to the
// reversed digits, that is a nested scramble. Constants: N. Vegdahl, "Building a better LK hash"
// (2021).
std::uint32_t nested_scramble(std::uint32_t x, std::uint32_t seed) {
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

}  // namespace

SobolPoints::SobolPoints(int count) : reversed_(static_cast<std::size_t>(count)) {
    for (std::size_t d = 0; d < dimensions; ++d) {
        const auto directions = direction_numbers(static_cast<int>(d));
        for (std::size_t i = 0; i < reversed_.size(); ++i) {
            std::uint32_t x = 0;
            for (std::size_t bit = 0; (i >> bit) != 0; ++bit)
                if ((i >> bit) & 1u)
                    x ^= directions[bit];
            reversed_[i][d] = bit_reversed(x);
        }
    }
}

SobolPoints::Point SobolPoints::point(int index, const Scramble& scramble) const {
    const auto& digits = reversed_[static_cast<std::size_t>(index)];
    Point result;
    for (std::size_t d = 0; d < dimensions; ++d)
        result[d] = (bit_reversed(nested_scramble(digits[d], scramble[d])) + 0.5) * 0x1p-32;
    return result;
}

Eigen::Vector2d concentric_disk(double u, double v) {
    constexpr double quarter = std::numbers::pi / 4.0;
    const double a = 2.0 * u - 1.0, b = 2.0 * v - 1.0;
    if (a == 0.0 && b == 0.0)
        return {0.0, 0.0};
    const bool flat = std::abs(a) > std::abs(b);
    const double radius = flat ? a : b;
    const double angle = flat ? quarter * (b / a) : quarter * (2.0 - a / b);
    return {radius * std::cos(angle), radius * std::sin(angle)};
}

SobolPoints::Scramble make_scramble(std::uint64_t seed, std::uint32_t pixel_x,
                                    std::uint32_t pixel_y, std::uint32_t number) {
    const auto low = philox(seed, {pixel_x, pixel_y, number, 0});
    const auto high = philox(seed, {pixel_x, pixel_y, number, 1});
    return {low[0], low[1], low[2], low[3], high[0], high[1]};
}

}  // namespace etalon
