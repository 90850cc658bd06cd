// Prints how often the intervals of an omnidirectional lens's parameters hold the truth at several
// levels of noise: value +- t u with u as found, with u at the truth, and the profile's.
// docs/calibration.md has the table of xi and k2. `omnidirectional_intervals RUNS`, default 1000:
// some minutes.
#include <cstdio>
#include <cstdlib>

#include "calib/intrinsics/calibration_covariance.h"
#include "tests/calib/synthetic_views.h"

namespace etalon {
namespace {

struct Sums {
    double held = 0.0, held_at_truth = 0.0, profile = 0.0;
    double bias = 0.0, squares = 0.0, cubes = 0.0, found = 0.0;  // in units of u at the truth

    void print(const std::string& name, double runs) const {
        std::printf(
            "  %-4s holds %5.1f %%, with u at the truth %5.1f %%, profile %5.1f %%; bias %+.2f, "
            "scatter %.2f, u found %.2f, skewness %+.1f\n",
            name.c_str(), 100.0 * held / runs, 100.0 * held_at_truth / runs, 100.0 * profile / runs,
            bias / runs, std::sqrt(squares / runs), std::sqrt(found / runs), cubes / runs);
    }
};

Eigen::VectorXd deviations(std::span<const CalibrationView> observed, const CameraFit& fit,
                           const CalibrationModel& model) {
    return inverse_information(view_equations(observed, fit), model).diagonal().cwiseSqrt();
}

std::vector<CalibrationView> with_noise(std::vector<CalibrationView> views, double noise_px,
                                        int run) {
    RandomStream random(run, 20);
    for (CalibrationView& view : views)
        for (Eigen::Vector2d& pixel : view.pixels)
            pixel += noise_px * Eigen::Vector2d{random.normal(), random.normal()};
    return views;
}

void print_intervals(double noise_px, int runs) {
    const CameraModel truth = test::wide_models()[4].truth;
    const CalibrationModel& model = calibration_model("omnidirectional");
    CameraStart start{truth, {}};
    std::vector<CalibrationView> exact;
    for (int v = 0; v < 8; ++v) {
        start.camera_from_target.push_back(test::wide_pose(v));
        exact.push_back(test::synthetic_view(truth, start.camera_from_target.back(), 0.0, 0));
    }
    const auto fitted = [&](const std::vector<CalibrationView>& observed) {
        return fit_camera(observed, test::image_size, model, {.start = start});
    };
    const Eigen::VectorXd values = parameters_of(truth, model),
                          u_at_truth = noise_px * deviations(exact, fitted(exact), model);
    const double t = profile_quantile(exact, model);
    std::vector<Sums> sums(model.parameters.size());
    int unconverged = 0;
    for (int run = 0; run < runs; ++run) {
        const auto observed = with_noise(exact, noise_px, run);
        const CameraFit fit = fitted(observed);
        unconverged += !fit.converged;
        const Eigen::VectorXd u = std::sqrt(fit.variance) * deviations(observed, fit, model);
        const Eigen::VectorXd error = parameters_of(fit.camera, model) - values;
        const auto profiles = profile_intervals(observed, fit, u);
        for (Eigen::Index i = 0; i < error.size(); ++i) {
            Sums& sum = sums[static_cast<std::size_t>(i)];
            const auto& profile = profiles[static_cast<std::size_t>(i)];
            const double z = error[i] / u_at_truth[i];
            sum.held += std::abs(error[i]) <= t * u[i];
            sum.held_at_truth += std::abs(z) <= t;
            sum.profile += profile && profile->low <= values[i] && values[i] <= profile->high;
            sum.bias += z;
            sum.squares += z * z;
            sum.cubes += z * z * z;
            sum.found += u[i] * u[i] / (u_at_truth[i] * u_at_truth[i]);
        }
    }
    std::printf("%g px, %d runs, %d not converged\n", noise_px, runs, unconverged);
    for (std::size_t i = 0; i < sums.size(); ++i)
        sums[i].print(model.parameters[i], runs);
}

}  // namespace
}  // namespace etalon

int main(int count, char** arguments) {
    const int runs = count > 1 ? std::atoi(arguments[1]) : 1000;
    for (const double noise_px : {0.1, 0.03, 0.01})
        etalon::print_intervals(noise_px, runs);
}
