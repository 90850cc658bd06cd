#include "sim/sensor/sensor_steps.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/random.h"

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

void expect_exact(const Curve& curve) {
    const SensorSteps steps(curve.bits, curve);
    const auto expect_code = [&](double radiance) {
        ASSERT_EQ(steps.code_at(radiance), curve(radiance)) << radiance;
    };
    RandomStream random(3, 4);
    for (int n = 0; n < 20'000; ++n) {
        const double deviate = random.normal();
        for (const double scale : {1e-300, 1e-9, 1e-3, 0.03, 0.4, 2.0})
            expect_code(scale * deviate);
    }
    // The cells' ends and the doubles beside them.
    const int cells = 8 << curve.bits;
    for (int cell = -cells - 2; cell <= cells + 2; ++cell) {
        const double end = cell / double(cells);
        for (const double radiance : {std::nextafter(end, -9.0), end, std::nextafter(end, 9.0)})
            expect_code(radiance);
    }
    for (const double radiance : {-0.0, 5e-324, -5e-324, 1e308, -1e308})
        expect_code(radiance);
}

// Noise goes below 0 and above 1. Steep below 0 all codes end within the first cells there, flat
// they reach beyond radiance -1.
TEST(SensorSteps, GiveTheCurvesCodeOfEveryDoubleBelowZeroAndAboveOne) {
    for (const int bits : {1, 5, 8})
        for (const double black : {0.0, 0.13, 0.4})
            for (const double slope : {37.0, 1.7, 0.11})
                expect_exact({bits, black, slope});
}

// A step at radiance 0 itself: code 8 begins where 7.5 + 0.5 is reached.
TEST(SensorSteps, KeepAStepAtZeroAtZero) {
    const auto code_of = [](double radiance) {
        return std::clamp(std::floor(7.5 + 32.0 * radiance + 0.5), 0.0, 31.0);
    };
    const SensorSteps steps(5, code_of);
    EXPECT_EQ(steps.code_at(0.0), 8);
    EXPECT_EQ(steps.code_at(-0.0), 8);
    EXPECT_EQ(steps.code_at(-1e-9), 7);
    EXPECT_EQ(steps.code_at(-1.0 / 32.0), 7);
}

}  // namespace
}  // namespace etalon
