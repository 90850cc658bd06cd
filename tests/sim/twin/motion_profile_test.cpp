#include "sim/twin/motion_profile.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

namespace etalon {
namespace {

constexpr double rounding = 1e-12;  // mm, at positions of about 100 mm

// 100 mm at 50 mm/s and 200 mm/s^2: ramps of 0.25 s and 6.25 mm, 87.5 mm in 1.75 s between.
TEST(MovingAxis, ALongTrapezoidRampsCruisesAndRamps) {
    const Motion motion = Motion::between(7.0, 107.0, {50.0, 200.0});
    EXPECT_DOUBLE_EQ(motion.duration(), 2.25);
    EXPECT_DOUBLE_EQ(motion.position(-1.0), 7.0);
    EXPECT_DOUBLE_EQ(motion.position(0.25), 13.25);
    EXPECT_DOUBLE_EQ(motion.position(1.25), 63.25);
    EXPECT_DOUBLE_EQ(motion.position(2.0), 100.75);
    EXPECT_DOUBLE_EQ(motion.position(2.125), 107.0 - 1.5625);
    EXPECT_EQ(motion.position(2.25), 107.0);
    EXPECT_DOUBLE_EQ(motion.velocity(1.0), 50.0);
}

// 7 mm at 28 mm/s^2 never reaches 100 mm/s: peak sqrt(7 * 28) = 14 mm/s after 0.5 s.
TEST(MovingAxis, AShortTrapezoidIsATriangle) {
    const Motion motion = Motion::between(5.0, -2.0, {100.0, 28.0});
    EXPECT_DOUBLE_EQ(motion.duration(), 1.0);
    EXPECT_DOUBLE_EQ(motion.position(0.5), 1.5);
    EXPECT_DOUBLE_EQ(motion.velocity(0.5), -14.0);
    EXPECT_EQ(motion.position(1.0), -2.0);
}

// 0.2 s of jerk, 0.05 s of 200 mm/s^2, 0.2 s of jerk: 50 mm/s after 0.45 s and 11.25 mm; 77.5 mm
// in 1.55 s; the same down.
TEST(MovingAxis, ALongSCurveHasSevenPieces) {
    const Motion motion = Motion::between(7.0, 107.0, {50.0, 200.0, 1000.0});
    EXPECT_EQ(motion.pieces().size(), 7U);
    EXPECT_NEAR(motion.duration(), 2.45, rounding);
    EXPECT_NEAR(motion.position(0.2), 7.0 + 1000.0 * 0.008 / 6.0, rounding);
    EXPECT_NEAR(motion.acceleration(0.225), 200.0, rounding);
    EXPECT_NEAR(motion.position(0.45), 18.25, rounding);
    EXPECT_NEAR(motion.velocity(1.0), 50.0, rounding);
    EXPECT_NEAR(motion.position(2.0), 95.75, rounding);
    EXPECT_EQ(motion.position(2.46), 107.0);
}

// j T^3 * 2 = 8 * 2 = 16 mm with T = 1 s, up to 8 mm/s and 8 mm/s^2.
TEST(MovingAxis, AShortSCurveReachesNeitherSpeedNorAcceleration) {
    const Motion motion = Motion::between(3.0, -13.0, {9.0, 10.0, 8.0});
    EXPECT_NEAR(motion.duration(), 4.0, rounding);
    EXPECT_NEAR(motion.position(2.0), -5.0, rounding);
    EXPECT_NEAR(motion.velocity(2.0), -8.0, rounding);
    EXPECT_NEAR(motion.acceleration(1.0), -8.0, rounding);
}

// a (T + C) (2 T + C) = 4 * 2 * 2.5 = 20 mm with T = 0.5 s and C = 1.5 s, up to 8 mm/s.
TEST(MovingAxis, AMediumSCurveReachesTheAccelerationOnly) {
    const Motion motion = Motion::between(0.0, 20.0, {9.0, 4.0, 8.0});
    EXPECT_NEAR(motion.duration(), 5.0, rounding);
    EXPECT_NEAR(motion.velocity(2.5), 8.0, rounding);
    EXPECT_NEAR(motion.acceleration(1.0), 4.0, rounding);
}

TEST(MovingAxis, BrakingATrapezoidEndsAfterVSquaredOverTwoA) {
    const Motion motion = Motion::braking(5.0, -30.0, -60.0, {1.0, 60.0});
    EXPECT_DOUBLE_EQ(motion.duration(), 0.5);
    EXPECT_DOUBLE_EQ(motion.end(), -2.5);
    EXPECT_DOUBLE_EQ(motion.position(0.25), 5.0 - 30.0 * 0.25 + 30.0 * 0.0625);
}

// While it still speeds up at 200 mm/s^2: 0.4 s until that is -200 mm/s^2 (25.3333 mm, again at
// 50 mm/s), 0.15 s with it (5.25 mm, down to 20 mm/s), 0.2 s back to 0 (1.3333 mm).
TEST(MovingAxis, BrakingAnSCurveTurnsTheAccelerationRound) {
    const Motion motion = Motion::braking(3.0, 50.0, 200.0, {1.0, 200.0, 1000.0});
    EXPECT_NEAR(motion.duration(), 0.75, rounding);
    EXPECT_NEAR(motion.velocity(0.4), 50.0, rounding);
    EXPECT_NEAR(motion.velocity(0.55), 20.0, rounding);
    EXPECT_NEAR(motion.end(), 3.0 + 76.0 / 3.0 + 5.25 + 4.0 / 3.0, rounding);
}

TEST(MovingAxis, NowhereToGoTakesNoTime) {
    for (const MotionLimits& limits : {MotionLimits{5.0, 3.0}, MotionLimits{5.0, 3.0, 2.0}}) {
        EXPECT_EQ(Motion::between(7.0, 7.0, limits).duration(), 0.0);
        EXPECT_EQ(Motion::between(7.0, 7.0, limits).position(0.0), 7.0);
        EXPECT_EQ(Motion::braking(7.0, 0.0, 0.0, limits).duration(), 0.0);
    }
    EXPECT_EQ(Motion(7.0).position(3.0), 7.0);
}

struct Case {
    std::string name;
    Motion motion;
    MotionLimits limits;
};

// Long, medium, short, tiny moves, and stops begun at every stage of a move.
std::vector<Case> all_kinds() {
    std::vector<Case> cases;
    for (const MotionLimits& limits :
         {MotionLimits{9.0, 17.0}, MotionLimits{9.0, 17.0, 70.0}, MotionLimits{9.0, 170.0, 70.0},
          MotionLimits{900.0, 17.0, 70.0}}) {
        for (const double way : {-70.0, 5.0, -0.3, 1e-6}) {
            const Motion move = Motion::between(3.0, 3.0 + way, limits);
            cases.push_back({"move", move, limits});
            for (int i = 1; i < 20; ++i) {
                const double t = move.duration() * i / 20.0;
                cases.push_back({"stop",
                                 Motion::braking(move.position(t), move.velocity(t),
                                                 move.acceleration(t), limits),
                                 limits});
            }
        }
    }
    return cases;
}

// The largest step that f makes between samples that are d apart, beyond what a slope allows.
template <class F>
double jump(F f, double until, double slope) {
    constexpr int samples = 2000;
    double worst = 0.0;
    for (int i = 0; i < samples; ++i) {
        const double t = until * i / samples, next = until * (i + 1) / samples;
        worst = std::max(worst, std::abs(f(next) - f(t)) - slope * (next - t));
    }
    return worst;
}

TEST(MovingAxis, NeverJumpsAndKeepsItsLimits) {
    for (const Case& kind : all_kinds()) {
        const Motion& motion = kind.motion;
        const MotionLimits& limits = kind.limits;
        const double end = motion.duration();
        double speed = 0.0;
        for (const MotionPiece& piece : motion.pieces())
            speed = std::max(speed, std::abs(piece.velocity));
        if (kind.name == "move") {
            EXPECT_LE(speed, limits.speed * (1.0 + 1e-12));
        }
        // A stop that is begun while the axis speeds up goes beyond the speed of the move.
        const double fastest = speed + limits.acceleration * limits.acceleration / limits.jerk;
        EXPECT_LE(jump([&](double t) { return motion.position(t); }, end, fastest), rounding);
        EXPECT_LE(jump([&](double t) { return motion.velocity(t); }, end, limits.acceleration),
                  rounding * 17.0);
        if (std::isfinite(limits.jerk)) {
            EXPECT_LE(jump([&](double t) { return motion.acceleration(t); }, end, limits.jerk),
                      1e-9);
        }
    }
}

// Independent of the cubics: the velocity's integral by the midpoint rule. A step errs by less than
// j h^3 / 24 inside a piece and a h^2 / 4 at a corner, of which there are at most eight.
TEST(MovingAxis, PositionIsTheIntegralOfVelocity) {
    for (const auto& [name, motion, limits] : all_kinds()) {
        constexpr int steps = 2000;
        const double h = motion.duration() / steps;
        double integral = motion.start();
        for (int i = 0; i < steps; ++i)
            integral += motion.velocity((i + 0.5) * h) * h;
        const double jerk = std::isfinite(limits.jerk) ? limits.jerk : 0.0;
        const double bound =
            steps * jerk * h * h * h / 24.0 + 8 * limits.acceleration * h * h / 4.0 + rounding;
        EXPECT_NEAR(integral, motion.end(), bound) << name;
        EXPECT_NEAR(motion.velocity(motion.duration() * (1.0 - 1e-12)), 0.0,
                    limits.acceleration * motion.duration() * 1e-11 + rounding)
            << name;
    }
}

}  // namespace
}  // namespace etalon
