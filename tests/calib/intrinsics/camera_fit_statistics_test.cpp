// Whether the covariances that a fit states are what independent noise does to it: 2000
// calibrations of the same eight views, each with noise of its own.
//
// 47 statements are tested, of which the wrong ones shall be less than one in a hundred test
// programs: each at 0.01 / 47, 3.7 standard errors two-sided. Seeds are the run's number.

#include <cstdio>

#include "calib/intrinsics/calibration_covariance.h"
#include "core/statistics/distributions.h"
#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr int runs = 2000, views = 8, points = 54, parameters = 9;
constexpr int freedom =
    2 * views * points - parameters - 6 * views;  // up to 15 more: the same here
constexpr double noise_px = 0.1;

// Of nine rays through the image, the outer ones so many pixels from the middle.
std::vector<Eigen::Vector3d> rays(const CameraModel& camera, const Eigen::Vector2d& from_middle) {
    const Projector projector(camera);
    std::vector<Eigen::Vector3d> all;
    for (const double y : {-1.0, 0.0, 1.0})
        for (const double x : {-1.0, 0.0, 1.0}) {
            const Eigen::Vector2d pixel =
                Eigen::Vector2d(320.0, 240.0) + from_middle.cwiseProduct(Eigen::Vector2d(x, y));
            all.push_back(projector.ray(pixel).value());
        }
    return all;
}
const Eigen::Vector2d image_corner(290.0, 220.0);

struct Calibrated {
    Eigen::VectorXd error, u;              // of the parameters
    Eigen::VectorXd pixel_error, pixel_u;  // of where the rays land, x and y in turn
    double distance = 0.0;                 // Mahalanobis, squared, over the number of parameters
};

// Boards over all of the image, near enough to fill half of it.
Rigid near_pose(int view) {
    const double turn = 2.4 * view;
    const Eigen::Quaterniond rotation = rotation_from_vector(
        {0.55 * std::cos(turn), 0.5 * std::sin(turn), 0.15 * std::sin(5 * turn)});
    const Eigen::Vector3d place(45.0 * (view % 3 - 1), 30.0 * (view / 3 - 1),
                                310.0 + 40.0 * std::sin(4 * turn));
    return {rotation, place - rotation * Eigen::Vector3d(100, 62.5, 0)};
}

class Experiment {
public:
    explicit Experiment(const CameraModel& truth = calibration_truth(),
                        const std::string& model = "standard",
                        const Eigen::Vector2d& from_middle = image_corner,
                        Rigid (*pose)(int) = near_pose)
        : truth_(truth), model_(calibration_model(model)), rays_(rays(truth_, from_middle)) {
        for (int v = 0; v < views; ++v) {
            poses_.push_back(pose(v));
            exact_.push_back(truth_.projection.kind == Projection::telecentric
                                 ? telecentric_view(truth_, poses_.back(), 0.0, 0)
                                 : synthetic_view(truth_, poses_.back(), 0.0, 0));
        }
    }

    std::vector<CalibrationView> noisy(int run) const {
        RandomStream random(run, 20);
        std::vector<CalibrationView> noisy = exact_;
        for (CalibrationView& view : noisy)
            for (Eigen::Vector2d& pixel : view.pixels)
                pixel += noise_px * Eigen::Vector2d{random.normal(), random.normal()};
        return noisy;
    }

    // Started at the truth, which is faster and ends at the same minimum (the test below).
    CameraFit fitted(std::span<const CalibrationView> observed) const {
        return fit_camera(observed, image_size, model_, {.start = CameraStart{truth_, poses_}});
    }

    Calibrated calibrate(int run) const {
        const auto observed = noisy(run);
        const CameraFit fit = fitted(observed);
        EXPECT_TRUE(fit.converged) << run;
        const Eigen::MatrixXd covariance =
            fit.variance * inverse_information(view_equations(observed, fit), model_);
        Calibrated result;
        result.error = parameters_of(fit.camera, model_) - parameters_of(truth_, model_);
        result.u = covariance.diagonal().cwiseSqrt();
        result.distance = result.error.dot(covariance.ldlt().solve(result.error)) /
                          static_cast<double>(result.error.size());
        project_rays(fit.camera, covariance, result);
        return result;
    }

