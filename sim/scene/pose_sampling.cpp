#include "sim/scene/pose_sampling.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "core/program/errors.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

void check_dimensions(const char* what, int dimensions, int most) {
    if (dimensions < 1 || dimensions > most)
        throw NumericalError(fmt::format("{} of {} dimensions: 1 to {}", what, dimensions, most));
}

constexpr int bits = 64;

struct Polynomial {
    int degree;
    std::uint32_t coefficients;  // without the first and the last, which are 1
    std::array<std::uint32_t, 6> initial;
};

// Dimensions 2 to 16; the first is van der Corput's sequence.
constexpr std::array<Polynomial, SobolSequence::max_dimensions - 1> polynomials{{
    {1, 0, {1}},
    {2, 1, {1, 3}},
    {3, 1, {1, 3, 1}},
    {3, 2, {1, 1, 1}},
    {4, 1, {1, 1, 3, 3}},
    {4, 4, {1, 3, 5, 13}},
    {5, 2, {1, 1, 5, 5, 17}},
    {5, 4, {1, 1, 5, 5, 5}},
    {5, 7, {1, 1, 7, 11, 19}},
    {5, 11, {1, 1, 5, 1, 1}},
    {5, 13, {1, 1, 1, 3, 11}},
    {5, 14, {1, 3, 5, 5, 31}},
    {6, 1, {1, 3, 3, 9, 7, 49}},
    {6, 13, {1, 1, 1, 15, 21, 21}},
    {6, 16, {1, 3, 1, 13, 27, 49}},
}};

SobolDirections direction_numbers(int dimension) {
    SobolDirections v{};
    if (dimension == 0) {
        for (std::size_t i = 0; i < bits; ++i)
            v[i] = std::uint64_t{1} << (bits - 1 - i);
        return v;
    }
    const Polynomial& p = polynomials[static_cast<std::size_t>(dimension - 1)];
    const auto degree = static_cast<std::size_t>(p.degree);
    for (std::size_t i = 0; i < bits; ++i) {
        if (i < degree) {
            v[i] = std::uint64_t{p.initial[i]} << (bits - 1 - i);
            continue;
        }
        v[i] = v[i - degree] ^ (v[i - degree] >> degree);
        for (std::size_t k = 1; k < degree; ++k)
            if ((p.coefficients >> (degree - 1 - k)) & 1u)
                v[i] ^= v[i - k];
    }
    return v;
}

// The point's binary digits, the first in the highest bit.
std::uint64_t sobol_digits(const SobolDirections& directions, std::uint64_t index) {
    std::uint64_t digits = 0;
    for (std::size_t bit = 0; index != 0; ++bit, index >>= 1)
        if (index & 1u)
            digits ^= directions[bit];
    return digits;
}

// Owen's nested uniform scrambling: each digit is flipped by a random bit of its own for every
// value of the digits before it: a binary tree. One draw, keyed by those, holds seven levels (127
// nodes, numbered from 1 as in a heap). The first 56 digits, as an integer.
std::uint64_t nested_uniform(std::uint64_t digits, std::uint64_t seed, std::uint32_t dimension) {
    constexpr int levels = 7, scrambled = 56;
    constexpr std::uint32_t purpose = 0x4f77656eu;  // apart from every RandomStream of this seed
    std::uint64_t result = 0;
    for (int first = 0; first < scrambled; first += levels) {
        const std::uint64_t before = first == 0 ? 0 : digits >> (bits - first);
        const auto tree = philox(
            seed, {static_cast<std::uint32_t>(before), static_cast<std::uint32_t>(before >> 32),
                   dimension << 8 | static_cast<std::uint32_t>(first), purpose});
        std::uint32_t node = 1;
        for (int level = first; level < first + levels; ++level) {
            const auto digit = static_cast<std::uint32_t>(digits >> (bits - 1 - level)) & 1u;
            result = result << 1 | (digit ^ ((tree[node / 32] >> (node % 32)) & 1u));
            node = node << 1 | digit;
        }
    }
    return result;
}

std::uint32_t bit_reversed(std::uint32_t x) {
    x = (x << 16) | (x >> 16);
    x = ((x & 0x00ff00ffu) << 8) | ((x & 0xff00ff00u) >> 8);
    x = ((x & 0x0f0f0f0fu) << 4) | ((x & 0xf0f0f0f0u) >> 4);
    x = ((x & 0x33333333u) << 2) | ((x & 0xccccccccu) >> 2);
    return ((x & 0x55555555u) << 1) | ((x & 0xaaaaaaaau) >> 1);
}

// A permutation whose bits depend on themselves and those below: of reversed digits a nested
// scramble. Constants: N. Vegdahl, "Building a better LK hash" (2021).
std::uint32_t nested_scramble(std::uint32_t x, std::uint32_t seed) {
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

}  // namespace

SobolSequence::SobolSequence(int dimensions, std::optional<std::uint64_t> seed) : seed_(seed) {
    check_dimensions("a Sobol sequence", dimensions, max_dimensions);
    for (int d = 0; d < dimensions; ++d)
        directions_.push_back(direction_numbers(d));
}

std::vector<double> SobolSequence::point(std::uint64_t index) const {
    std::vector<double> point(directions_.size());
    for (std::size_t d = 0; d < directions_.size(); ++d) {
        const std::uint64_t digits = sobol_digits(directions_[d], index);
        const std::uint64_t first_53 =
            seed_ ? nested_uniform(digits, *seed_, static_cast<std::uint32_t>(d)) >> 3
                  : digits >> 11;
        point[d] = 0x1p-53 * static_cast<double>(first_53);
    }
    return point;
}

