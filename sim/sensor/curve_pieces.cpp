#include "sim/sensor/curve_pieces.h"

#include <Eigen/Core>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

namespace etalon {
namespace {

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

// `rounding`: what that of L and t may move t by. Half of it is for t: half a float's last bit of
// 2^bits in its last sum and some of that before; that what is just at `doubt` is in doubt gives it
// another such bit.
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

}  // namespace etalon
