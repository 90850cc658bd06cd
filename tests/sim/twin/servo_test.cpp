#include "sim/twin/servo.h"

#include "tests/test.h"

namespace etalon {
namespace {

using std::numbers::pi;

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
using Classic = Eigen::Vector<double, 5>;  // w, e, e', c, c'

Classic slope(const ServoParameters& p, const Classic& x, double r) {
    const double ws = 2 * pi * p.bandwidth_hz, wr = 2 * pi * p.resonance_hz;
    return {(r - x[0]) / p.drive_lag, x[2], ws * ws * (x[0] - x[1]) - 2 * p.damping * ws * x[2],
            x[4], wr * wr * (x[1] - x[3]) + 2 * p.resonance_damping * wr * (x[2] - x[4])};
}

Classic runge_kutta(const ServoParameters& p, const Motion& motion, double until, int steps) {
    const double h = until / steps, rest = motion.start();
    Classic x{rest, rest, 0.0, rest, 0.0};
    for (int i = 0; i < steps; ++i) {
        const double t = i * h, middle = motion.position(t + h / 2);
        const Classic k1 = slope(p, x, motion.position(t)), k2 = slope(p, x + h / 2 * k1, middle),
                      k3 = slope(p, x + h / 2 * k2, middle),
                      k4 = slope(p, x + h * k3, motion.position(t + h));
        x += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
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
            EXPECT_NEAR(servo.motor(state), fine[1], 2 * std::abs(fine[1] - coarse[1]) + 1e-11);
            EXPECT_NEAR(servo.carriage(state), fine[3], 2 * std::abs(fine[3] - coarse[3]) + 1e-11);
            EXPECT_LT(std::abs(fine[3] - coarse[3]), 1e-7);
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
    EXPECT_DOUBLE_EQ(motion.at(1.0).velocity, 50.0);
}

// 7 mm at 28 mm/s^2 never reaches 100 mm/s: peak sqrt(7 * 28) = 14 mm/s after 0.5 s.
TEST(MovingAxis, AShortTrapezoidIsATriangle) {
    const Motion motion = Motion::between(5.0, -2.0, {100.0, 28.0});
    EXPECT_DOUBLE_EQ(motion.duration(), 1.0);
    EXPECT_DOUBLE_EQ(motion.position(0.5), 1.5);
    EXPECT_DOUBLE_EQ(motion.at(0.5).velocity, -14.0);
    EXPECT_EQ(motion.position(1.0), -2.0);
}

// 0.2 s of jerk, 0.05 s of 200 mm/s^2, 0.2 s of jerk: 50 mm/s after 0.45 s and 11.25 mm; 77.5 mm
// in 1.55 s; the same down.
TEST(MovingAxis, ALongSCurveHasSevenPieces) {
    const Motion motion = Motion::between(7.0, 107.0, {50.0, 200.0, 1000.0});
    EXPECT_EQ(motion.pieces().size(), 7U);
    EXPECT_NEAR(motion.duration(), 2.45, rounding);
    EXPECT_NEAR(motion.position(0.2), 7.0 + 1000.0 * 0.008 / 6.0, rounding);
    EXPECT_NEAR(motion.at(0.225).acceleration, 200.0, rounding);
    EXPECT_NEAR(motion.position(0.45), 18.25, rounding);
    EXPECT_NEAR(motion.at(1.0).velocity, 50.0, rounding);
    EXPECT_NEAR(motion.position(2.0), 95.75, rounding);
    EXPECT_EQ(motion.position(2.46), 107.0);
}

// j T^3 * 2 = 8 * 2 = 16 mm with T = 1 s, up to 8 mm/s and 8 mm/s^2.
TEST(MovingAxis, AShortSCurveReachesNeitherSpeedNorAcceleration) {
    const Motion motion = Motion::between(3.0, -13.0, {9.0, 10.0, 8.0});
    EXPECT_NEAR(motion.duration(), 4.0, rounding);
    EXPECT_NEAR(motion.position(2.0), -5.0, rounding);
    EXPECT_NEAR(motion.at(2.0).velocity, -8.0, rounding);
    EXPECT_NEAR(motion.at(1.0).acceleration, -8.0, rounding);
}

// a (T + C) (2 T + C) = 4 * 2 * 2.5 = 20 mm with T = 0.5 s and C = 1.5 s, up to 8 mm/s.
TEST(MovingAxis, AMediumSCurveReachesTheAccelerationOnly) {
    const Motion motion = Motion::between(0.0, 20.0, {9.0, 4.0, 8.0});
    EXPECT_NEAR(motion.duration(), 5.0, rounding);
    EXPECT_NEAR(motion.at(2.5).velocity, 8.0, rounding);
    EXPECT_NEAR(motion.at(1.0).acceleration, 4.0, rounding);
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
    EXPECT_NEAR(motion.at(0.4).velocity, 50.0, rounding);
    EXPECT_NEAR(motion.at(0.55).velocity, 20.0, rounding);
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

struct MoveCase {
    std::string name;
    Motion motion;
    MotionLimits limits;
};

// Long, medium, short, tiny moves, and stops begun at every stage of a move.
std::vector<MoveCase> all_kinds() {
    std::vector<MoveCase> cases;
    for (const MotionLimits& limits :
         {MotionLimits{9.0, 17.0}, MotionLimits{9.0, 17.0, 70.0}, MotionLimits{9.0, 170.0, 70.0},
          MotionLimits{900.0, 17.0, 70.0}}) {
        for (const double way : {-70.0, 5.0, -0.3, 1e-6}) {
            const Motion move = Motion::between(3.0, 3.0 + way, limits);
            cases.push_back({"move", move, limits});
            for (int i = 1; i < 20; ++i) {
                const double t = move.duration() * i / 20.0;
                cases.push_back({"stop",
                                 Motion::braking(move.position(t), move.at(t).velocity,
                                                 move.at(t).acceleration, limits),
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
    for (const MoveCase& kind : all_kinds()) {
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
        EXPECT_LE(jump([&](double t) { return motion.at(t).velocity; }, end, limits.acceleration),
                  rounding * 17.0);
        if (std::isfinite(limits.jerk)) {
            EXPECT_LE(jump([&](double t) { return motion.at(t).acceleration; }, end, limits.jerk),
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
            integral += motion.at((i + 0.5) * h).velocity * h;
        const double jerk = std::isfinite(limits.jerk) ? limits.jerk : 0.0;
        const double bound =
            steps * jerk * h * h * h / 24.0 + 8 * limits.acceleration * h * h / 4.0 + rounding;
        EXPECT_NEAR(integral, motion.end(), bound) << name;
        EXPECT_NEAR(motion.at(motion.duration() * (1.0 - 1e-12)).velocity, 0.0,
                    limits.acceleration * motion.duration() * 1e-11 + rounding)
            << name;
    }
}

}  // namespace
}  // namespace etalon
