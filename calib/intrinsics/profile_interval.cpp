#include "calib/intrinsics/profile_interval.h"

#include <cmath>

#include "calib/intrinsics/calibration_model.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

// The least sum of squares over all parameters but one, which is held.
class Profile {
public:
    Profile(std::span<const CalibrationView> views, cv::Size image_size,
            const CalibrationModel& model, const CameraFit& fit)
        : views_(views),
          image_size_(image_size),
          model_(model),
          fit_(fit),
          least_squares_(weighted_squares(views, fit)),
          covariance_(fit.variance *
                      inverse_information(view_equations(views, fit, model), model)) {}

    // From where the profile t is -t to where it is t. `linear` is how far that is from the value
    // where the parameter acts linearly.
    std::optional<ProfileInterval> interval(Eigen::Index parameter, double t, double linear) const {
        const double value = parameters_of(fit_.camera, model_)[parameter];
        const auto low = way(parameter, t, -linear), high = way(parameter, t, linear);
        if (!low || !high)
            return std::nullopt;
        return ProfileInterval{value + *low, value + *high};
    }
    double formal_deviation(Eigen::Index parameter) const {
        return std::sqrt(covariance_(parameter, parameter));
    }

private:
    // From the value to where the profile t is `t`: secants through the value until that is passed,
    // then between the ends; halfway back from where there is no fit.
    std::optional<double> way(Eigen::Index parameter, double t, double first) const {
        constexpr int most_steps = 15;
        constexpr double settled = 0.01, longest_stride = 2.0;
        double near = 0.0, near_t = 0.0, way = first;
        std::optional<double> far, far_t;
        for (int step = 0; step < most_steps; ++step) {
            const auto reached = t_at(parameter, way);
            if (reached && std::abs(*reached - t) < settled * t)
                return way;
            const bool is_passed = !reached || *reached > t;
            if (is_passed) {
                far = way;
                far_t = reached;
            } else {
                near = way;
                near_t = *reached;
            }
            if (far_t)
                way = near + (*far - near) * (t - near_t) / (*far_t - near_t);
            else if (far)
                way = 0.5 * (near + *far);
            else
                way *= std::min(t / near_t, longest_stride);
        }
        return std::nullopt;
    }

    // Started where the others would be if all were linear.
    std::optional<double> t_at(Eigen::Index parameter, double way) const {
        CalibrationModel held = model_;
        held.parameters.erase(held.parameters.begin() + parameter);
        CameraStart start{fit_.camera, fit_.camera_from_target};
        set_parameters(start.camera, model_,
                       parameters_of(fit_.camera, model_) +
                           covariance_.col(parameter) * (way / covariance_(parameter, parameter)));
        const auto fit =
            attempted([&] { return fit_camera(views_, image_size_, held, {.start = start}); });
        if (!fit || !fit.value->converged)
            return std::nullopt;
        return std::sqrt((weighted_squares(views_, *fit.value) - least_squares_) / fit_.variance);
    }

    std::span<const CalibrationView> views_;
    cv::Size image_size_;
    const CalibrationModel& model_;
    const CameraFit& fit_;
    double least_squares_;
    Eigen::MatrixXd covariance_;
};

}  // namespace

double profile_quantile(std::span<const CalibrationView> views, const CalibrationModel& model) {
    const int freedom = static_cast<int>(2 * point_count(views) - model.parameters.size()) -
                        pose_parameters(model.projection) * static_cast<int>(views.size());
    return student_t_quantile(0.025, freedom);
}

std::vector<std::optional<ProfileInterval>> profile_intervals(
    std::span<const CalibrationView> views, cv::Size image_size, const CalibrationModel& model,
    const CameraFit& fit, const Eigen::VectorXd& deviations) {
    std::vector<std::optional<ProfileInterval>> intervals(model.parameters.size());
    if (!(fit.variance > 0.0) || !fit.pull.isZero())
        return intervals;
    const Profile profile(views, image_size, model, fit);
    const double quantile = profile_quantile(views, model);
    cv::parallel_for_(
        cv::Range(0, static_cast<int>(intervals.size())), [&](const cv::Range& range) {
            for (int i = range.start; i < range.end; ++i)
                intervals[static_cast<std::size_t>(i)] =
                    profile.interval(i, quantile * deviations[i] / profile.formal_deviation(i),
                                     quantile * deviations[i]);
        });
    return intervals;
}

}  // namespace etalon
