#include "sim/pose_sampling.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "core/errors.h"
#include "core/random.h"

namespace etalon {
namespace {

constexpr std::array primes{2,  3,  5,  7,  11, 13, 17, 19, 23, 29,
                            31, 37, 41, 43, 47, 53, 59, 61, 67, 71};
constexpr double below_one = 1.0 - 0x1p-53;  // the largest double under 1

// Digits until they are too small for a double: 53 in base 2. An index has no more than 64 bits,
// and digits beyond would not show in the sum.
int digit_count(int base) {
    return static_cast<int>(std::ceil(53.0 / std::log2(base)));
}

// Fisher and Yates' shuffle; a stream per base and digit position.
std::vector<int> random_permutation(int base, std::uint64_t seed, std::uint32_t dimension,
                                    std::uint64_t position) {
    std::vector<int> permutation(static_cast<std::size_t>(base));
    std::iota(permutation.begin(), permutation.end(), 0);
    RandomStream random(seed, dimension, position);
    for (std::size_t i = permutation.size() - 1; i > 0; --i) {
        const auto j = static_cast<std::size_t>(random.uniform() * static_cast<double>(i + 1));
        std::swap(permutation[i], permutation[j]);
    }
    return permutation;
}

// Zeros beyond the index's last digit are permuted as well: else no point would fall into the
// first interval of a position whose permutation moves 0.
double permuted_inverse(std::uint64_t index, int base,
                        const std::vector<std::vector<int>>& permutations) {
    double value = 0.0, weight = 1.0;
    for (const std::vector<int>& permutation : permutations) {
        weight /= base;
        value += weight * permutation[index % static_cast<std::uint64_t>(base)];
        index /= static_cast<std::uint64_t>(base);
    }
    return std::min(value, below_one);
}

}  // namespace

double radical_inverse(std::uint64_t index, int base) {
    double value = 0.0, weight = 1.0;
    for (; index > 0; index /= static_cast<std::uint64_t>(base)) {
        weight /= base;
        value += weight * static_cast<double>(index % static_cast<std::uint64_t>(base));
    }
    return std::min(value, below_one);
}

HaltonSequence::HaltonSequence(int dimensions, std::optional<std::uint64_t> seed) {
    if (dimensions < 1 || dimensions > static_cast<int>(primes.size()))
        throw NumericalError(
            fmt::format("a Halton sequence of {} dimensions: 1 to {}", dimensions, primes.size()));
    for (int i = 0; i < dimensions; ++i) {
        Dimension dimension{primes[static_cast<std::size_t>(i)], {}};
        const int positions = seed ? digit_count(dimension.base) : 0;
        for (int position = 0; position < positions; ++position)
            dimension.permutations.push_back(
                random_permutation(dimension.base, *seed, static_cast<std::uint32_t>(i),
                                   static_cast<std::uint64_t>(position)));
        dimensions_.push_back(std::move(dimension));
    }
}

std::vector<double> HaltonSequence::point(std::uint64_t index) const {
    std::vector<double> point;
    for (const Dimension& dimension : dimensions_)
        point.push_back(dimension.permutations.empty()
                            ? radical_inverse(index, dimension.base)
                            : permuted_inverse(index, dimension.base, dimension.permutations));
    return point;
}

}  // namespace etalon
