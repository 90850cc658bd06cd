#include "calib/intrinsics/model_advice.h"

#include <fmt/format.h>

#include <cmath>

#include "calib/camera/projector.h"
#include "calib/intrinsics/calibration_covariance.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

struct Half {
    CameraModel camera;
    std::size_t views = 0;
    CalibrationCovariances covariances;
};

Half calibrated_half(std::span<const CalibrationView> views, std::size_t first,
                     const CameraFit& all) {
    std::vector<CalibrationView> chosen;
    std::vector<Rigid> poses;
    for (std::size_t i = first; i < views.size(); i += 2) {
        chosen.push_back(views[i]);
        poses.push_back(all.camera_from_target[i]);
    }
    const CameraFit fit = refit_camera(chosen, all, std::move(poses));
    return {fit.camera, chosen.size(),
            covariances_of(view_equations(chosen, fit), fit.model, fit.variance)};
}

// Of the rays, which of a telecentric camera have Z = 1 mm: a turn of theirs about x or y is a
// shift, which need not be small.
Rigid motion_of_rays(const Eigen::Vector3d& turn, Projection projection) {
    if (projection != Projection::telecentric)
        return {rotation_from_vector(turn), Eigen::Vector3d::Zero()};
    return {rotation_from_vector({0.0, 0.0, turn.z()}), {turn.y(), -turn.x(), 0.0}};
}

// Mean over the rays of the squared length that displacements of this covariance have.
double mean_square(const Eigen::MatrixXd& moved, const Eigen::MatrixXd& covariance) {
    return (moved * covariance).cwiseProduct(moved).sum() /
           (0.5 * static_cast<double>(moved.rows()));
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
    score.rms_px = score.fit->rms_px();
    return score;
}

// Of scores in the order of the models.
void set_doubts_about_kind(std::vector<ModelScore>& scores,
                           std::span<const CalibrationModel> models) {
    std::size_t best = 0;
    for (std::size_t i = 0; i < scores.size(); ++i)
        if (scores[i].fit && (!scores[best].fit || scores[i].rms_px < scores[best].rms_px))
            best = i;
    for (std::size_t i = 0; i < scores.size(); ++i) {
        const LensProjection kind{models[i].projection}, of_best{models[best].projection};
        if (scores[i].fit && kind.is_flat() != of_best.is_flat() &&
            scores[i].rms_px > max_above_other_kind * scores[best].rms_px)
            scores[i].doubt = fmt::format("it leaves {:.2g} px in the fit, {} {:.2g} px",
                                          scores[i].rms_px, models[best].name, scores[best].rms_px);
    }
}

template <class Element>
std::vector<Element> without(std::span<const Element> all, std::size_t left_out) {
    std::vector<Element> rest(all.begin(), all.end());
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(left_out));
    return rest;
}

// The sum of squares of a view's residuals.
using ViewLeftOut = Result<double>;

