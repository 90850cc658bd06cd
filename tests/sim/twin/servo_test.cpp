#include "sim/twin/servo.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double pi = std::numbers::pi;

// Everything at work: 2 ms of lag, a motor of 11 Hz, a carriage of 37 Hz.
ServoParameters soft_servo() {
    return {.drive_lag = 2e-3,
            .bandwidth_hz = 11.0,
            .damping = 0.6,
            .resonance_hz = 37.0,
            .resonance_damping = 0.03};
}

Motion s_curve() {
    return Motion::between(3.0, -4.0, {20.0, 300.0, 9000.0});
}

// The definition in sim/twin/servo.h by Runge and Kutta's fourth order, in its own coordinates.
struct Classic {
    double w, e, e_speed, c, c_speed;
};
Classic operator+(const Classic& a, const Classic& b) {
    return {a.w + b.w, a.e + b.e, a.e_speed + b.e_speed, a.c + b.c, a.c_speed + b.c_speed};
}
Classic operator*(double f, const Classic& a) {
    return {f * a.w, f * a.e, f * a.e_speed, f * a.c, f * a.c_speed};
}

Classic slope(const ServoParameters& p, const Classic& x, double r) {
    const double ws = 2 * pi * p.bandwidth_hz, wr = 2 * pi * p.resonance_hz;
    return {(r - x.w) / p.drive_lag, x.e_speed,
            ws * ws * (x.w - x.e) - 2 * p.damping * ws * x.e_speed, x.c_speed,
            wr * wr * (x.e - x.c) + 2 * p.resonance_damping * wr * (x.e_speed - x.c_speed)};
}

Classic runge_kutta(const ServoParameters& p, const Motion& motion, double until, int steps) {
    const double h = until / steps, rest = motion.start();
    Classic x{rest, rest, 0.0, rest, 0.0};
    for (int i = 0; i < steps; ++i) {
        const double t = i * h, middle = motion.position(t + h / 2);
        const Classic k1 = slope(p, x, motion.position(t)), k2 = slope(p, x + h / 2 * k1, middle),
                      k3 = slope(p, x + h / 2 * k2, middle),
                      k4 = slope(p, x + h * k3, motion.position(t + h));
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    }
    return x;
}

// Its error falls with h^4, and with h^2 times the jump of the jerk's derivative at corners:
// halving the step tells how large it is.
TEST(Servo, AgreesWithRungeAndKutta) {
    const Servo servo(soft_servo());
    for (const Motion& motion : {s_curve(), Motion::between(3.0, -4.0, {20.0, 300.0})}) {
        for (const double t : {0.013, 0.1, 0.31, 0.6}) {
            const auto state = servo.advance(servo.at_rest(3.0), motion, 0.0, t);
            const Classic fine = runge_kutta(soft_servo(), motion, t, 20000);
            const Classic coarse = runge_kutta(soft_servo(), motion, t, 10000);
            EXPECT_NEAR(servo.motor(state), fine.e, 2 * std::abs(fine.e - coarse.e) + 1e-11);
            EXPECT_NEAR(servo.carriage(state), fine.c, 2 * std::abs(fine.c - coarse.c) + 1e-11);
            EXPECT_LT(std::abs(fine.c - coarse.c), 1e-7);
        }
    }
}

TEST(Servo, AgreesWithItselfForEveryDivisionOfTime) {
    const Servo servo(soft_servo());
    const Motion motion = s_curve();
    const auto at_once = servo.advance(servo.at_rest(3.0), motion, 0.0, 0.7);
    auto by_steps = servo.at_rest(3.0);
    for (int i = 0; i < 700; ++i)
        by_steps = servo.advance(by_steps, motion, i * 1e-3, (i + 1) * 1e-3);
    EXPECT_LT((at_once - by_steps).cwiseAbs().maxCoeff(), 1e-12);
}

// In steady cruise every second-order part lags by v 2 z / w, the drive by v times its lag, and the
// carriage follows its motor.
TEST(Servo, LagsBehindACruiseAsItsClosedFormSays) {
    const ServoParameters p = soft_servo();
    const Servo servo(p);
    const Motion motion = Motion::between(0.0, 500.0, {30.0, 300.0});
    const auto state = servo.advance(servo.at_rest(0.0), motion, 0.0, 10.0);
    const double lag = 30.0 * (p.drive_lag + 2 * p.damping / (2 * pi * p.bandwidth_hz));
    EXPECT_NEAR(motion.position(10.0) - servo.motor(state), lag, 1e-10);
    EXPECT_NEAR(servo.carriage(state), servo.motor(state), 1e-10);
}

// Under a steady acceleration a spring of w rad/s is a / w^2 behind.
TEST(Servo, TheCarriageHangsBackUnderAcceleration) {
    const ServoParameters p = soft_servo();
    const Servo servo(p);
    const Motion motion = Motion::between(0.0, 1e6, {1e5, 300.0});
    const auto state = servo.advance(servo.at_rest(0.0), motion, 0.0, 20.0);
    const double wr = 2 * pi * p.resonance_hz;
    EXPECT_NEAR(servo.motor(state) - servo.carriage(state), 300.0 / (wr * wr), 1e-8);
}

