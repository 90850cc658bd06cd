#include "calib/intrinsics/calibrate.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>

#include "calib/camera/projector.h"
#include "calib/intrinsics/calibration_outliers.h"
#include "calib/intrinsics/calibration_start.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// The views that are used, without their outliers, and which of those given they are.
struct KeptViews {
    std::vector<CalibrationView> views;
    std::vector<std::size_t> indices;
};

bool all_left_out(const std::vector<bool>& left_out) {
    return std::all_of(left_out.begin(), left_out.end(), [](bool each) { return each; });
}

KeptViews kept_views(std::span<const CalibrationView> views, const CornerMask& left_out) {
    KeptViews kept;
    for (std::size_t i = 0; i < views.size(); ++i) {
        if (all_left_out(left_out[i]))
            continue;
        kept.views.push_back(without_points(views[i], left_out[i]));
        kept.indices.push_back(i);
    }
    return kept;
}

// Left out silently, outliers could make any photos look good.
void refuse_many_outliers(std::span<const CalibrationView> views, const CornerMask& left_out) {
    std::vector<std::string> of_views;
    std::size_t count = 0;
    for (std::size_t i = 0; i < views.size(); ++i) {
        const auto in_view = std::count(left_out[i].begin(), left_out[i].end(), true);
        count += static_cast<std::size_t>(in_view);
        if (in_view > 0)
            of_views.push_back(fmt::format("view {}: {} of {}", i, in_view, left_out[i].size()));
    }
    const std::size_t all = point_count(views);
    if (static_cast<double>(count) > max_outlier_share * static_cast<double>(all))
        throw NumericalError(
            fmt::format("{} of {} points do not fit the others, more than {:.0f} % ({}); take "
                        "those views away, or look at what is wrong with them",
                        count, all, 100.0 * max_outlier_share, fmt::join(of_views, ", ")));
}

// Those beside the named model, or all that may follow the lens.
std::vector<CalibrationModel> candidates(std::span<const CalibrationView> views,
                                         cv::Size image_size, const CalibrationOptions& options) {
    if (options.model && options.leave_one_out)
        return calibration_models_beside(calibration_model(*options.model).projection);
    if (options.model)
        return {calibration_model(*options.model)};
    const LensAngle angle = lens_angle(views, image_size);
    if (!options.leave_one_out)
        return {calibration_model(angle == LensAngle::wide ? "kannala_brandt" : "standard")};
    return angle == LensAngle::ordinary ? calibration_models() : perspective_and_wide_models();
}

// Of models that were left out of and that are all in doubt.
[[noreturn]] void refuse_all(const ModelAdvice& advice) {
    std::string words;
    for (const ModelScore& score : advice.models)
        if (!score.doubt.empty())
            words += fmt::format("{}{}: {}", words.empty() ? "" : "; ", score.model, score.doubt);
    throw NumericalError("these photos support no model (" + words +
                         "): more of them are needed, tilted more ways and nearer to the borders");
}

// Without advice.
std::string usual_model(const ModelAdvice& advice) {
    const auto standard = std::ranges::find(advice.models, "standard", &ModelScore::model);
    const bool is_followed = standard != advice.models.end() && standard->doubt.empty();
    return is_followed ? "standard" : "kannala_brandt";
}

// What the advice, or the user, chose among the scored models.
const ModelScore& chosen_score(const ModelAdvice& advice, const CalibrationOptions& options) {
    std::string name = options.model.value_or(usual_model(advice));
    if (!options.model && advice.advised)
        name = advice.models[*advice.advised].model;
    else if (!options.model && std::ranges::any_of(advice.models, [](const ModelScore& score) {
                 return score.leave_one_out_rms_px.has_value();
             }))
        refuse_all(advice);
    const auto score = std::ranges::find(advice.models, name, &ModelScore::model);
    if (!score->fit)
        throw NumericalError(score->failure);
    return *score;
}

double view_rms(double squares, const CalibrationView& view) {
    return std::sqrt(squares / static_cast<double>(view.pixels.size()));
}

std::vector<std::size_t> outlier_views(const KeptViews& kept, const ModelScore& score) {
    if (!score.leave_one_out_rms_px)
        return {};
    std::vector<double> fitted, left_out;
    for (std::size_t i = 0; i < kept.views.size(); ++i) {
        fitted.push_back(view_rms(sum_of_squares(score.fit->residuals_px[i]), kept.views[i]));
        left_out.push_back(view_rms(score.left_out_squares[i], kept.views[i]));
    }
    return find_outlier_views(fitted, left_out);
}

