// The twin's servo with time constants 1 : 1 000 000 apart, in one step, against its closed form.
#include <fmt/format.h>

#include <complex>

#include "bench/stability/stability_case.h"
#include "sim/twin/servo.h"

namespace etalon {
namespace {

using Complex = std::complex<long double>;

constexpr double bound = 1e-12;  // of a step of 1
constexpr double min_s = 1e-9, max_s = 1e6;

std::array<Complex, 2> pole_pair(double frequency_hz, double damping) {
    const long double w = 2.0L * std::numbers::pi_v<long double> * frequency_hz, z = damping;
    const Complex pole = w * Complex(-z, std::sqrt(1.0L - z * z));
    return {pole, std::conj(pole)};
}

// Where the carriage is t seconds after the planned position jumped from 0 to 1: the transfer
// function of sim/twin/servo.h in partial fractions. Underdamped, everything left in.
double step_response(const ServoParameters& p, double t) {
    const auto [s1, s2] = pole_pair(p.bandwidth_hz, p.damping);
    const auto [r1, r2] = pole_pair(p.resonance_hz, p.resonance_damping);
    const Complex drive = -1.0L / p.drive_lag;
    const std::array<Complex, 5> poles = {drive, s1, s2, r1, r2};
    Complex response = 1.0L;
    for (std::size_t k = 0; k < poles.size(); ++k) {
        Complex residue = -drive * s1 * s2 * (r1 * r2 - (r1 + r2) * poles[k]) / poles[k];
        for (std::size_t other = 0; other < poles.size(); ++other)
            residue /= other == k ? 1.0L : poles[k] - poles[other];
        response += residue * std::exp(poles[k] * Complex(t));
    }
    return static_cast<double>(response.real());
}

// One step from the jump to each of 300 times, evenly in the logarithm.
StabilityOutcome in_one_step(const ServoParameters& parameters) {
    constexpr int times = 300;
    const Servo servo(parameters);
    double worst = 0.0, worst_at = 0.0;
    for (int i = 0; i <= times; ++i) {
        const double t = min_s * std::pow(max_s / min_s, double(i) / times);
        const auto state = servo.advance(servo.at_rest(0.0), Motion(1.0), 0.0, t);
        const double error = std::abs(servo.carriage(state) - step_response(parameters, t));
        if (!(error <= worst)) {
            worst = error;
            worst_at = t;
        }
    }
    return at_most(
        bound, worst,
        fmt::format("steps of {} s to {} s, the worst {:.2g} s", min_s, max_s, worst_at));
}

// A move with limited jerk and its ringing: the number of steps does not matter, nor the end.
StabilityOutcome in_many_steps(const ServoParameters& parameters) {
    constexpr double rings_s = 4.0, rests_s = 300.0;
    const Servo servo(parameters);
    const Motion motion = Motion::between(0.0, 1.0, {0.4, 1.3, 7.0});
    const auto at_once = servo.advance(servo.at_rest(0.0), motion, 0.0, rings_s);
    const auto at_rest = servo.advance(at_once, motion, rings_s, rests_s);
    double worst = std::abs(servo.carriage(at_rest) - motion.end());
    for (const int steps : {2, 7, 50, 1000}) {
        auto state = servo.at_rest(0.0);
        for (int i = 0; i < steps; ++i)
            state = servo.advance(state, motion, rings_s * i / steps, rings_s * (i + 1) / steps);
        worst = std::max(worst, (state - at_once).cwiseAbs().maxCoeff());
    }
    return at_most(bound, worst, "by 2 to 1000 steps, all at once, and from the target");
}

StabilityCase servo_case(const std::string& name, StabilityOutcome (*run)(const ServoParameters&),
                         const ServoParameters& parameters) {
    return without_render("stiff servo: " + name, "closed form, relative",
                          [=] { return run(parameters); });
}

}  // namespace

std::vector<StabilityCase> servo_cases() {
    // A motor of 0.1 s behind a drive of 0.1 us; a motor of 100 s with a carriage of 0.1 ms.
    const ServoParameters stiff_drive{.drive_lag = 1e-7,
                                      .bandwidth_hz = 1.6,
                                      .damping = 0.7,
                                      .resonance_hz = 37.0,
                                      .resonance_damping = 0.02};
    const ServoParameters stiff_carriage{.drive_lag = 1e-3,
                                         .bandwidth_hz = 1.6e-3,
                                         .damping = 0.7,
                                         .resonance_hz = 1.6e3,
                                         .resonance_damping = 0.02};
    return {servo_case("drive, 1 : 1e6", in_one_step, stiff_drive),
            servo_case("carriage, 1 : 1e6", in_one_step, stiff_carriage),
            servo_case("any steps", in_many_steps, stiff_drive)};
}

}  // namespace etalon
