#include "sim/sensor/sensor_steps.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <limits>
#include <numbers>
#include <numeric>

namespace etalon {
namespace {

// Doubles in their order as integers in theirs, and back: the bits below the sign fall with a
// negative number's value.
constexpr std::int64_t turned(std::int64_t bits) {
    return bits < 0 ? std::numeric_limits<std::int64_t>::min() - bits : bits;
}
std::int64_t place_of(double value) {
    return turned(std::bit_cast<std::int64_t>(value));
}
double in_order(std::int64_t place) {
    return std::bit_cast<double>(turned(place));
}

constexpr std::int64_t last_place = std::bit_cast<std::int64_t>(std::numeric_limits<double>::max());

// The least double for which `is_above` holds, infinity when it never does: by steps that double,
// from `guess` to both of its sides, then by bisection.
template <class Predicate>
double least_above(double guess, const Predicate& is_above) {
    const std::int64_t end = last_place + 1;  // the place behind is infinity's
    std::int64_t low = -last_place, high = end;
    const std::int64_t start = std::clamp(place_of(guess), -last_place, last_place);
    const bool is_behind = is_above(in_order(start));
    (is_behind ? high : low) = is_behind ? start : start + 1;
    for (std::int64_t stride = 1; low < high && stride < (std::int64_t{1} << 61); stride *= 2) {
        const std::int64_t place = is_behind ? std::max(start, stride - last_place) - stride
                                             : std::min(start, last_place - stride) + stride;
        const bool above = is_above(in_order(place));
        (above ? high : low) = above ? place : place + 1;
        if (above != is_behind || std::abs(place) == last_place)
            break;
    }
    while (low < high) {
        const std::int64_t middle = (low & high) + ((low ^ high) >> 1);
        if (is_above(in_order(middle)))
            high = middle;
        else
            low = middle + 1;
    }
    return in_order(low);
}

std::int32_t bits_of(float value) {
    return std::bit_cast<std::int32_t>(value);
}

// The size, as bits, of the first float from 0 on that is across a step: at or above a positive
// one, below another.
std::int32_t first_across(double step) {
    const float nearest = static_cast<float>(std::abs(step));
    const bool is_across = step > 0.0 ? nearest >= step : nearest > -step;
    return bits_of(nearest) + (is_across ? 0 : 1);
}

constexpr int nodes = PiecewisePolynomial::degree + 1;
using Factors = Eigen::Vector<double, nodes>;  // of u^0, u^1, ...

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// Radiances from `from` to `to` round to the piece's floats: |u| <= half.
struct Piece {
    double from, to, centre, half;
    double rounding;  // a radiance's, at most
    std::ptrdiff_t code_from, code_to;
};

Piece piece_of(const std::vector<double>& steps, int i) {
    const auto float_at = [](std::int32_t bits) { return double(std::bit_cast<float>(bits)); };
    const std::int32_t begin = (PiecewisePolynomial::first + i) << PiecewisePolynomial::shift;
    const std::int32_t end = (PiecewisePolynomial::first + i + 1) << PiecewisePolynomial::shift;
    const auto code_at = [&](double radiance) {
        return std::upper_bound(steps.begin(), steps.end(), radiance) - steps.begin();
    };
    const double last = float_at(end), rounding = 0.5 * (last - float_at(end - 1));
    const double from = i == 0 ? -0x1p-150 : 0.5 * (float_at(begin - 1) + float_at(begin));
    const double to = 0.5 * (last + float_at(end + 1));
    const double centre = static_cast<float>(0.5 * (from + to));
    return {from,          to,         centre, std::max(to - centre, centre - from), rounding,
            code_at(from), code_at(to)};
}

// The steps nearest to Chebyshev's nodes or, where these are not five different ones, five about
// the piece.
std::array<std::ptrdiff_t, nodes> nodes_of(const std::vector<double>& steps, const Piece& piece) {
    const std::ptrdiff_t last = std::ssize(steps) - nodes;
    std::array<std::ptrdiff_t, nodes> chosen;
    for (int n = 0; n < nodes; ++n) {
        const double place = -std::cos((n + 0.5) * std::numbers::pi / nodes);
        const auto step = std::ranges::lower_bound(steps, piece.centre + place * piece.half);
        chosen[n] = std::min<std::ptrdiff_t>(step - steps.begin(), last + n);
        if (n > 0 && chosen[n] == chosen[n - 1]) {
            const std::ptrdiff_t first =
                std::clamp<std::ptrdiff_t>((piece.code_from + piece.code_to - nodes) / 2, 0, last);
            std::iota(chosen.begin(), chosen.end(), first);
            break;
        }
    }
    return chosen;
}

// A step is in the middle between two codes.
Factors through_steps(const std::vector<double>& steps, const Piece& piece) {
    Eigen::Matrix<double, nodes, nodes> powers;
    Factors codes, scale;
    const auto chosen = nodes_of(steps, piece);
    for (int n = 0; n < nodes; ++n) {
        const double radiance = steps[static_cast<std::size_t>(chosen[n])];
        codes[n] = static_cast<double>(chosen[n]) + 0.5;
        scale[n] = std::pow(piece.half, n);
        for (int power = 0; power < nodes; ++power)
            powers(n, power) = std::pow((radiance - piece.centre) / piece.half, power);
    }
    return powers.partialPivLu().solve(codes).cwiseQuotient(scale);
}

// `rounding`: of L and t, by which t may move; half is t's: half a last bit of 2^bits in its last
// sum and some before. What is just at `doubt` gives it another such bit.
bool follows(const std::vector<double>& steps, const Piece& piece, const Factors& factors,
             double doubt, double rounding) {
    double bend = 0.0;  // the slope changes by no more
    for (int n = 2; n < nodes; ++n)
        bend += n * std::abs(factors[n]) * std::pow(piece.half, n - 1);
    const double by_radiance = (factors[1] + bend) * piece.rounding;
    if (!(factors[1] > bend && by_radiance < 0.5 * rounding))
        return false;
    const auto misses = [&](double radiance, double low, double high) {
        double code = 0.0;
        for (int n = PiecewisePolynomial::degree; n >= 0; --n)
            code = code * (radiance - piece.centre) + factors[n];
        return code < low - (doubt - rounding) || code > high + (doubt - rounding);
    };
    for (std::ptrdiff_t step = piece.code_from; step < piece.code_to; ++step) {
        const double middle = static_cast<double>(step) + 0.5;
        if (misses(steps[static_cast<std::size_t>(step)], middle, middle))
            return false;
    }
    const auto from = static_cast<double>(piece.code_from), to = static_cast<double>(piece.code_to);
    return !misses(piece.from, from - 0.5, from + 0.5) && !misses(piece.to, to - 0.5, to + 0.5);
}

PiecewisePolynomial fitted(const std::vector<double>& steps, int bits, double doubt) {
    PiecewisePolynomial pieces;
    pieces.doubt = static_cast<float>(doubt);
    for (int i = 0; i < PiecewisePolynomial::count; ++i) {
        const Piece piece = piece_of(steps, i);
        Factors factors = Factors::Constant(nan);
        if (std::ssize(steps) >= nodes)
            factors = through_steps(steps, piece).cast<float>().cast<double>();
        if (!follows(steps, piece, factors, doubt, std::ldexp(1.0, bits - 23)))
            factors[0] = nan;
        pieces.centre[i] = static_cast<float>(piece.centre);
        for (int n = 0; n < nodes; ++n)
            pieces.factor[n][i] = static_cast<float>(factors[n]);
    }
    return pieces;
}

auto left_out(const PiecewisePolynomial& pieces) {
    return std::ranges::count_if(pieces.factor[0], [](float factor) { return std::isnan(factor); });
}

}  // namespace

// Doubt costs where it is, a piece that is left out in all of itself.
PiecewisePolynomial fit_pieces(const std::vector<double>& steps, int bits) {
    const double least = std::ldexp(1.0, std::max(-9, bits - 21));
    PiecewisePolynomial pieces = fitted(steps, bits, least);
    const PiecewisePolynomial wider = fitted(steps, bits, 2.0 * least);
    if (left_out(wider) < left_out(pieces))
        pieces = wider;
    // 16 pixels are done at once: at 2^-6 four in ten times one of them is in doubt.
    pieces.follow = pieces.doubt < 0x1p-6f && left_out(pieces) < PiecewisePolynomial::count / 2;
    return pieces;
}

QuantizationThresholds::QuantizationThresholds(int bits,
                                               const std::function<double(double)>& code_of,
                                               const std::function<double(int)>& step_near) {
    const int codes = 1 << bits;
    for (int code = 0; code + 1 < codes; ++code)
        steps_.push_back(least_above(
            step_near(code), [&](double radiance) { return code_of(radiance) > double(code); }));
    while (!steps_.empty() && std::isinf(steps_.back()))
        steps_.pop_back();

    cells_.pieces = fit_pieces(steps_, bits);
    // From 1/2 to 1 half as many cells as codes: a step in each of a straight line's, fewer of
    // Rec. 709's, there and below.
    constexpr int mantissa_bits = 23;
    cells_.shift = std::min(StepCells::place_bits, mantissa_bits + 1 - bits);
    constexpr double least_size = 0x1p-20;
    double least = 1.0;
    for (const double step : steps_)
        if (step != 0.0)
            least = std::min(least, std::abs(step));
    cells_.first = (bits_of(static_cast<float>(std::max(least, least_size))) >> cells_.shift) - 1;
    cells_.last = bits_of(1.0f) >> cells_.shift;

    std::vector<std::int32_t> above, below;
    const auto positive = std::upper_bound(steps_.begin(), steps_.end(), 0.0);
    std::transform(positive, steps_.end(), std::back_inserter(above), first_across);
    std::transform(std::reverse_iterator(positive), steps_.rend(), std::back_inserter(below),
                   first_across);
    const std::ptrdiff_t code_of_0 = positive - steps_.begin();
    add_cells(above, code_of_0, 1);
    add_cells(below, code_of_0, -1);
}

// Of one side of 0: `across`, first_across() of its steps from 0 on.
void QuantizationThresholds::add_cells(const std::vector<std::int32_t>& across, std::ptrdiff_t code,
                                       int direction) {
    auto next = across.begin();
    const auto steps_up_to = [&](std::int32_t bits) {
        return std::upper_bound(next, across.end(), bits) - next;
    };
    for (std::int32_t cell = cells_.first; cell <= cells_.last; ++cell) {
        const std::int32_t start = cell << cells_.shift;
        const std::ptrdiff_t before = steps_up_to(start);
        next += before;
        code += direction * before;
        // The last cell stands for all that is larger, the first for all that is smaller, too.
        const std::ptrdiff_t within = cell == cells_.last
                                          ? across.end() - next
                                          : steps_up_to(start + (1 << cells_.shift) - 1);
        const bool doubtful =
            within > (cell == cells_.last ? 0 : 1) || (cell == cells_.first && before > 0);
        const auto from = static_cast<std::uint32_t>(within == 0 ? code - direction : code);
        const auto place = static_cast<std::uint32_t>(within == 0 ? 0 : *next - start);
        entries_.push_back(from << 16 | (doubtful ? StepCells::doubtful : place));
    }
}

std::uint16_t QuantizationThresholds::code_at(double radiance) const {
    return static_cast<std::uint16_t>(std::upper_bound(steps_.begin(), steps_.end(), radiance) -
                                      steps_.begin());
}

std::uint16_t QuantizationThresholds::code_near(int guess, double radiance) const {
    const int last = static_cast<int>(steps_.size());
    for (const int code : {guess, guess + 1, guess - 1})
        if (code >= 0 && code <= last &&
            (code == 0 || steps_[static_cast<std::size_t>(code - 1)] <= radiance) &&
            (code == last || radiance < steps_[static_cast<std::size_t>(code)]))
            return static_cast<std::uint16_t>(code);
    return code_at(radiance);
}

}  // namespace etalon