// A lens that none of the models follows leaves residuals that are alike around a point, and far
// longer than those of neighbours differ.
void refuse_foreign_lens(const ModelAdvice& advice, std::span<const CalibrationView> views) {
    constexpr double min_misfit_px = 1.0, max_over_scatter = 5.0;
    const ModelScore* closest = nullptr;
    for (const ModelScore& score : advice.models)
        if (score.fit && (!closest || score.rms_px < closest->rms_px))
            closest = &score;
    if (!closest)
        return;
    const double scatter = corner_scatter_px(views, closest->fit->residuals_px);
    if (closest->rms_px > std::max(min_misfit_px, max_over_scatter * scatter))
        throw NumericalError(
            fmt::format("no model here fits this lens: {:.1f} px RMS at best ({}), where the "
                        "points of one photo "
                        "scatter by {:.2f} px",
                        closest->rms_px, closest->model, scatter));
}

// Models are compared on the points that fit, and what fits depends on the model: until both stay.
struct Selection {
    CornerMask left_out;
    KeptViews kept;
    ModelAdvice advice;
    std::size_t chosen = 0;  // among the advice's models

    const ModelScore& score() const { return advice.models[chosen]; }
    const CameraFit& fit() const { return *score().fit; }
};

Selection select(std::span<const CalibrationView> views, cv::Size image_size,
                 const CalibrationOptions& options) {
    const std::vector<CalibrationModel> models = candidates(views, image_size, options);
    Selection selection;
    selection.left_out = find_outlier_corners(views, image_size, models, options.stop);
    for (;;) {
        refuse_many_outliers(views, selection.left_out);
        selection.kept = kept_views(views, selection.left_out);
        selection.advice = compare_models(score_models(selection.kept.views, image_size, models,
                                                       options.leave_one_out, options.stop),
                                          selection.kept.views);
        refuse_foreign_lens(selection.advice, selection.kept.views);
        const ModelScore& score = chosen_score(selection.advice, options);
        selection.chosen = static_cast<std::size_t>(&score - selection.advice.models.data());
        const std::vector<std::size_t> bad = outlier_views(selection.kept, score);
        if (bad.empty())
            return selection;
        for (const std::size_t view : bad) {
            std::vector<bool>& mask = selection.left_out[selection.kept.indices[view]];
            mask.assign(mask.size(), true);
        }
    }
}

// Of views that were taken for those of another lens, which has no focal length for them.
std::string telecentric_hint(std::span<const CalibrationView> views, cv::Size image_size) {
    constexpr double max_noise_over_scatter = 1.5;
    for (const CalibrationModel& model : telecentric_calibration_models()) {
        const auto fit = attempted([&] { return fit_camera(views, image_size, model); });
        if (!fit)
            continue;
        const double rms = fit.value->rms_px();
        if (rms <= max_noise_over_scatter * corner_scatter_px(views, fit.value->residuals_px))
            return fmt::format(
                "; the lens may be telecentric: model {}, which has to be named, leaves {:.2g} px",
                model.name, rms);
    }
    return "";
}

Selection select_with_hint(std::span<const CalibrationView> views, cv::Size image_size,
                           const CalibrationOptions& options) {
    auto selection = attempted([&] { return select(views, image_size, options); });
    if (selection)
        return std::move(*selection);
    throw NumericalError(selection.cause +
                         (options.model ? "" : telecentric_hint(views, image_size)));
}

// The fit only looks at the points: between them and the axis the model may still fold over.
void refuse_folds(const CameraModel& camera, std::span<const Rigid> poses,
                  std::span<const CalibrationView> views) {
    const Projector projector(camera);
    for (std::size_t i = 0; i < views.size(); ++i)
        for (std::size_t k = 0; k < views[i].points_mm.size(); ++k)
            if (!projector.project(poses[i] * views[i].true_point_mm(k)))
                throw NumericalError(
                    fmt::format("the fitted distortion folds over "
                                "inside the image: no ray near pixel "
                                "({:.1f}, {:.1f})",
                                views[i].pixels[k].x(), views[i].pixels[k].y()));
}

CalibratedView rejected_view(const CameraModel& camera, const CalibrationView& view) {
    CalibratedView rejected;
    rejected.left_out.assign(view.pixels.size(), true);
    const auto residuals = attempted([&] {
        const Rigid pose = fit_view_pose(camera, view);
        rejected.residuals_px = view_residuals(camera, pose, view);
        rejected.camera_from_target = pose;
    });
    if (!residuals)
        return rejected;
    rejected.rms_px = view_rms(sum_of_squares(rejected.residuals_px), view);
    rejected.left_out_rms_px = rejected.rms_px;
    return rejected;
}