// The search starts from the fit to all views, which is near.
ViewLeftOut leave_out(std::span<const CalibrationView> views, const CameraFit& all,
                      std::size_t view) {
    return attempted([&] {
        const std::span<const Rigid> poses = all.camera_from_target;
        const CameraModel camera =
            refit_camera(without(views, view), all, without(poses, view)).camera;
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
    score.leave_one_out_rms_px = std::sqrt(sum / static_cast<double>(point_count(views)));
}

template <class Task>
void for_each_index(std::size_t count, const Task& task) {
    cv::parallel_for_(cv::Range(0, static_cast<int>(count)), [&](const cv::Range& range) {
        for (int i = range.start; i < range.end; ++i)
            task(static_cast<std::size_t>(i));
    });
}

// What the views say of the model's projection where their points are.
void set_identifiability(ModelScore& score, std::span<const CalibrationView> views) {
    const CameraFit& fit = *score.fit;
    const auto deviation = attempted([&] {
        const auto covariances =
            covariances_of(view_equations(views, fit), fit.model, fit.variance);
        return projection_uncertainty(fit.camera, fit.model, covariances.stated, all_pixels(views))
            .worst_among_points(&PixelUncertainty::rotated);
    });
    score.projection_deviation_px = deviation.value;
    if (views.size() >= min_cross_validation_views)
        score.halves_px = attempted([&] { return cross_validate(views, fit).rms_px; }).value;
}

// The smallest of a figure among the models that are not in doubt.
double least(const std::vector<ModelScore>& scores, std::optional<double> ModelScore::*figure) {
    double smallest = std::numeric_limits<double>::infinity();
    for (const ModelScore& score : scores)
        if (score.doubt.empty())
            smallest = std::min(smallest, (score.*figure).value_or(smallest));
    return smallest;
}

void set_doubts(std::vector<ModelScore>& scores, double best_error_px) {
    const double max_deviation =
        max_projection_deviation *
        std::max(best_error_px, least(scores, &ModelScore::projection_deviation_px));
    for (ModelScore& score : scores)
        if (!score.doubt.empty())
            continue;
        else if (!score.fit)
            score.doubt = score.failure;
        else if (!score.fit->converged)
            score.doubt = "its best fit lies where its distortion folds over";
        else if (!score.projection_deviation_px)
            score.doubt = "its projection cannot be told";
        else if (*score.projection_deviation_px > max_deviation)
            score.doubt = fmt::format("its projection is certain to {:.2g} px only",
                                      *score.projection_deviation_px);
    const double least_halves = least(scores, &ModelScore::halves_px);
    const double max_halves = max_halves_difference * std::max(best_error_px, least_halves);
    for (ModelScore& score : scores) {
        if (!score.doubt.empty())
            continue;
        if (score.halves_px.value_or(0.0) > max_halves)
            score.doubt =
                fmt::format("two halves of the photos differ by {:.2g} px", *score.halves_px);
        else if (!score.halves_px && std::isfinite(least_halves))
            score.doubt = "half of the photos do not determine it";
    }
}

// The smallest leave-one-out error; of those without doubt only, if so asked.
std::optional<std::size_t> best_of(const std::vector<ModelScore>& scores, bool without_doubt) {
    std::optional<std::size_t> best;
    for (std::size_t i = 0; i < scores.size(); ++i) {
        const auto& error = scores[i].leave_one_out_rms_px;
        if (error && (!without_doubt || scores[i].doubt.empty()) &&
            (!best || *error < *scores[*best].leave_one_out_rms_px))
            best = i;
    }
    return best;
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
        return richer.failed_view.has_value();
    return richer.above_best > advised.above_best &&
           (richer.above_best > richer.above_best_error ||
            *richer.leave_one_out_rms_px > (1.0 + overfit_share) * *advised.leave_one_out_rms_px);
}

}  // namespace

// Gauss-Newton; the rotation is small and the problem nearly linear.
ProjectionDifference projection_difference(const CameraModel& second, const ImageRays& rays,
                                           const Eigen::VectorXd& deviations) {
    constexpr int steps = 5;
    const Projector projector(second);
    Rigid motion;
    for (int step = 0;; ++step) {
        ImageRays seen;
        std::vector<Eigen::Vector2d> differences;
        std::vector<double> of_seen;  // their deviations
        for (std::size_t i = 0; i < rays.pixels.size(); ++i) {
            const auto pixel = projector.project(motion * rays.rays[i]);
            if (!pixel)
                continue;
            seen.pixels.push_back(rays.pixels[i]);
            seen.rays.push_back(rays.rays[i]);
            differences.push_back(*pixel - rays.pixels[i]);
            of_seen.push_back(deviations[static_cast<Eigen::Index>(i)]);
        }
        if (of_seen.size() < 3)
            throw NumericalError("two calibrations of one camera have no rays in common");
        if (step == steps)
            return {seen.pixels, differences};
        using Column = Eigen::Map<const Eigen::VectorXd>;
        const Eigen::Vector3d turn = -best_rotation(
            Column(differences.front().data(), 2 * std::ssize(differences)),
            rotation_jacobian(second, seen), Column(of_seen.data(), std::ssize(of_seen)));
        motion = motion_of_rays(turn, second.projection.kind) * motion;
    }
}

CrossValidation cross_validate(std::span<const CalibrationView> views, const CameraFit& fit) {
    if (views.size() < min_cross_validation_views)
        throw NumericalError(fmt::format("{} views, {} are needed for two halves", views.size(),
                                         min_cross_validation_views));
    const Half first = calibrated_half(views, 0, fit), second = calibrated_half(views, 1, fit);
    const Eigen::MatrixXd formal = first.covariances.formal + second.covariances.formal,
                          robust =
                              first.covariances.cluster_robust + second.covariances.cluster_robust;
    const ImageRays rays = rays_among(image_rays(first.camera), all_pixels(views));
    const Eigen::MatrixXd moved = parameter_jacobian(first.camera, rays, fit.model);
    const Eigen::VectorXd deviations = ray_deviations(moved, formal);
    ProjectionDifference difference = projection_difference(second.camera, rays, deviations);

    CrossValidation result{{first.views, second.views},
                           std::move(difference.pixels),
                           std::move(difference.differences_px)};
    double squares = 0.0;
    for (const Eigen::Vector2d& each : result.differences_px) {
        squares += each.squaredNorm();
        result.worst_px = std::max(result.worst_px, each.norm());
    }
    result.rms_px = std::sqrt(squares / static_cast<double>(result.differences_px.size()));

    const Eigen::MatrixXd rotated =
        less_best_rotation(moved, rotation_jacobian(first.camera, rays), deviations);
    result.expected_formal_px = std::sqrt(mean_square(rotated, formal));
    result.expected_robust_px = std::sqrt(mean_square(rotated, robust));
    return result;
}

// Every fit is a problem of its own and has its own place for the result, so that the number of
// threads cannot change it.
std::vector<ModelScore> score_models(std::span<const CalibrationView> views, cv::Size image_size,
                                     std::span<const CalibrationModel> models, bool leave_out_views,
                                     const std::stop_token& stop) {
    std::vector<ModelScore> scores(models.size());
    for_each_index(models.size(), [&](std::size_t i) {
        throw_if_stopped(stop);
        scores[i] = fitted_score(views, image_size, models[i]);
    });
    set_doubts_about_kind(scores, models);
    const auto is_asked = [&](std::size_t i) { return scores[i].fit && scores[i].doubt.empty(); };
    if (!leave_out_views || views.size() < 4)
        return scores;
    std::vector<ViewLeftOut> left_out(models.size() * views.size());
    for_each_index(left_out.size(), [&](std::size_t i) {
        const std::size_t model = i / views.size(), view = i % views.size();
        throw_if_stopped(stop);
        if (is_asked(model))
            left_out[i] = leave_out(views, *scores[model].fit, view);
    });
    for_each_index(models.size(), [&](std::size_t i) {
        if (!is_asked(i))
            return;
        set_left_out(scores[i], std::span(left_out).subspan(i * views.size(), views.size()), views);
        set_identifiability(scores[i], views);
    });
    return scores;
}

ModelAdvice compare_models(std::vector<ModelScore> scores, std::span<const CalibrationView> views) {
    ModelAdvice advice{std::move(scores), std::nullopt, std::nullopt};
    const auto most_exact = best_of(advice.models, /*without_doubt=*/false);
    if (!most_exact)
        return advice;
    const double smallest = *advice.models[*most_exact].leave_one_out_rms_px;
    set_doubts(advice.models, smallest);
    advice.best = best_of(advice.models, /*without_doubt=*/true);
    if (!advice.best)
        return advice;
    const double best_error = *advice.models[*advice.best].leave_one_out_rms_px;
    for (std::size_t i = 0; i < advice.models.size(); ++i) {
        ModelScore& score = advice.models[i];
        if (!score.leave_one_out_rms_px)
            continue;
        set_difference(score, advice.models[*advice.best], views);
        if (!advice.advised && score.doubt.empty() && score.above_best <= score.above_best_error &&
            *score.leave_one_out_rms_px <= max_above_best * best_error)
            advice.advised = i;
    }
    const ModelScore& advised = advice.models[*advice.advised];
    for (std::size_t i = *advice.advised + 1; i < advice.models.size(); ++i) {
        ModelScore& score = advice.models[i];
        score.overfits = score.parameters > advised.parameters && predicts_worse(score, advised);
    }
    return advice;
}

}  // namespace etalon
