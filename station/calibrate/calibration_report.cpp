#include "station/calibrate/calibration_report.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>

#include "core/file/text.h"
#include "core/geometry/units.h"
#include "report/json_text.h"
#include "report/number_text.h"

namespace etalon {

ETALON_MEMBERS_TO_JSON(RefinedPhoto, corners_rms_gray, refined_rms_gray)

namespace {

std::size_t count_left_out(const CalibratedView& view) {
    return static_cast<std::size_t>(std::count(view.left_out.begin(), view.left_out.end(), true));
}

// ---- remarks --------------------------------------------------------------------------------

const ModelScore* advised_score(const CameraCalibration& calibration) {
    const ModelAdvice& advice = calibration.advice;
    return advice.advised ? &advice.models[*advice.advised] : nullptr;
}

void remark_on_outliers(const CalibrationRun& run, std::vector<std::string>& remarks) {
    const CameraCalibration& calibration = run.calibration;
    if (calibration.points_left_out() == 0)
        return;
    std::vector<std::string> parts;
    for (std::size_t i = 0; i < calibration.views.size(); ++i) {
        const CalibratedView& view = calibration.views[i];
        if (!view.camera_from_target)
            parts.push_back(short_name(run.photos[i]) + " as a whole (no pose explains it)");
        else if (!view.used())
            parts.push_back(
                fmt::format("{} as a whole ({:.2f} px)", short_name(run.photos[i]), view.rms_px));
        else if (count_left_out(view) > 0)
            parts.push_back(
                fmt::format("{} of {}", count_left_out(view), short_name(run.photos[i])));
    }
    remarks.push_back(
        fmt::format("Left out because they do not fit the others: {} of {} corners: {}.",
                    calibration.points_left_out(), calibration.points(), fmt::join(parts, ", ")));
}

std::string words_of_overfit(const CalibrationRun& run, const ModelScore& score) {
    if (score.failed_view)
        return fmt::format(
            "{} overfits: {:.3f} px in the fit, but calibrated without {} it cannot "
            "predict that photo at all",
            score.model, score.rms_px, short_name(run.photos[*score.failed_view]));
    return fmt::format("{} overfits: {:.3f} px in the fit, {:.3f} px on photos left out",
                       score.model, score.rms_px, *score.leave_one_out_rms_px);
}

void remark_on_model(const CalibrationRun& run, std::vector<std::string>& remarks) {
    const CameraCalibration& calibration = run.calibration;
    const ModelScore* advised = advised_score(calibration);
    if (!advised) {
        remarks.push_back(
            "No advice which model to take: it needs four photos with the target, "
            "each left out once.");
        return;
    }
    const ModelScore& chosen = chosen_score(calibration);
    for (const ModelScore& score : calibration.advice.models)
        if (!score.doubt.empty())
            remarks.push_back(fmt::format("{} is not advised: {}.", score.model, score.doubt));
    for (const ModelScore& score : calibration.advice.models)
        if (score.overfits)
            remarks.push_back(fmt::format("{} ({}: {:.3f} px).", words_of_overfit(run, score),
                                          advised->model, *advised->leave_one_out_rms_px));
    if (chosen.model != advised->model)
        remarks.push_back(fmt::format("Model {} was asked for; these photos support {}.",
                                      chosen.model, advised->model));
    if (chosen.leave_one_out_rms_px && *chosen.leave_one_out_rms_px > 1.5 * chosen.rms_px)
        remarks.push_back(
            "The model follows these photos rather than the lens (leave-one-out error far above "
            "the fit): take more photos, tilted and up to the image's corners.");
}

void remark_on_deviations(const CalibrationRun& run, std::vector<std::string>& remarks) {
    const CameraCalibration& calibration = run.calibration;
    std::vector<std::string> suspicious;
    for (const ParameterDeviation& each : calibration.deviations)
        if (each.ratio() > suspicious_deviation_ratio)
            suspicious.push_back(fmt::format("{} {:.1f}", each.name, each.ratio()));
    if (!suspicious.empty())
        remarks.push_back(fmt::format(
            "Corners of one photo are not independent: what the photos say of each other makes "
            "standard deviations more than {:g} times the formal ones ({}).",
            suspicious_deviation_ratio, fmt::join(suspicious, ", ")));
    std::vector<std::string> skewed;
    for (const std::size_t i : calibration.skewed_intervals())
        skewed.push_back(fmt::format("{} {:.5g} to {:.5g}", calibration.model.parameters[i],
                                     calibration.intervals[i]->low,
                                     calibration.intervals[i]->high));
    if (!skewed.empty())
        remarks.push_back(fmt::format(
            "Parameters that trade for each other so freely that a standard deviation does not say "
            "how far off each may be; their 95 % intervals: {}. What the camera projects is as "
            "certain as stated.",
            fmt::join(skewed, ", ")));
    if (!calibration.covariances.bootstrap)
        remarks.push_back(fmt::format(
            "No bootstrap: it needs {} photos, and nearly every resample of them must determine "
            "the camera.",
            min_bootstrap_views));
}

bool is_telecentric(const CalibrationRun& run) {
    return run.calibration.camera.projection.kind == Projection::telecentric;
}

void remark_on_telecentric(const CalibrationRun& run, std::vector<std::string>& remarks) {
    if (!is_telecentric(run))
        return;
    remarks.push_back(
        "A telecentric camera sees a board tilted one way as it sees it tilted the other, and at "
        "any distance: every photo's pose has a mirror image that fits as well, and a distance "
        "that is held. The camera is the same with either.");
    if (!held_parameters(run.calibration).empty())
        remarks.push_back(fmt::format(
            "cx and cy are held in the middle of the image: the centre {}.", reason_held));
}

void remark_on_board(const CalibrationRun& run, std::vector<std::string>& remarks) {
    const auto& flatness = run.calibration.flatness;
    if (is_telecentric(run))
        remarks.push_back(
            "Nothing can be said of whether the board is flat: a telecentric camera does not tell "
            "a height from its opposite.");
    else if (!flatness)
        remarks.push_back(
            fmt::format("Nothing can be said of whether the board is flat: it needs {} photos.",
                        min_board_views));
    else if (flatness->is_distorted())
        remarks.push_back(fmt::format(
            "{:.0f} % of the residuals' variance moves with the board, not with the image (chance "
            "of that with a true board {:.2g} %): its points are displaced by up to {:.2g} mm "
            "(RMS {:.2g} +- {:.1g} mm). The board is not flat or not printed true{}.",
            100.0 * flatness->share, 100.0 * flatness->chance, flatness->worst_mm, flatness->rms_mm,
            flatness->rms_deviation_mm,
            run.calibration.board ? "" : "; --fit-board fits its shape with the camera"));
    if (run.calibration.board)
        remarks.push_back("Board: " + board_in_words(*run.calibration.board) + ".");
    if (run.calibration.board && !run.calibration.board->converged)
        remarks.push_back("The board's shape did not settle: these photos hardly tell it.");
}

void remark_on_image(const CalibrationRun& run, std::vector<std::string>& remarks) {
    constexpr double little = 0.8;
    const ProjectionUncertainty& uncertainty = run.calibration.uncertainty;
    if (uncertainty.share_among_points() < little)
        remarks.push_back(fmt::format(
            "Corners reach over {:.0f} % of the image. Among them a ray's image is certain to "
            "{:.2f} px at worst, beyond them, where the model extrapolates, to {:.2f} px.",
            100.0 * uncertainty.share_among_points(),
            uncertainty.worst_among_points(&PixelUncertainty::rotated),
            uncertainty.worst(&PixelUncertainty::rotated)));
    if (uncertainty.share_without_ray > 0.0)
        remarks.push_back(fmt::format(
            "{:.2g} % of the image has no ray: {}. Nothing can be measured or rendered there.",
            100.0 * uncertainty.share_without_ray,
            run.calibration.camera.projection.is_flat()
                ? "beyond the corners the distortion folds over"
                : "it lies outside of what this model of the lens images"));
    const auto& halves = run.calibration.halves;
    if (!halves)
        remarks.push_back(
            fmt::format("No cross-validation: it needs {} photos, every second of "
                        "which must determine the camera.",
                        min_cross_validation_views));
    else if (halves->rms_px >
             2.0 * std::max(halves->expected_formal_px, halves->expected_robust_px))
        remarks.push_back(fmt::format(
            "Two halves of the photos differ by {:.3f} px where their covariances lead to expect "
            "{:.3f} px: something changed between the photos, or they err alike.",
            halves->rms_px, std::max(halves->expected_formal_px, halves->expected_robust_px)));
}

// ---- photos, models and parameters, on the page and on a terminal ----------------------------

// Of the board's normal to the optical axis; a telecentric camera does not tell to which side.
std::string tilt_text(const Rigid& camera_from_target, bool is_telecentric) {
    const double cosine = std::abs((camera_from_target.rotation * Eigen::Vector3d::UnitZ()).z());
    return (is_telecentric ? "\u00b1" : "") +
           fixed(std::acos(std::min(1.0, cosine)) * deg_per_rad, 1);
}

std::string judged(const CalibrationRun& run, const ModelScore& score) {
    const CameraCalibration& calibration = run.calibration;
    std::vector<std::string> words;
    if (&score == advised_score(calibration))
        words.push_back("advised");
    if (&score == &chosen_score(calibration))
        words.push_back("taken");
    if (score.overfits)
        words.push_back("overfits");
    if (!score.doubt.empty())
        words.push_back("not advised");
    if (score.failed_view)
        words.push_back("cannot predict " + short_name(run.photos[*score.failed_view]));
    else if (!score.failure.empty())
        words.push_back(score.failure);
    return fmt::format("{}", fmt::join(words, ", "));
}

// The difference of mean squares as a difference of RMS values, near the best one's.
std::string difference(const ModelScore& score, const ModelAdvice& advice) {
    if (!score.leave_one_out_rms_px || !advice.best)
        return dash;
    const ModelScore& best = advice.models[*advice.best];
    if (&score == &best)
        return "0 (best)";
    const double twice = *score.leave_one_out_rms_px + *best.leave_one_out_rms_px;
    return fmt::format("{:.4f}\u00a0±\u00a0{:.4f}", score.above_best / twice,
                       score.above_best_error / twice);
}

// ---- JSON -----------------------------------------------------------------------------------

Json parameters_json(const CameraCalibration& calibration) {
    const Eigen::VectorXd values = parameters_of(calibration.camera, calibration.model);
    Json json;
    for (std::size_t i = 0; i < calibration.deviations.size(); ++i) {
        const ParameterDeviation& each = calibration.deviations[i];
        Json& entry = json[each.name];
        entry["value"] = values[static_cast<Eigen::Index>(i)];
        entry["standard_deviation"] = {{"used", each.stated},
                                       {"formal", each.formal},
                                       {"cluster_robust", each.cluster_robust}};
        if (each.bootstrap)
            entry["standard_deviation"]["bootstrap"] = *each.bootstrap;
        if (const auto& interval = calibration.intervals[i])
            entry["interval_95"] = {interval->low, interval->high};
    }
    for (const auto& [name, value] : held_parameters(calibration))
        json[name] = {{"value", value}, {"held", reason_held}};
    return json;
}

Json uncertainty_json(const ProjectionUncertainty& uncertainty) {
    const auto figures = [&](double PixelUncertainty::*value) -> Json {
        return {{"mean_px", uncertainty.mean(value)},
                {"worst_px", uncertainty.worst(value)},
                {"worst_among_corners_px", uncertainty.worst_among_points(value)}};
    };
    return {{"camera_held", figures(&PixelUncertainty::held)},
            {"after_best_rotation", figures(&PixelUncertainty::rotated)},
            {"image_among_corners", uncertainty.share_among_points()},
            {"image_without_ray", uncertainty.share_without_ray}};
}

Json halves_json(const CrossValidation& halves) {
    return {{"photos", halves.views},
            {"difference_rms_px", halves.rms_px},
            {"difference_worst_px", halves.worst_px},
            {"expected_formal_px", halves.expected_formal_px},
            {"expected_cluster_robust_px", halves.expected_robust_px}};
}

Json flatness_json(const BoardFlatness& flatness) {
    return {{"distorted", flatness.is_distorted()},
            {"chance", flatness.chance},
            {"share_of_variance", flatness.share},
            {"displacement_rms_mm", flatness.rms_mm},
            {"displacement_rms_standard_deviation_mm", flatness.rms_deviation_mm},
            {"displacement_worst_mm", flatness.worst_mm}};
}

Json board_json(const BoardShape& board) {
    return {{"displacement_rms_mm", board.rms_mm},
            {"displacement_rms_standard_deviation_mm", board.rms_deviation_mm},
            {"displacement_worst_mm", board.worst_mm},
            {"curvature_xx_xy_yy_per_mm", numbers_of(board.curvature_per_mm)},
            {"curvature_standard_deviation_per_mm", numbers_of(board.curvature_deviation_per_mm)},
            {"prior_in_plane_mm", board.prior.in_plane_mm},
            {"prior_out_of_plane_mm", board.prior.out_of_plane_mm},
            {"parameters", board.parameters},
            {"converged", board.converged},
            {"points", json_list(board.points, [](const ShapedPoint& point) {
                 return Json{{"id", point.id},
                             {"drawn_mm", numbers_of(point.drawn_mm)},
                             {"displacement_mm", numbers_of(point.displacement_mm)},
                             {"standard_deviation_mm", numbers_of(point.deviation_mm)}};
             })}};
}

Json photos_json(const CalibrationRun& run) {
    Json json = Json::array();
    for (std::size_t i = 0; i < run.photos.size(); ++i) {
        const CalibratedView& view = run.calibration.views[i];
        Json entry = {{"photo", run.photos[i]},
                      {"used", view.used()},
                      {"corners", view.left_out.size()},
                      {"corners_left_out", count_left_out(view)}};
        if (view.camera_from_target) {
            entry["rms_px"] = view.rms_px;
            entry["camera_from_target"] = pose_numbers(*view.camera_from_target);
        }
        add_present(entry, "left_out_rms_px", view.left_out_rms_px);
        json.push_back(entry);
    }
    return json;
}

// In the order of the used photos.
Json refinement_json(const PhotometricRefinement& refinement) {
    Json json = {{"accepted", refinement.accepted},
                 {"corners_rms_gray", refinement.corners_rms_gray},
                 {"refined_rms_gray", refinement.refined_rms_gray},
                 {"gain_gray", refinement.gain_gray},
                 {"gain_standard_error_gray", refinement.gain_error_gray},
                 {"least_gain_gray", refinement.least_gain_gray},
                 {"folds", refinement.folds}};
    const CameraParameters values = all_parameters(refinement.camera);
    for (const ParameterDeviation& deviation : refinement.deviations)
        json["parameters"][deviation.name] = {
            {"value", values[parameter_index(deviation.name)]},
            {"standard_deviation",
             {{"formal", deviation.formal}, {"cluster_robust", deviation.cluster_robust}}}};
    json["photos"] = refinement.photos;
    return json;
}

}  // namespace

std::string short_name(const std::string& photo) {
    return std::filesystem::path(photo).filename().string();
}

std::string with_uncertainty(double value, double deviation) {
    return deviation > 0.0 ? fixed(value, decimals_of(deviation)) : exact(value);
}

const ModelScore& chosen_score(const CameraCalibration& calibration) {
    const auto& models = calibration.advice.models;
    return *std::find_if(models.begin(), models.end(), [&](const ModelScore& score) {
        return score.model == calibration.model.name;
    });
}

std::size_t photos_used(const CameraCalibration& calibration) {
    return static_cast<std::size_t>(
        std::count_if(calibration.views.begin(), calibration.views.end(),
                      [](const CalibratedView& view) { return view.used(); }));
}

std::vector<std::pair<const char*, double>> held_parameters(const CameraCalibration& calibration) {
    const auto& free = calibration.model.parameters;
    const Intrinsics& intrinsics = calibration.camera.intrinsics;
    if (std::ranges::find(free, "cx") != free.end())
        return {};
    return {{"cx", intrinsics.cx}, {"cy", intrinsics.cy}};
}

const char* best_motion(const CameraModel& camera) {
    return camera.projection.kind == Projection::telecentric ? "turn about the axis and shift"
                                                             : "rotation";
}

std::vector<std::string> calibration_remarks(const CalibrationRun& run) {
    std::vector<std::string> remarks;
    if (!run.others.in_words.empty())
        remarks.push_back("Not used: " + run.others.in_words + ".");
    remark_on_outliers(run, remarks);
    remark_on_model(run, remarks);
    remark_on_deviations(run, remarks);
    remark_on_telecentric(run, remarks);
    remark_on_board(run, remarks);
    remark_on_image(run, remarks);
    if (run.refinement)
        remarks.push_back("Photometric refinement: " + run.refinement->in_words() + ".");
    return remarks;
}

ResultTable photo_table(const CalibrationRun& run) {
    ResultTable table = empty_table({"photo", "state", "corners", "left out", "fit / px",
                                     "predicted / px", "distance / mm", "tilt / deg"});
    for (std::size_t i = 0; i < run.photos.size(); ++i) {
        const CalibratedView& view = run.calibration.views[i];
        const auto& pose = view.camera_from_target;
        table.rows.push_back(
            {short_name(run.photos[i]), view.used() ? "used" : "left out: does not fit the others",
             view.left_out.size(), count_left_out(view), pose ? fixed(view.rms_px, 3) : dash,
             fixed(view.left_out_rms_px, 3),
             pose && !is_telecentric(run) ? fixed(pose->translation.norm(), 0) : dash,
             pose ? tilt_text(*pose, is_telecentric(run)) : dash});
    }
    const auto add_unused = [&](const std::vector<std::string>& photos, const char* why) {
        for (const std::string& photo : photos) {
            table.rows.push_back({short_name(photo), why});
            table.rows.back().resize(table.columns.size());
        }
    };
    add_unused(run.without_target, "target not found");
    add_unused(run.others.photos, "not used: another zoom, focus or camera");
    return table;
}

ResultTable model_table(const CalibrationRun& run) {
    const auto fitted = [](auto value) {
        return [=](const ModelScore& score) {
            return score.fit ? TableCell(value(score)) : TableCell();
        };
    };
    const auto predicted = [](double ModelScore::*value) {
        return [=](const ModelScore& score) {
            return score.leave_one_out_rms_px ? TableCell(score.*value) : TableCell();
        };
    };
    const auto said = [](std::string ModelScore::*text) {
        return [=](const ModelScore& score) {
            return (score.*text).empty() ? TableCell() : TableCell(score.*text);
        };
    };
    const auto condition =
        fitted([](const ModelScore& score) { return score.fit->condition_number; });
    const ColumnsOf<ModelScore> columns = {
        {"model", &ModelScore::model, "model"},
        {"parameters", &ModelScore::parameters, "parameters"},
        {"rms_px", fitted(std::mem_fn(&ModelScore::rms_px)), "fit", "px", "{:.4f}"},
        {"condition_number", condition},
        {"leave_one_out_rms_px", &ModelScore::leave_one_out_rms_px, "left out", "px", "{:.4f}"},
        {"above_best_px2", predicted(&ModelScore::above_best)},
        {"above_best_standard_error_px2", predicted(&ModelScore::above_best_error)},
        {"", [&](const auto& score) { return difference(score, run.calibration.advice); },
         "above the best", "px"},
        {"projection_deviation_px", &ModelScore::projection_deviation_px, "certain to", "px",
         "{:.3g}"},
        {"halves_px", &ModelScore::halves_px, "halves", "px", "{:.3g}"},
        {"", condition, "condition", "", "{:.1e}"},
        {"doubt", said(&ModelScore::doubt)},
        {"failure", said(&ModelScore::failure)},
        {"photo_not_predicted",
         [&](const ModelScore& score) {
             return score.failed_view ? TableCell(run.photos[*score.failed_view]) : TableCell();
         }},
        {"overfits", &ModelScore::overfits},
        {"", [&](const auto& score) { return judged(run, score); }, "judged"}};
    return table_of(columns, run.calibration.advice.models);
}

ResultTable parameter_table(const CameraCalibration& calibration) {
    const auto two_digits = [](double value) { return fmt::format("{:#.2g}", value); };
    const Eigen::VectorXd values = parameters_of(calibration.camera, calibration.model);
    ResultTable table = empty_table(
        {"parameter", "value", "used", "formal", "cluster-robust", "bootstrap", "used/formal"});
    for (std::size_t i = 0; i < calibration.deviations.size(); ++i) {
        const ParameterDeviation& each = calibration.deviations[i];
        table.rows.push_back(
            {each.name, with_uncertainty(values[static_cast<Eigen::Index>(i)], each.stated),
             two_digits(each.stated), two_digits(each.formal), two_digits(each.cluster_robust),
             each.bootstrap ? two_digits(*each.bootstrap) : dash, fixed(each.ratio(), 2)});
    }
    for (const auto& [name, value] : held_parameters(calibration)) {
        table.rows.push_back({name, exact(value)});
        table.rows.back().resize(table.columns.size());
    }
    return table;
}

std::string calibration_tables(const CalibrationRun& run) {
    std::string text = text_table(photo_table(run), {"distance", "tilt"}) + "\n" +
                       text_table(model_table(run), {"above the best", "condition"}) + "\n" +
                       text_table(parameter_table(run.calibration));
    for (const auto& [name, value] : held_parameters(run.calibration))
        text += fmt::format("{} = {} is held: {}\n", name, value, reason_held);
    return text;
}

std::string calibration_json(const CalibrationRun& run) {
    const CameraCalibration& calibration = run.calibration;
    Json json = {
        {"etalon", "calibration/1"},
        {"target", run.target},
        {"image", {{"width", calibration.camera.width}, {"height", calibration.camera.height}}},
        {"model", calibration.model.name}};
    if (const ModelScore* advised = advised_score(calibration))
        json["advised_model"] = advised->model;
    json["rms_px"] = calibration.rms_px;
    add_present(json, "leave_one_out_rms_px", calibration.leave_one_out_rms_px);
    json["condition_number"] = calibration.condition_number;
    json["corners"] = calibration.points();
    json["corners_left_out"] = calibration.points_left_out();
    json["photos_left_out"] = calibration.views.size() - photos_used(calibration);
    json["parameters"] = parameters_json(calibration);
    json["models"] = json_rows(model_table(run), MissingFigure::left_out);
    json["projection_uncertainty"] = uncertainty_json(calibration.uncertainty);
    add_present(json, "halves", calibration.halves, halves_json);
    add_present(json, "board_flatness", calibration.flatness, flatness_json);
    add_present(json, "board", calibration.board, board_json);
    add_present(json, "photometric_refinement", run.refinement, refinement_json);
    json["photos"] = photos_json(run);
    json["photos_without_target"] = run.without_target;
    json["photos_of_other_cameras"] = run.others.photos;
    json["remarks"] = calibration_remarks(run);
    json["software"] = software_json(software_versions());
    return text_of(json);
}

std::string board_in_words(const BoardShape& board) {
    const Eigen::Vector3d per_m = 1000.0 * board.curvature_per_mm,
                          deviation = 1000.0 * board.curvature_deviation_per_mm;
    return fmt::format(
        "displaced by {:.3f} +- {:.3f} mm RMS, {:.3f} mm at most; bent by {:.3f} +- {:.3f} /m "
        "along x, {:.3f} +- {:.3f} /m along y, twisted by {:.3f} +- {:.3f} /m",
        board.rms_mm, board.rms_deviation_mm, board.worst_mm, per_m[0], deviation[0], per_m[2],
        deviation[2], per_m[1], deviation[1]);
}

void write_board_csv(const std::filesystem::path& path, const BoardShape& board) {
    ColumnsOf<ShapedPoint> columns = {{"id", &ShapedPoint::id}};
    const auto add = [&](const char* key, Eigen::Vector3d ShapedPoint::*vector, int axis) {
        columns.push_back({key, [=](const ShapedPoint& point) { return (point.*vector)[axis]; }});
    };
    add("x_mm", &ShapedPoint::drawn_mm, 0);
    add("y_mm", &ShapedPoint::drawn_mm, 1);
    for (int axis = 0; const char* key : {"dx_mm", "dy_mm", "dz_mm"})
        add(key, &ShapedPoint::displacement_mm, axis++);
    for (int axis = 0; const char* key : {"dx_sd_mm", "dy_sd_mm", "dz_sd_mm"})
        add(key, &ShapedPoint::deviation_mm, axis++);
    write_text(path, csv_of(table_of(columns, board.points)));
}

void write_corners_csv(const std::filesystem::path& path, const CalibrationRun& run) {
    std::string text = "photo,id,x_mm,y_mm,x_px,y_px,residual_x_px,residual_y_px,left_out\n";
    for (std::size_t v = 0; v < run.views.size(); ++v) {
        const CalibrationView& view = run.views[v];
        const CalibratedView& calibrated = run.calibration.views[v];
        for (std::size_t i = 0; i < view.pixels.size(); ++i) {
            std::string residual = ",";  // no pose, no residuals
            if (calibrated.camera_from_target)
                residual = exact(calibrated.residuals_px[i].x()) + "," +
                           exact(calibrated.residuals_px[i].y());
            text += fmt::format("{},{},{},{},{},{},{},{:d}\n", csv_text(run.photos[v]),
                                view.ids.empty() ? static_cast<int>(i) : view.ids[i],
                                exact(view.points_mm[i].x()), exact(view.points_mm[i].y()),
                                exact(view.pixels[i].x()), exact(view.pixels[i].y()), residual,
                                bool(calibrated.left_out[i]));
        }
    }
    write_text(path, text);
}

}  // namespace etalon