// After the motor has come to rest the carriage's swing decays by exp(-2 pi z / sqrt(1 - z^2)) from
// one period to the next.
TEST(Servo, TheCarriageRingsAfterTheMotorStands) {
    const ServoParameters p{.bandwidth_hz = 900.0, .resonance_hz = 7.0, .resonance_damping = 0.01};
    const Servo servo(p);
    const Motion motion = Motion::between(0.0, 50.0, {100.0, 4000.0});
    const double root = std::sqrt(1 - p.resonance_damping * p.resonance_damping);
    const double period = 1.0 / (p.resonance_hz * root), t = motion.duration() + 0.2;
    const auto swing = [&](double at) {
        const auto state = servo.advance(servo.at_rest(0.0), motion, 0.0, at);
        EXPECT_NEAR(servo.motor(state), 50.0, 1e-9);
        return servo.carriage(state) - 50.0;
    };
    EXPECT_GT(std::abs(swing(t)), 0.1);
    EXPECT_NEAR(swing(t + period) / swing(t), std::exp(-2 * pi * p.resonance_damping / root), 1e-9);
}

TEST(Servo, TheCarriageSwingsOnBehindAJammedMotor) {
    const Servo servo(soft_servo());
    const auto moving = servo.advance(servo.at_rest(3.0), s_curve(), 0.0, 0.2);
    const auto jammed = servo.with_motor_stopped(moving);
    const double place = servo.motor(moving);
    EXPECT_EQ(servo.motor(jammed), place);
    EXPECT_EQ(servo.carriage(jammed), servo.carriage(moving));
    // It moves at about -20 mm/s: on, and half a period of 13.5 ms later back.
    const auto later = servo.advance(jammed, Motion(place), 0.0, 3e-3);
    EXPECT_NEAR(servo.motor(later), place, 1e-12);
    EXPECT_LT(servo.carriage(later), servo.carriage(jammed) - 0.02);
    const auto rest = servo.advance(jammed, Motion(place), 0.0, 20.0);
    EXPECT_NEAR(servo.carriage(rest), place, 1e-12);
}

TEST(Servo, PartsThatAreLeftOutDoNothing) {
    const ServoParameters p{.bandwidth_hz = 11.0, .damping = 0.6};
    ServoParameters hardly = p;
    hardly.drive_lag = 1e-12;
    hardly.resonance_hz = 1e10;
    const Servo servo(p), other(hardly);
    const auto state = servo.advance(servo.at_rest(3.0), s_curve(), 0.0, 0.2);
    const auto same = other.advance(other.at_rest(3.0), s_curve(), 0.0, 0.2);
    EXPECT_EQ(servo.motor(state), servo.carriage(state));
    EXPECT_NEAR(other.motor(same), servo.motor(state), 1e-9);
    EXPECT_NEAR(other.carriage(same), servo.carriage(state), 1e-9);
}

// Rates 1 : 1e18 apart: the slow ones keep their digits.
TEST(ExponentialMinusOne, KeepsSlowPartsBesideFastOnes) {
    SmallMatrix m = SmallMatrix::Zero(3, 3);
    m.diagonal() << -1e12, -1e-6, -0.7;
    m(1, 2) = 3e-6;
    const SmallMatrix e = exponential_minus_one(m);
    EXPECT_NEAR(e(0, 0), -1.0, 1e-15);
    EXPECT_NEAR(e(1, 1) / std::expm1(-1e-6), 1.0, 1e-14);
    EXPECT_NEAR(e(2, 2) / std::expm1(-0.7), 1.0, 1e-14);
    // (e^b - e^a) / (b - a) times the coupling.
    const double coupled = 3e-6 * (std::expm1(-0.7) - std::expm1(-1e-6)) / (-0.7 + 1e-6);
    EXPECT_NEAR(e(1, 2) / coupled, 1.0, 1e-14);
}

TEST(ExponentialMinusOne, TurnsAsARotationDoes) {
    SmallMatrix m = SmallMatrix::Zero(2, 2);
    m << 0.0, -700.3, 700.3, 0.0;
    const SmallMatrix e = exponential_minus_one(m);
    EXPECT_NEAR(e(0, 0) + 1.0, std::cos(700.3), 1e-12);
    EXPECT_NEAR(e(1, 0), std::sin(700.3), 1e-12);
}

TEST(ExponentialMinusOne, RefusesWhatHasNone) {
    SmallMatrix m = SmallMatrix::Constant(1, 1, 1e4);
    EXPECT_THROW(exponential_minus_one(m), NumericalError);
    m(0, 0) = std::nan("");
    EXPECT_THROW(exponential_minus_one(m), NumericalError);
}

TEST(Servo, RefusesParametersWithoutAMeaning) {
    const auto refused = [](auto change) {
        ServoParameters p = soft_servo();
        change(p);
        EXPECT_THROW(Servo{p}, NumericalError);
    };
    refused([](ServoParameters& p) { p.drive_lag = -1e-3; });
    refused([](ServoParameters& p) { p.bandwidth_hz = 0.0; });
    refused([](ServoParameters& p) { p.damping = std::nan(""); });
    refused([](ServoParameters& p) { p.resonance_hz = -7.0; });
    refused([](ServoParameters& p) { p.resonance_damping = 0.0; });
}

}  // namespace
}  // namespace etalon
