#include "sim/sensor/sensor_steps.h"

#include <bit>

#include "core/statistics/random.h"
#include "tests/test.h"

namespace etalon {
namespace {

// Each radiance as the nearest float of itself, and those that are floats as floats.
void expect_codes(const QuantizationThresholds& steps, const std::function<double(double)>& code_of,
                  const std::vector<double>& radiances) {
    for (const bool is_rounded : {false, true})
        for (std::size_t first = 0; first < radiances.size();
             first += QuantizationThresholds::max_at_once) {
            std::vector<float> values;
            for (std::size_t i = first;
                 i < radiances.size() && std::ssize(values) < QuantizationThresholds::max_at_once;
                 ++i)
                values.push_back(static_cast<float>(radiances[i]));
            const auto radiance_at = [&](int i) {
                const auto place = static_cast<std::size_t>(i);
                return is_rounded ? radiances[first + place] : double(values[place]);
            };
            std::vector<std::uint16_t> codes(values.size());
            const int count = static_cast<int>(values.size());
            ASSERT_TRUE(
                steps.put_codes(values.data(), is_rounded, count, radiance_at, codes.data()));
            for (int i = 0; i < count; ++i)
                ASSERT_EQ(codes[static_cast<std::size_t>(i)], code_of(radiance_at(i)))
                    << radiance_at(i) << " rounded " << is_rounded;
        }
}

// A curve that is steep at 0 and goes on below it, above a black level of `black` of full scale.
struct Curve {
    int bits;
    double black;
    double slope_below;
    double operator()(double radiance) const {
        const double value =
            radiance < 0.0 ? slope_below * radiance : std::sqrt(std::min(radiance, 1.0));
        const double full_scale = (1 << bits) - 1;
        return std::clamp(std::floor(full_scale * (black + (1.0 - black) * value) + 0.5), 0.0,
                          full_scale);
    }
};

// Nowhere near, for some.
std::function<double(int)> guess_of(const Curve& curve) {
    return [curve](int code) {
        const double value = (code + 0.5) / ((1 << curve.bits) - 1);
        return code % 3 == 0 ? -7.0 : value * value;
    };
}

// The ends of the cells of every octave from 2^-22 to 2, and floats beside the steps.
std::vector<double> ends_and_steps(const Curve& curve) {
    std::vector<double> result;
    const int cells = std::max(1 << (curve.bits - 1), 256);
    for (int octave = -22; octave < 1; ++octave)
        for (int cell = 0; cell < cells; ++cell)
            for (const double sign : {-1.0, 1.0})
                result.push_back(sign * std::ldexp(1.0 + cell / double(cells), octave));
    const double full_scale = (1 << curve.bits) - 1;
    for (int code = 0; code < full_scale; ++code) {
        const double value = ((code + 0.5) / full_scale - curve.black) / (1.0 - curve.black);
        const auto step =
            static_cast<float>(value < 0.0 ? value / curve.slope_below : value * value);
        for (const float end : {-9.0f, step, 9.0f})
            result.push_back(std::nextafter(step, end));
    }
    return result;
}

// As doubles and, where a float is that or near it, through the cells.
void expect_exact(const Curve& curve) {
    const QuantizationThresholds steps(curve.bits, curve, guess_of(curve));
    std::vector<double> radiances;
    const auto expect_code = [&](double radiance) {
        ASSERT_EQ(steps.code_at(radiance), curve(radiance)) << radiance;
        radiances.push_back(radiance);
    };
    RandomStream random(3, 4);
    for (int n = 0; n < 20'000; ++n) {
        const double deviate = random.normal();
        for (const double scale : {1e-300, 1e-9, 1e-3, 0.03, 0.4, 2.0})
            expect_code(scale * deviate);
    }
    for (const double end : ends_and_steps(curve))
        for (const double radiance : {std::nextafter(end, -9.0), end, std::nextafter(end, 9.0)})
            expect_code(radiance);
    for (const double radiance : {-0.0, 5e-324, -5e-324, 1e30, -1e30})
        expect_code(radiance);
    expect_codes(steps, curve, radiances);
}

// Noise goes below 0 and above 1. Steep below 0 all codes end within the first cells there, flat
// they reach beyond radiance -1.
TEST(QuantizationThresholds, GiveTheCurvesCodeOfEveryDoubleBelowZeroAndAboveOne) {
    for (const int bits : {1, 5, 8, 13})
        for (const double black : {0.0, 0.13, 0.4})
            for (const double slope : {37.0, 1.7, 0.11})
                expect_exact({bits, black, slope});
}

// A step at radiance 0 itself: code 8 begins where 7.5 + 0.5 is reached.
TEST(QuantizationThresholds, KeepAStepAtZeroAtZero) {
    const auto code_of = [](double radiance) {
        return std::clamp(std::floor(7.5 + 32.0 * radiance + 0.5), 0.0, 31.0);
    };
    const QuantizationThresholds steps(5, code_of, [](int code) { return (code - 7.0) / 32.0; });
    EXPECT_EQ(steps.code_at(0.0), 8);
    EXPECT_EQ(steps.code_at(-0.0), 8);
    EXPECT_EQ(steps.code_at(-1e-9), 7);
    EXPECT_EQ(steps.code_at(-1.0 / 32.0), 7);
}

// A cell begins at 0.5; the float before is 3e-8 less. What lies above the step rounds to below it.
TEST(QuantizationThresholds, KeepAStepThatLiesBetweenTheFloatsAtACellsEnd) {
    const double step = 0.5 - 2.5e-8;
    const QuantizationThresholds steps(
        1, [&](double radiance) { return radiance >= step ? 1.0 : 0.0; }, [](int) { return 0.4; });
    const double radiance = 0.5 - 2.4e-8;
    const float nearest = static_cast<float>(radiance);
    ASSERT_LT(nearest, step);
    std::uint8_t code = 7;
    steps.put_codes(
        &nearest, true, 1, [&](int) { return radiance; }, &code);
    EXPECT_EQ(code, 1);
}

using Inverse = std::function<double(double)>;  // radiance from value, rising

// Code c ends, and the next begins, where the value is (c + 1/2) / F.
std::vector<double> steps_of(int bits, const Inverse& radiance_of) {
    std::vector<double> steps;
    const double full_scale = (1 << bits) - 1;
    for (double code = 0.5; code < full_scale; ++code)
        steps.push_back(radiance_of(code / full_scale));
    return steps;
}

int followed(const PiecewisePolynomial& pieces) {
    return static_cast<int>(
        std::ranges::count_if(pieces.factor[0], [](float factor) { return !std::isnan(factor); }));
}

double straight(double value) {
    return value;
}
double square(double value) {
    return 0.3 * value + 0.7 * value * value;
}
// Above 0.3 twice as steep, or little more.
double kinked(double value) {
    return value < 0.3 ? value : 0.3 + 2.0 * (value - 0.3);
}
double bent(double value) {
    return value < 0.3 ? value : 0.3 + 1.03 * (value - 0.3);
}

TEST(PiecewisePolynomial, FollowSmoothCurvesEverywhere) {
    for (const int bits : {8, 10, 12, 14, 16})
        for (const auto& curve : {straight, square})
            EXPECT_EQ(followed(fit_pieces(steps_of(bits, curve), bits)), PiecewisePolynomial::count)
                << bits;
}

// 16 bits leave too much in doubt, and so does a curve that is not followed in most of its pieces.
TEST(PiecewisePolynomial, AreUsedWhereTheyLeaveLittleDoubt) {
    const auto many_kinks = [](double value) {
        return value + 0.004 * std::abs(std::sin(60.0 * value));
    };
    EXPECT_TRUE(fit_pieces(steps_of(12, square), 12).follow);
    EXPECT_TRUE(fit_pieces(steps_of(12, kinked), 12).follow);
    EXPECT_FALSE(fit_pieces(steps_of(12, many_kinks), 12).follow);
    EXPECT_FALSE(fit_pieces(steps_of(16, square), 16).follow);
}

// 0.3 is in the piece from 0.25 to 0.375.
TEST(PiecewisePolynomial, LeaveOutAPieceWithAKink) {
    for (const auto& curve : {kinked, bent}) {
        const PiecewisePolynomial pieces = fit_pieces(steps_of(12, curve), 12);
        EXPECT_EQ(followed(pieces), PiecewisePolynomial::count - 1);
        EXPECT_TRUE(std::isnan(pieces.factor[0][PiecewisePolynomial::count - 4]));
    }
}

// Five steps at least make a quartic. A curve has none where it jumps by 40 codes, nor where it is
// so steep that a float's rounding is many codes.
TEST(PiecewisePolynomial, LeaveOutWhatNoQuarticFollows) {
    EXPECT_EQ(followed(fit_pieces({}, 8)), 0);
    EXPECT_EQ(followed(fit_pieces({0.1, 0.2, 0.3, 0.4}, 8)), 0);
    const auto jump = [](double value) {
        return value < 0.6 ? value : std::max(0.6, value - 0.156);
    };
    EXPECT_TRUE(
        std::isnan(fit_pieces(steps_of(8, jump), 8).factor[0][PiecewisePolynomial::count - 2]));
    const auto cliff = [](double value) { return 0.8 + 1e-6 * value; };
    EXPECT_TRUE(
        std::isnan(fit_pieces(steps_of(12, cliff), 12).factor[0][PiecewisePolynomial::count - 1]));
}

// Floats in their order, so that a vector of them is on one piece or two: where the arithmetic
// leaves no doubt it is what gives the codes. Beside every step, at the pieces' ends, and anywhere;
// the radiances are those that round to these floats, too.
void expect_codes(int bits, const Inverse& radiance_of) {
    const std::vector<double> truth = steps_of(bits, radiance_of);
    const auto code_of = [&](double radiance) {
        return static_cast<double>(std::upper_bound(truth.begin(), truth.end(), radiance) -
                                   truth.begin());
    };
    const QuantizationThresholds steps(
        bits, code_of, [&](int code) { return truth[static_cast<std::size_t>(code)]; });
    std::vector<double> radiances;
    RandomStream random(5, 6);
    for (const double step : truth)
        for (int n = -3; n <= 3; ++n)
            radiances.push_back(step + n * 0.45 * 0x1p-24 * step);
    for (int half_octave = -18; half_octave <= 2; ++half_octave)
        for (int n = -3; n <= 3; ++n)
            radiances.push_back((half_octave % 2 == 0 ? 1.0 : 1.5) *
                                std::ldexp(1.0 + n * 0x1p-24, half_octave / 2));
    for (int n = 0; n < 100'000; ++n)
        radiances.push_back(random.uniform());
    std::ranges::sort(radiances);
    SCOPED_TRACE(bits);
    expect_codes(steps, code_of, radiances);
}

// Rows anywhere, some at the pieces' ends, lines or powers between them, from and to radiances
// beyond 0 and 1.
std::vector<double> random_steps(RandomStream& random, int bits) {
    const auto one_in = [&](double n) { return random.uniform() < 1.0 / n; };
    std::vector<double> radiances{one_in(3) ? -0.3 * random.uniform() : 0.0,
                                  one_in(3) ? 0.6 + random.uniform() : 1.0};
    std::vector<double> values{0.0, 1.0};
    for (int row = 0; row < 3; ++row) {
        const int half_octave = static_cast<int>(14.0 * random.uniform());
        const double end = (half_octave % 2 ? 1.5 : 1.0) * std::ldexp(1.0, -1 - half_octave / 2);
        const double off =
            std::ldexp(random.uniform() - 0.5, -static_cast<int>(30.0 * random.uniform()));
        radiances.push_back(one_in(2) ? end * (1.0 + off) : std::exp(-7.0 * random.uniform()));
        values.push_back(random.uniform());
    }
    std::ranges::sort(radiances);
    std::ranges::sort(values);
    const double power = one_in(2) ? 1.0 : std::exp(2.0 * random.uniform() - 1.0);
    std::vector<double> steps = steps_of(bits, [&](double value) {
        std::size_t row = 1;
        while (row + 1 < values.size() && value > values[row])
            ++row;
        const double part = (value - values[row - 1]) / (values[row] - values[row - 1]);
        return std::lerp(radiances[row - 1], radiances[row], std::pow(part, power));
    });
    std::ranges::sort(steps);
    return steps;
}

// Floats beside the steps and at the pieces' ends, and any.
std::vector<float> floats_of_interest(const std::vector<double>& steps, RandomStream& random) {
    std::vector<float> floats;
    for (const double step : steps)
        floats.push_back(static_cast<float>(step));
    for (int piece = 0; piece <= PiecewisePolynomial::count; ++piece)
        floats.push_back(std::bit_cast<float>((PiecewisePolynomial::first + piece)
                                              << PiecewisePolynomial::shift));
    for (std::size_t n = floats.size(); n-- > 0;)
        for (const float to : {-9.0f, 9.0f})
            floats.push_back(std::nextafter(floats[n], to));
    for (int n = 0; n < 200; ++n)
        floats.push_back(static_cast<float>(std::exp(-12.0 * random.uniform())));
    return floats;
}

// Sixteen equal floats at once: the quartic decides alone, or not at all. Of rounded ones, both
// ends of what rounds to it.
TEST(PiecewisePolynomial, AreRightWhereTheyAreInNoDoubt) {
    RandomStream random(7, 8);
    for (int n = 0; n < 3000; ++n) {
        const int bits = 3 + n % 10;
        const std::vector<double> truth = random_steps(random, bits);
        const auto code_of = [&](double radiance) {
            return static_cast<double>(std::ranges::upper_bound(truth, radiance) - truth.begin());
        };
        const QuantizationThresholds steps(
            bits, code_of, [&](int code) { return truth[static_cast<std::size_t>(code)]; });
        for (const float value : floats_of_interest(truth, random)) {
            const std::vector<float> equal(16, value);
            const double low = 0.5 * (double(value) + std::nextafter(value, -9.0f));
            const double high = 0.5 * (double(value) + std::nextafter(value, 9.0f));
            for (const double radiance :
                 {std::nextafter(low, 9.0), double(value), std::nextafter(high, -9.0)}) {
                std::uint16_t codes[16];
                steps.put_codes(
                    equal.data(), radiance != value, 16, [&](int) { return radiance; }, codes);
                ASSERT_EQ(codes[7], code_of(radiance)) << radiance << " bits " << bits;
            }
        }
    }
}

TEST(PiecewisePolynomial, GiveTheCodesOfTheSteps) {
    for (const int bits : {3, 8, 12, 14, 16})
        for (const auto& curve : {straight, square, kinked, bent})
            expect_codes(bits, curve);
}

}  // namespace
}  // namespace etalon
