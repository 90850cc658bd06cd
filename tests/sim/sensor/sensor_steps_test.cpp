#include "sim/sensor/sensor_steps.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "core/statistics/random.h"
#include "tests/sim/sensor/expected_codes.h"

namespace etalon {
namespace {

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
    test::expect_codes(steps, curve, radiances);
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

}  // namespace
}  // namespace etalon