    // Only where rays land, after the best rotation; nothing when the fit does not converge.
    std::optional<Calibrated> calibrate_rotated(int run) const {
        const auto observed = noisy(run);
        const CameraFit fit = fitted(observed);
        if (!fit.converged)
            return std::nullopt;
        const Eigen::MatrixXd covariance =
            fit.variance * inverse_information(view_equations(observed, fit), model_);
        ImageRays seen{{}, rays_};
        Eigen::VectorXd error(2 * std::ssize(rays_));
        for (std::size_t i = 0; i < rays_.size(); ++i) {
            seen.pixels.push_back(pixel(fit.camera, rays_[i]));
            error.segment<2>(2 * static_cast<Eigen::Index>(i)) =
                seen.pixels.back() - pixel(truth_, rays_[i]);
        }
        const Eigen::MatrixXd turned = rotation_jacobian(fit.camera, seen);
        const Eigen::VectorXd alike = Eigen::VectorXd::Ones(std::ssize(rays_));
        const Eigen::MatrixXd moved =
            less_best_rotation(parameter_jacobian(fit.camera, seen, model_), turned, alike);
        Calibrated result;
        result.pixel_error = less_best_rotation(error, turned, alike);
        result.pixel_u = (moved * covariance * moved.transpose()).diagonal().cwiseSqrt();
        return result;
    }

    const CalibrationModel& model() const { return model_; }

private:
    void project_rays(const CameraModel& camera, const Eigen::MatrixXd& covariance,
                      Calibrated& run) const {
        const Eigen::Index count = static_cast<Eigen::Index>(2 * rays_.size());
        run.pixel_error.resize(count);
        run.pixel_u.resize(count);
        for (std::size_t i = 0; i < rays_.size(); ++i) {
            const Eigen::Matrix2Xd jacobian = parameter_jacobian(camera, rays_[i], model_);
            const Eigen::Matrix2d of_pixel = jacobian * covariance * jacobian.transpose();
            const auto at = static_cast<Eigen::Index>(2 * i);
            run.pixel_error.segment<2>(at) = pixel(camera, rays_[i]) - pixel(truth_, rays_[i]);
            run.pixel_u.segment<2>(at) = of_pixel.diagonal().cwiseSqrt();
        }
    }

    static Eigen::Vector2d pixel(const CameraModel& camera, const Eigen::Vector3d& ray) {
        return PixelModel<double>(camera.projection, all_parameters(camera))(ray).pixel;
    }

    const CameraModel truth_;
    const CalibrationModel& model_;
    std::vector<Eigen::Vector3d> rays_;
    std::vector<Rigid> poses_;
    std::vector<CalibrationView> exact_;
};

// P(F <= f) of Fisher's distribution by Simpson's rule on the beta density.
double f_probability(double f, double m, double n) {
    constexpr int steps = 400;
    const double end = m * f / (m * f + n), a = 0.5 * m, b = 0.5 * n;
    const double scale = std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b);
    double sum = 0.0;
    for (int i = 1; i <= steps; ++i) {
        const double x = end * i / steps;
        const double weight = i == steps ? 1.0 : i % 2 == 1 ? 4.0 : 2.0;
        sum += weight * std::exp(scale + (a - 1) * std::log(x) + (b - 1) * std::log1p(-x));
    }
    return sum * end / (3.0 * steps);
}

struct Column {
    double coverage, mean_error_in_u, scatter_over_u;
};

Column summary(const std::vector<double>& errors, const std::vector<double>& us) {
    const double quantile = student_t_quantile(0.025, freedom), n = std::ssize(errors);
    double inside = 0.0, mean = 0.0, squares = 0.0, stated = 0.0;
    for (std::size_t i = 0; i < errors.size(); ++i) {
        inside += std::abs(errors[i]) <= quantile * us[i];
        mean += errors[i] / us[i] / n;
        squares += errors[i] * errors[i] / n;
        stated += us[i] * us[i] / n;
    }
    return {inside / n, mean, std::sqrt(squares / stated)};
}