SobolPoints::SobolPoints(int count) : reversed_(static_cast<std::size_t>(count)) {
    for (std::size_t d = 0; d < dimensions; ++d) {
        const SobolDirections directions = direction_numbers(static_cast<int>(d));
        for (std::size_t i = 0; i < reversed_.size(); ++i)
            reversed_[i][d] =
                bit_reversed(static_cast<std::uint32_t>(sobol_digits(directions, i) >> 32));
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

namespace {

constexpr std::array primes{2,  3,  5,  7,  11, 13, 17, 19, 23, 29,
                            31, 37, 41, 43, 47, 53, 59, 61, 67, 71};
constexpr double below_one = 1.0 - 0x1p-53;  // the largest double under 1

// Digits until they are too small for a double: 53 in base 2. Those beyond would not show in the
// sum.
int digit_count(int base) {
    return static_cast<int>(std::ceil(53.0 / std::log2(base)));
}

std::vector<int> identity(int base) {
    std::vector<int> digits(static_cast<std::size_t>(base));
    std::iota(digits.begin(), digits.end(), 0);
    return digits;
}

// Fisher and Yates' shuffle; a stream per base and digit position.
std::vector<int> random_permutation(int base, std::uint64_t seed, std::uint32_t dimension,
                                    std::uint64_t position) {
    std::vector<int> permutation = identity(base);
    RandomStream random(seed, dimension, position);
    for (std::size_t i = permutation.size() - 1; i > 0; --i) {
        const auto j = static_cast<std::size_t>(random.uniform() * static_cast<double>(i + 1));
        std::swap(permutation[i], permutation[j]);
    }
    return permutation;
}

}  // namespace

std::vector<int> faure_permutation(int base) {
    if (base < 2)
        return {0};
    if (base % 2 == 0) {
        const std::vector<int> half = faure_permutation(base / 2);
        std::vector<int> permutation;
        for (const int odd : {0, 1})
            for (const int digit : half)
                permutation.push_back(2 * digit + odd);
        return permutation;
    }
    const int middle = (base - 1) / 2;
    std::vector<int> permutation = faure_permutation(base - 1);
    for (int& digit : permutation)
        digit += digit >= middle ? 1 : 0;
    permutation.insert(permutation.begin() + middle, middle);
    return permutation;
}

HaltonSequence::HaltonSequence(int dimensions, std::optional<std::uint64_t> seed, Digits digits) {
    check_dimensions("a Halton sequence", dimensions, static_cast<int>(primes.size()));
    const bool by_faure = digits == Digits::faure;
    for (int i = 0; i < dimensions; ++i) {
        const int base = primes[static_cast<std::size_t>(i)];
        const auto number = static_cast<std::uint32_t>(i);
        Dimension dimension{base, {}, {}};
        std::vector<int> permutation = by_faure ? faure_permutation(base) : identity(base);
        RandomStream starts(seed.value_or(0), number);
        for (int position = 0; position < digit_count(base); ++position) {
            if (seed && !by_faure)
                permutation =
                    random_permutation(base, *seed, number, static_cast<std::uint64_t>(position));
            dimension.add_position(
                permutation, seed && by_faure ? static_cast<int>(starts.uniform() * base) : 0);
        }
        dimensions_.push_back(std::move(dimension));
    }
}

void HaltonSequence::Dimension::add_position(const std::vector<int>& permutation, int first_digit) {
    double weight = 1.0;
    for (std::size_t i = 0; i <= start.size(); ++i)
        weight /= base;
    for (const int digit : permutation)
        terms.push_back(weight * digit);
    start.push_back(first_digit);
}

// Zeros beyond the index's last digit are permuted as well: else no point would fall into the
// first interval of a position whose permutation moves 0.
double HaltonSequence::Dimension::coordinate(std::uint64_t index) const {
    const auto b = static_cast<std::uint64_t>(base);
    double value = 0.0;
    std::uint64_t carry = 0;  // of the sum of the start and the index
    const double* term = terms.data();
    for (const int first_digit : start) {
        std::uint64_t digit = static_cast<std::uint64_t>(first_digit) + carry;
        if (index != 0) {
            digit += index % b;
            index /= b;
        }
        carry = digit >= b ? 1 : 0;
        value += term[digit - carry * b];
        term += base;
    }
    return std::min(value, below_one);
}

std::vector<double> HaltonSequence::point(std::uint64_t index) const {
    std::vector<double> point;
    point.reserve(dimensions_.size());
    for (const Dimension& dimension : dimensions_)
        point.push_back(dimension.coordinate(index));
    return point;
}

PointSequence::PointSequence(SequenceKind kind, int dimensions, std::uint64_t seed) {
    check_dimensions("a sequence of points", dimensions, max_dimensions);
    const auto points_of = [&](auto sequence) {
        point_ = [points = std::move(sequence)](std::uint64_t index) {
            return points.point(index);
        };
    };
    if (kind == SequenceKind::sobol)
        points_of(SobolSequence(dimensions, seed));
    else
        points_of(HaltonSequence(dimensions, seed,
                                 kind == SequenceKind::halton ? HaltonSequence::Digits::random
                                                              : HaltonSequence::Digits::faure));
}

}  // namespace etalon