std::vector<CalibratedView> calibrated_views(std::span<const CalibrationView> views,
                                             const Selection& selection) {
    const ModelScore& score = selection.score();
    const CameraFit& fit = selection.fit();
    std::vector<CalibratedView> result(views.size());
    for (std::size_t k = 0; k < selection.kept.indices.size(); ++k) {
        const std::size_t i = selection.kept.indices[k];
        CalibratedView& view = result[i];
        view.camera_from_target = fit.camera_from_target[k];
        view.residuals_px = view_residuals(fit.camera, fit.camera_from_target[k], views[i]);
        view.left_out = selection.left_out[i];
        view.rms_px = view_rms(sum_of_squares(fit.residuals_px[k]), selection.kept.views[k]);
        if (score.leave_one_out_rms_px)
            view.left_out_rms_px = view_rms(score.left_out_squares[k], selection.kept.views[k]);
    }
    for (std::size_t i = 0; i < views.size(); ++i)
        if (all_left_out(selection.left_out[i]))
            result[i] = rejected_view(fit.camera, views[i]);
    return result;
}

// Resamples that fail are those in which the views differ least: leaving out more than a few would
// flatter the rest.
std::optional<Eigen::MatrixXd> bootstrap_covariance(std::span<const CalibrationView> views,
                                                    const CameraFit& fit,
                                                    const CalibrationOptions& options) {
    constexpr double max_share_without_result = 0.05;
    if (options.resamples < 2 || views.size() < min_bootstrap_views)
        return std::nullopt;
    const Bootstrap bootstrap =
        bootstrap_calibrations(views, fit, options.resamples, 1, options.stop);
    if (bootstrap.without_result > max_share_without_result * options.resamples)
        return std::nullopt;
    return bootstrap.covariance(views.size());
}

std::vector<CalibrationView> shaped_views(std::span<const CalibrationView> views,
                                          const BoardShape& board) {
    std::vector<CalibrationView> shaped;
    for (const CalibrationView& view : views)
        shaped.push_back(board.shaped(view));
    return shaped;
}

// A board that is not flat may ask for another model and make points outliers that are none: until
// model and points stay.
BoardShape select_with_board(std::span<const CalibrationView> views, cv::Size image_size,
                             const CalibrationOptions& options, Selection& selection) {
    constexpr int most_rounds = 4;
    std::vector<CalibrationView> flat(views.begin(), views.end());
    for (int round = 0;; ++round) {
        const std::string model = selection.score().model;
        const CornerMask left_out = selection.left_out;
        const BoardShape board = fit_board_shape(kept_views(flat, left_out).views, selection.fit());
        selection = select(shaped_views(flat, board), image_size, options);
        if (round == most_rounds ||
            (selection.score().model == model && selection.left_out == left_out))
            return board;
    }
}

// Squares of each used view's residuals with camera and board fitted without it, the widths of the
// board's prior held.
std::vector<double> squares_without_view(const Selection& selection, const BoardShape& board,
                                         const std::stop_token& stop) {
    const std::vector<CalibrationView>& used = selection.kept.views;
    std::vector<double> squares(used.size());
    for (std::size_t i = 0; i < used.size(); ++i) {
        throw_if_stopped(stop);
        std::vector<CalibrationView> others = used;
        CameraFit start = selection.fit();
        others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
        start.camera_from_target.erase(start.camera_from_target.begin() +
                                       static_cast<std::ptrdiff_t>(i));
        const BoardShape shape = fit_board_shape(others, start, board);
        const CameraModel camera =
            refit_camera(shaped_views(others, shape), start, start.camera_from_target).camera;
        const CalibrationView view = shape.shaped(used[i]);
        squares[i] = sum_of_squares(view_residuals(camera, fit_view_pose(camera, view), view));
    }
    return squares;
}

void set_left_out_of_board(CameraCalibration& calibration, const Selection& selection,
                           const std::stop_token& stop) {
    if (!calibration.leave_one_out_rms_px)
        return;
    const auto squares =
        attempted([&] { return squares_without_view(selection, *calibration.board, stop); });
    calibration.leave_one_out_rms_px.reset();
    double sum = 0.0;
    for (std::size_t k = 0; k < selection.kept.indices.size(); ++k) {
        auto& rms = calibration.views[selection.kept.indices[k]].left_out_rms_px;
        rms.reset();
        if (!squares)
            continue;
        rms = view_rms((*squares.value)[k], selection.kept.views[k]);
        sum += (*squares.value)[k];
    }
    if (squares)
        calibration.leave_one_out_rms_px =
            std::sqrt(sum / static_cast<double>(point_count(selection.kept.views)));
}