void print(const std::string& name, const Column& column) {
    std::printf("%-14s coverage %.4f  mean %+.3f u  scatter / u %.3f\n", name.c_str(),
                column.coverage, column.mean_error_in_u, column.scatter_over_u);
}

void expect_stated(const std::string& name, const Column& column, bool every_figure,
                   double limit = 3.7) {
    print(name, column);
    EXPECT_NEAR(column.coverage, 0.95, limit * std::sqrt(0.95 * 0.05 / runs)) << name;
    if (!every_figure)
        return;
    EXPECT_NEAR(column.mean_error_in_u, 0.0, limit / std::sqrt(runs)) << name;
    EXPECT_NEAR(column.scatter_over_u, 1.0, limit / std::sqrt(2.0 * runs)) << name;
}

// Mahalanobis distances in twenty classes of equal probability under Fisher's distribution.
// Pearson's statistic has 19 degrees of freedom; its quantile at 1 - 0.01/47 is 49 (Wilson and
// Hilferty).
void expect_fisher(const std::vector<Calibrated>& all) {
    constexpr int classes = 20;
    std::vector<double> counts(classes);
    double mean = 0.0, pearson = 0.0;
    for (const Calibrated& run : all) {
        const double p = f_probability(run.distance, parameters, freedom);
        ++counts[std::clamp(static_cast<int>(classes * p), 0, classes - 1)];
        mean += run.distance / runs;
    }
    const double expected = static_cast<double>(runs) / classes;
    for (const double count : counts)
        pearson += (count - expected) * (count - expected) / expected;
    const double n = freedom, m = parameters;
    const double deviation =
        std::sqrt(2.0 * n * n * (m + n - 2) / (m * (n - 2) * (n - 2) * (n - 4)) / runs);
    std::printf("Mahalanobis    mean %.4f, expected %.4f +- %.4f; chi-square %.1f of 19 degrees\n",
                mean, n / (n - 2), deviation, pearson);
    EXPECT_NEAR(mean, n / (n - 2), 3.7 * deviation);
    EXPECT_LT(pearson, 49.0);
}

Column column_of(const std::vector<Calibrated>& all, Eigen::Index i,
                 Eigen::VectorXd Calibrated::*error, Eigen::VectorXd Calibrated::*u) {
    std::vector<double> errors, us;
    for (const Calibrated& run : all) {
        errors.push_back((run.*error)[i]);
        us.push_back((run.*u)[i]);
    }
    return summary(errors, us);
}
Column parameter_column(const std::vector<Calibrated>& all, Eigen::Index i) {
    return column_of(all, i, &Calibrated::error, &Calibrated::u);
}
Column ray_column(const std::vector<Calibrated>& all, Eigen::Index i) {
    return column_of(all, i, &Calibrated::pixel_error, &Calibrated::pixel_u);
}

std::string ray_name(int i) {
    return "ray " + std::to_string(i / 2) + (i % 2 ? " y" : " x");
}

void expect_stated_rays(const std::vector<Calibrated>& all, double limit = 3.7) {
    for (int i = 0; i < 18; ++i)
        expect_stated(ray_name(i), ray_column(all, i), false, limit);
}

std::vector<Calibrated> calibrations(const Experiment& experiment) {
    std::vector<Calibrated> all;
    const auto start = std::chrono::steady_clock::now();
    for (int run = 0; run < runs; ++run)
        all.push_back(experiment.calibrate(run));
    const std::chrono::duration<double, std::milli> taken =
        std::chrono::steady_clock::now() - start;
    std::printf("%s: %d calibrations of %d views x %d points, %.2f ms each\n",
                experiment.model().name.c_str(), runs, views, points, taken.count() / runs);
    return all;
}

TEST(CameraFitStatistics, StatedCovariancesAreWhatNoiseDoes) {
    const Experiment experiment;
    const std::vector<Calibrated> all = calibrations(experiment);
    for (int i = 0; i < parameters; ++i)
        expect_stated(experiment.model().parameters[i], parameter_column(all, i), true);
    expect_stated_rays(all);
    expect_fisher(all);
}

