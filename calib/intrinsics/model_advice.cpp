#include "calib/intrinsics/model_advice.h"

#include <algorithm>
#include <cmath>

#include "core/errors.h"

namespace etalon {
namespace {

double sum_of_squares(const std::vector<Eigen::Vector2d>& residuals) {
    double sum = 0.0;
    for (const Eigen::Vector2d& residual : residuals)
        sum += residual.squaredNorm();
    return sum;
}

double rms(double sum, std::span<const CalibrationView> views) {
    return std::sqrt(sum / static_cast<double>(point_count(views)));
}

ModelScore fitted_score(std::span<const CalibrationView> views, cv::Size image_size,
                        const CalibrationModel& model) {
    ModelScore score;
    score.model = model.name;
    score.parameters = static_cast<int>(model.parameters.size());
    auto fit = attempted([&] { return fit_camera(views, image_size, model); });
    score.fit = std::move(fit.value);
    score.failure = fit.cause;
    if (!score.fit)
        return score;
    double squares = 0.0;
    for (const auto& residuals : score.fit->residuals_px)
        squares += sum_of_squares(residuals);
    score.rms_px = rms(squares, views);
    return score;
}

template <class Element>
std::vector<Element> without(std::span<const Element> all, std::size_t left_out) {
    std::vector<Element> rest(all.begin(), all.end());
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(left_out));
    return rest;
}

// The sum of squares of a view's residuals.
using ViewLeftOut = Attempted<double>;

// The search starts from the fit to all views, which is near.
ViewLeftOut leave_out(std::span<const CalibrationView> views, cv::Size image_size,
                      const CalibrationModel& model, const CameraFit& all, std::size_t view) {
    return attempted([&] {
        const std::vector<Rigid> poses =
            without(std::span<const Rigid>(all.camera_from_target), view);
        const CameraModel camera = fit_camera(without(views, view), image_size, model,
                                              {.start = CameraStart{all.camera, poses}})
                                       .camera;
        const Rigid pose = fit_view_pose(camera, views[view]);
        return sum_of_squares(view_residuals(camera, pose, views[view]));
    });
}

void set_left_out(ModelScore& score, std::span<const ViewLeftOut> left_out,
                  std::span<const CalibrationView> views) {
    double sum = 0.0;
    for (std::size_t i = 0; i < left_out.size(); ++i) {
        if (!left_out[i]) {
            score.failure = left_out[i].cause;
            score.failed_view = i;
            score.left_out_squares.clear();
            return;
        }
        score.left_out_squares.push_back(*left_out[i].value);
        sum += *left_out[i].value;
    }
    score.leave_one_out_rms_px = rms(sum, views);
}

template <class Task>
void for_each_index(std::size_t count, const Task& task) {
    cv::parallel_for_(cv::Range(0, static_cast<int>(count)), [&](const cv::Range& range) {
        for (int i = range.start; i < range.end; ++i)
            task(static_cast<std::size_t>(i));
    });
}

// Sum over the views of how much more this model's left-out squares are than the best one's, and
// the standard error of that sum, both over the number of points.
void set_difference(ModelScore& score, const ModelScore& best,
                    std::span<const CalibrationView> views) {
    const double points = static_cast<double>(point_count(views));
    const double n = static_cast<double>(views.size());
    double sum = 0.0, squares = 0.0;
    for (std::size_t i = 0; i < views.size(); ++i)
        sum += score.left_out_squares[i] - best.left_out_squares[i];
    for (std::size_t i = 0; i < views.size(); ++i) {
        const double difference = score.left_out_squares[i] - best.left_out_squares[i];
        squares += (difference - sum / n) * (difference - sum / n);
    }
    score.above_best = sum / points;
    score.above_best_error = std::sqrt(n / (n - 1.0) * squares) / points;
}

bool predicts_worse(const ModelScore& richer, const ModelScore& advised) {
    if (!richer.leave_one_out_rms_px)
        return true;
    return richer.above_best > advised.above_best &&
           (richer.above_best > richer.above_best_error ||
            *richer.leave_one_out_rms_px > (1.0 + overfit_share) * *advised.leave_one_out_rms_px);
}

}  // namespace

// Every fit is a problem of its own and has its own place for the result, so that the number of
// threads cannot change it.
std::vector<ModelScore> score_models(std::span<const CalibrationView> views, cv::Size image_size,
                                     std::span<const CalibrationModel> models,
                                     bool leave_out_views) {
    std::vector<ModelScore> scores(models.size());
    for_each_index(models.size(),
                   [&](std::size_t i) { scores[i] = fitted_score(views, image_size, models[i]); });
    if (!leave_out_views || views.size() < 4)
        return scores;
    std::vector<ViewLeftOut> left_out(models.size() * views.size());
    for_each_index(left_out.size(), [&](std::size_t i) {
        const std::size_t model = i / views.size(), view = i % views.size();
        if (scores[model].fit)
            left_out[i] = leave_out(views, image_size, models[model], *scores[model].fit, view);
    });
    for (std::size_t i = 0; i < models.size(); ++i)
        if (scores[i].fit)
            set_left_out(scores[i], std::span(left_out).subspan(i * views.size(), views.size()),
                         views);
    return scores;
}

ModelAdvice compare_models(std::vector<ModelScore> scores, std::span<const CalibrationView> views) {
    ModelAdvice advice{std::move(scores), std::nullopt, std::nullopt};
    for (std::size_t i = 0; i < advice.models.size(); ++i) {
        const auto& error = advice.models[i].leave_one_out_rms_px;
        if (error && (!advice.best || *error < *advice.models[*advice.best].leave_one_out_rms_px))
            advice.best = i;
    }
    if (!advice.best)
        return advice;
    for (std::size_t i = 0; i < advice.models.size(); ++i) {
        ModelScore& score = advice.models[i];
        if (!score.leave_one_out_rms_px)
            continue;
        set_difference(score, advice.models[*advice.best], views);
        if (!advice.advised && score.above_best <= score.above_best_error)
            advice.advised = i;
    }
    for (std::size_t i = *advice.advised + 1; i < advice.models.size(); ++i)
        advice.models[i].overfits =
            predicts_worse(advice.models[i], advice.models[*advice.advised]);
    return advice;
}

}  // namespace etalon