// Covariances are of views independent for a given board; the board's own uncertainty is common to
// all and comes on top (law of total variance), grown as the stated covariance. Residuals are
// smaller for the parameters that the shape is worth.
void add_board(CalibrationCovariances& covariances, const BoardShape& board, double variance) {
    const double scale = variance > 0.0 ? board.variance / variance : 1.0;
    const double inflation = (covariances.formal.ldlt().solve(covariances.stated)).trace() /
                             static_cast<double>(covariances.formal.rows());
    const auto add = [&](Eigen::MatrixXd& covariance, double factor) {
        covariance = (scale * covariance + factor * board.camera_covariance).eval();
    };
    add(covariances.formal, 1.0);
    add(covariances.cluster_robust, 1.0);
    add(covariances.stated, std::isfinite(inflation) ? std::max(inflation, 1.0) : 1.0);
    if (covariances.bootstrap)
        add(*covariances.bootstrap, 1.0);
}

// Views are known to the caller as they were given.
ModelAdvice advice_on_given_views(Selection selection) {
    for (ModelScore& score : selection.advice.models)
        if (score.failed_view)
            score.failed_view = selection.kept.indices[*score.failed_view];
    return std::move(selection.advice);
}

}  // namespace

bool CalibratedView::used() const {
    return !all_left_out(left_out);
}

std::size_t CameraCalibration::points() const {
    std::size_t count = 0;
    for (const CalibratedView& view : views)
        count += view.left_out.size();
    return count;
}

std::size_t CameraCalibration::points_left_out() const {
    std::ptrdiff_t count = 0;
    for (const CalibratedView& view : views)
        count += std::ranges::count(view.left_out, true);
    return static_cast<std::size_t>(count);
}

std::vector<std::size_t> CameraCalibration::skewed_intervals() const {
    const Eigen::VectorXd values = parameters_of(camera, model);
    std::vector<std::size_t> skewed;
    for (std::size_t i = 0; i < intervals.size(); ++i) {
        if (!intervals[i])
            continue;
        const double value = values[static_cast<Eigen::Index>(i)];
        const double below = value - intervals[i]->low, above = intervals[i]->high - value;
        if (std::abs(above - below) > skewed_interval_share * (above + below))
            skewed.push_back(i);
    }
    return skewed;
}

bool CameraCalibration::overfits() const {
    return std::any_of(advice.models.begin(), advice.models.end(), [&](const ModelScore& score) {
        return score.model == model.name && score.overfits;
    });
}

CameraCalibration calibrate_camera(const std::vector<CalibrationView>& views, cv::Size image_size,
                                   const CalibrationOptions& options) {
    check_views(views);
    CameraCalibration calibration;
    Selection selection = select_with_hint(views, image_size, options);
    calibration.flatness = attempted([&] {
                               return check_board(selection.kept.views, selection.fit());
                           }).value.value_or(std::nullopt);
    std::vector<CalibrationView> shaped = views;
    if (options.fit_board) {
        calibration.board = select_with_board(views, image_size, options, selection);
        shaped = shaped_views(views, *calibration.board);
    }
    const std::vector<CalibrationView>& used = selection.kept.views;
    const CameraFit& fit = selection.fit();
    refuse_folds(fit.camera, fit.camera_from_target, used);

    calibration.camera = fit.camera;
    calibration.model = fit.model;
    calibration.rms_px = selection.score().rms_px;
    calibration.leave_one_out_rms_px = selection.score().leave_one_out_rms_px;
    calibration.condition_number = fit.condition_number;
    calibration.views = calibrated_views(shaped, selection);
    if (calibration.board)
        set_left_out_of_board(calibration, selection, options.stop);
    calibration.covariances = covariances_of(view_equations(used, fit), fit.model, fit.variance);
    calibration.covariances.bootstrap = bootstrap_covariance(used, fit, options);
    if (calibration.board)
        add_board(calibration.covariances, *calibration.board, fit.variance);
    calibration.deviations = deviations_of(calibration.model, calibration.covariances);
    const Eigen::MatrixXd& stated = calibration.covariances.stated;
    calibration.intervals = profile_intervals(used, fit, stated.diagonal().cwiseSqrt());
    calibration.camera.covariance = ParameterCovariance{calibration.model.parameters, stated};
    calibration.uncertainty =
        projection_uncertainty(calibration.camera, calibration.model, stated, all_pixels(used));
    if (used.size() >= min_cross_validation_views)
        calibration.halves = attempted([&] { return cross_validate(used, fit); }).value;
    calibration.advice = advice_on_given_views(std::move(selection));
    return calibration;
}

}  // namespace etalon