// Richer models hold parameters that the views hardly tell apart, and what is known of them before
// is a part of what is stated. Among the points, after the best rotation, rays land where they
// should at least as often as said, and the statement is not far too wide. Fits at the border of
// where the model is regular do not converge, say so, and are not advised: few. 18 coordinates a
// model at 0.01 / 36 one-sided: 3.5 standard errors below `coverage`.
void expect_rays_covered(const CameraModel& truth, const std::string& model, double coverage,
                         Rigid (*pose)(int) = near_pose) {
    constexpr int fewer = 400;
    const Experiment experiment(truth, model, {190.0, 130.0}, pose);
    std::vector<Calibrated> all;
    for (int run = 0; run < fewer; ++run)
        if (auto calibrated = experiment.calibrate_rotated(run))
            all.push_back(std::move(*calibrated));
    const double count = std::ssize(all);
    std::printf("%s: %.0f of %d converge\n", model.c_str(), count, fewer);
    EXPECT_GT(count, 0.8 * fewer);
    for (int i = 0; i < 18; ++i) {
        const Column column = ray_column(all, i);
        print(ray_name(i), column);
        EXPECT_GT(column.coverage, coverage - 3.5 * std::sqrt(coverage * (1.0 - coverage) / count));
        EXPECT_GT(column.scatter_over_u, 0.7);
    }
}

// Of wide lenses: parameters and rays, out to 100 degrees. 123 statements at 0.01 / 123: 4.0
// standard errors. Of the omnidirectional model focal length, xi, k1 and k2 trade for each other so
// freely that these five are not normal: value +- 1.96 u holds 88 % or more of them, 95 % of the
// rays. What holds 95 % of them is the next test's.
TEST(CameraFitStatistics, StatedCovariancesOfWideLensesAreWhatNoiseDoes) {
    const std::set<std::string> trading{"fx", "fy", "k1", "k2", "xi"};
    for (const auto& [name, truth] : wide_models()) {
        if (name == std::string("field_of_view") || name == std::string("extended_unified"))
            continue;  // as double_sphere, with less to tell
        const Experiment experiment(truth, name, {230.0, 150.0}, wide_pose);
        const std::vector<Calibrated> all = calibrations(experiment);
        for (Eigen::Index i = 0; i < all.front().error.size(); ++i) {
            const std::string& parameter = experiment.model().parameters[std::size_t(i)];
            const Column column = parameter_column(all, i);
            if (name == std::string("omnidirectional") && trading.contains(parameter))
                EXPECT_GT(column.coverage, 0.88 - 4.0 * std::sqrt(0.88 * 0.12 / runs)) << parameter;
            else
                expect_stated(parameter, column, true, 4.0);
        }
        expect_stated_rays(all, 4.0);
    }
}

// The points' own intervals (calib/intrinsics/calibration_covariance.h) hold where u does not say
// enough: 9 parameters at 0.01 / 9, 3.3 standard errors of 300 runs.
TEST(CameraFitStatistics, ProfileIntervalsOfAnOmnidirectionalLensHoldTheTruth) {
    constexpr int fewer = 300;
    const CameraModel truth = wide_models()[4].truth;
    const Experiment experiment(truth, "omnidirectional", {230.0, 150.0}, wide_pose);
    const Eigen::VectorXd values = parameters_of(truth, experiment.model());
    Eigen::VectorXd inside = Eigen::VectorXd::Zero(values.size());
    double skewness = 0.0;
    for (int run = 0; run < fewer; ++run) {
        const auto observed = experiment.noisy(run);
        const CameraFit fit = experiment.fitted(observed);
        const Eigen::MatrixXd formal =
            fit.variance * inverse_information(view_equations(observed, fit), experiment.model());
        const auto intervals = profile_intervals(observed, fit, formal.diagonal().cwiseSqrt());
        for (Eigen::Index i = 0; i < values.size(); ++i) {
            const auto& interval = intervals[static_cast<std::size_t>(i)];
            ASSERT_TRUE(interval) << run << " " << i;
            inside[i] += interval->low <= values[i] && values[i] <= interval->high;
        }
        const double xi = parameters_of(fit.camera, experiment.model())[8];
        skewness += (intervals[8]->high - xi) / (xi - intervals[8]->low) / fewer;
    }
    for (Eigen::Index i = 0; i < values.size(); ++i) {
        std::printf("%-4s %.4f\n", experiment.model().parameters[std::size_t(i)].c_str(),
                    inside[i] / fewer);
        EXPECT_NEAR(inside[i] / fewer, 0.95, 3.3 * std::sqrt(0.95 * 0.05 / fewer)) << i;
    }
    EXPECT_LT(skewness, 0.95);  // xi is farther below than above
}

