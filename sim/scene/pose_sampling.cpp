#include "sim/scene/pose_sampling.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "core/program/errors.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

constexpr std::array primes{2,  3,  5,  7,  11, 13, 17, 19, 23, 29,
                            31, 37, 41, 43, 47, 53, 59, 61, 67, 71};
constexpr double below_one = 1.0 - 0x1p-53;  // the largest double under 1

// Digits until they are too small for a double: 53 in base 2. Those beyond would not show in the
// sum.
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

int base_of(int dimension) {
    return primes[static_cast<std::size_t>(dimension)];
}

void check_dimensions(const char* what, int dimensions, int most) {
    if (dimensions < 1 || dimensions > most)
        throw NumericalError(fmt::format("{} of {} dimensions: 1 to {}", what, dimensions, most));
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

HaltonSequence::HaltonSequence(int dimensions, std::optional<std::uint64_t> seed) {
    check_dimensions("a Halton sequence", dimensions, static_cast<int>(primes.size()));
    for (int i = 0; i < dimensions; ++i) {
        Dimension dimension{base_of(i), {}, {}};
        std::vector<int> permutation(static_cast<std::size_t>(dimension.base));
        std::iota(permutation.begin(), permutation.end(), 0);
        for (int position = 0; position < digit_count(dimension.base); ++position) {
            if (seed)
                permutation =
                    random_permutation(dimension.base, *seed, static_cast<std::uint32_t>(i),
                                       static_cast<std::uint64_t>(position));
            dimension.add_position(permutation, 0);
        }
        dimensions_.push_back(std::move(dimension));
    }
}

HaltonSequence HaltonSequence::with_faure_permutations(int dimensions,
                                                       std::optional<std::uint64_t> seed) {
    check_dimensions("a Halton sequence", dimensions, static_cast<int>(primes.size()));
    HaltonSequence sequence;
    for (int i = 0; i < dimensions; ++i) {
        Dimension dimension{base_of(i), {}, {}};
        const std::vector<int> permutation = faure_permutation(dimension.base);
        RandomStream random(seed.value_or(0), static_cast<std::uint32_t>(i));
        for (int position = 0; position < digit_count(dimension.base); ++position)
            dimension.add_position(permutation,
                                   seed ? static_cast<int>(random.uniform() * dimension.base) : 0);
        sequence.dimensions_.push_back(std::move(dimension));
    }
    return sequence;
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

namespace {

std::variant<HaltonSequence, SobolSequence> sequence_of(SequenceKind kind, int dimensions,
                                                        std::uint64_t seed) {
    check_dimensions("a sequence of points", dimensions, PointSequence::max_dimensions);
    if (kind == SequenceKind::sobol)
        return SobolSequence(dimensions, seed);
    if (kind == SequenceKind::halton_faure)
        return HaltonSequence::with_faure_permutations(dimensions, seed);
    return HaltonSequence(dimensions, seed);
}

}  // namespace

PointSequence::PointSequence(SequenceKind kind, int dimensions, std::uint64_t seed)
    : sequence_(sequence_of(kind, dimensions, seed)) {}

std::vector<double> PointSequence::point(std::uint64_t index) const {
    return std::visit([&](const auto& sequence) { return sequence.point(index); }, sequence_);
}

}  // namespace etalon