// Of the distortion of telecentric_truth() what a model has; with p1 and p2 a stronger one, which
// tells its centre to half a pixel.
CameraModel telecentric_lens_for(const std::string& model) {
    CameraModel truth = telecentric_truth();
    Distortion& d = truth.distortion;
    if (model == "telecentric")
        d = {};
    else if (model == "telecentric_radial")
        d = {.k1 = d.k1, .k2 = d.k2};
    else
        d = {.k1 = -2.1e-4, .k2 = 1.7e-6, .p1 = d.p1, .p2 = d.p2, .k3 = d.k3};
    return truth;
}

// Parameters and rays. 105 statements at 0.01 / 105: 3.9 standard errors.
TEST(CameraFitStatistics, StatedCovariancesOfTelecentricLensesAreWhatNoiseDoes) {
    for (const CalibrationModel& model : telecentric_calibration_models()) {
        const CameraModel truth = telecentric_lens_for(model.name);
        const Experiment experiment(truth, model.name, image_corner, telecentric_pose);
        const std::vector<Calibrated> all = calibrations(experiment);
        for (Eigen::Index i = 0; i < all.front().error.size(); ++i)
            expect_stated(model.parameters[std::size_t(i)], parameter_column(all, i), true, 3.9);
        expect_stated_rays(all, 3.9);
    }
}

CameraModel rational_lens(double prism, double tilt) {
    CameraModel truth = calibration_truth();
    truth.distortion = {.k1 = 0.31,
                        .k2 = -0.12,
                        .p1 = 0.0004,
                        .p2 = -0.0007,
                        .k3 = 0.02,
                        .k4 = 0.66,
                        .k5 = -0.05,
                        .k6 = 0.04,
                        .s1 = prism,
                        .s2 = -0.5 * prism,
                        .s3 = 0.7 * prism,
                        .s4 = 0.2 * prism,
                        .tau_x = tilt,
                        .tau_y = -0.65 * tilt};
    return truth;
}

TEST(CameraFitStatistics, RaysOfARationalModelAreCovered) {
    expect_rays_covered(rational_lens(0.0, 0.0), "rational", 0.95);
}

// A distortion that tells its centre from p1 and p2 to 12 px only, so that they are far from
// normal: the rays' 95 % intervals hold 89 % or more.
TEST(CameraFitStatistics, RaysOfATelecentricModelAreNearlyCovered) {
    expect_rays_covered(telecentric_truth(), "telecentric_standard", 0.92, telecentric_pose);
}

// Tilt, prism and p1, p2 are told apart by what is quadratic in them only, so that the covariance
// at the solution is not quite that of the error: 95 % intervals hold 89 % or more.
TEST(CameraFitStatistics, RaysOfATiltedModelAreNearlyCovered) {
    expect_rays_covered(rational_lens(0.001, 0.02), "tilted", 0.92);
}

// Found from the views alone: the same to a millionth of u.
TEST(CameraFitStatistics, TheStartDoesNotMatter) {
    const Experiment experiment;
    for (int run = 0; run < 20; ++run) {
        const CameraFit fit = fit_camera(experiment.noisy(run), image_size, experiment.model());
        const Calibrated warm = experiment.calibrate(run);
        const Eigen::VectorXd cold = parameters_of(fit.camera, experiment.model()) -
                                     parameters_of(calibration_truth(), experiment.model());
        EXPECT_LT((cold - warm.error).cwiseQuotient(warm.u).cwiseAbs().maxCoeff(), 1e-6) << run;
    }
}

}  // namespace
}  // namespace etalon
