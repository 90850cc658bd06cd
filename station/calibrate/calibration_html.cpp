// The report of a calibration: what a reader must decide on first, evidence below it.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/file/text.h"
#include "report/html.h"
#include "report/number_text.h"
#include "station/calibrate/calibration_plots.h"
#include "station/calibrate/calibration_report.h"

namespace etalon {
namespace {

void add_summary(HtmlPage& page, const CalibrationRun& run) {
    const CameraCalibration& calibration = run.calibration;
    const bool predicted = calibration.leave_one_out_rms_px.has_value();
    const double error = predicted ? *calibration.leave_one_out_rms_px : calibration.rms_px;
    const std::size_t used = photos_used(calibration);
    const std::vector<std::string> remarks = calibration_remarks(run);
    const std::vector<std::string> nothing_against_it{
        "Nothing in these photos speaks against the calibration."};
    page.add_verdict(
        fmt::format("{:.3f} px", error),
        predicted ? fmt::format("is how far the calibration is off, RMS over {} photos, on a photo "
                                "that it has not seen; {:.3f} px on those that it was fitted to.",
                                used, calibration.rms_px)
                  : fmt::format("RMS of the fit over {} photos, too few to leave any out.", used),
        {{"Before you trust it", remarks.empty() ? nothing_against_it : remarks}});
    const auto& models = calibration.advice.advised;
    const ProjectionUncertainty& uncertainty = calibration.uncertainty;
    page.add_facts(
        {{"Model", calibration.model.name +
                       (models && calibration.advice.models[*models].model == calibration.model.name
                            ? " (advised)"
                            : " (asked for)")},
         {"Target", run.target},
         {"Photos used",
          fmt::format("{} of {}", used,
                      run.photos.size() + run.without_target.size() + run.others.photos.size())},
         {"Corners used",
          fmt::format("{} of {}", calibration.points() - calibration.points_left_out(),
                      calibration.points())},
         {"Projection uncertain by at most, among the corners",
          fmt::format("{:.2f} px", uncertainty.worst_among_points(&PixelUncertainty::rotated))},
         {"Projection uncertain by at most, in the whole image",
          fmt::format("{:.2f} px", uncertainty.worst(&PixelUncertainty::rotated))},
         {"Image among corners", fmt::format("{:.0f} %", 100.0 * uncertainty.share_among_points())},
         {"Two halves differ by",
          calibration.halves ? fmt::format("{:.3f} px", calibration.halves->rms_px) : dash}});
}

void add_parameters(HtmlPage& page, const CameraCalibration& calibration) {
    page.add_heading("The camera, with its standard deviations side by side");
    const bool is_telecentric = calibration.camera.projection.kind == Projection::telecentric;
    const Eigen::VectorXd values = parameters_of(calibration.camera, calibration.model);
    TableRows rows;
    for (std::size_t i = 0; i < calibration.deviations.size(); ++i) {
        const ParameterDeviation& each = calibration.deviations[i];
        rows.push_back({each.name,
                        with_uncertainty(values[static_cast<Eigen::Index>(i)], each.stated),
                        fmt::format("{:#.2g}", each.stated), fmt::format("{:#.2g}", each.formal),
                        fmt::format("{:#.2g}", each.cluster_robust),
                        each.bootstrap ? fmt::format("{:#.2g}", *each.bootstrap) : dash,
                        fixed(each.ratio(), 2)});
    }
    for (const auto& [name, value] : held_parameters(calibration))
        rows.push_back({name, fmt::format("{}", value), std::string("held: ") + reason_held, dash,
                        dash, dash, dash});
    page.add_table(
        {"parameter", "value", "used", "formal", "cluster-robust", "bootstrap", "used / formal"},
        rows);
    page.add_paragraph(fmt::format(
        "{}, pixel centres at integers; distortion as OpenCV's{}. Formal: from the "
        "residuals' variance and the Jacobian, as if every corner erred on its own. "
        "Cluster-robust: from what each photo's residuals together do to the parameters, "
        "corrected for few photos. Bootstrap: scatter of {} calibrations of photos drawn with "
        "replacement. Used, and stated by camera.yml: the formal covariance drawn towards the "
        "cluster-robust one as far as the photos tell it, deviations and correlations together. "
        "Condition number of the scaled problem: {:.2g}.",
        is_telecentric ? "fx, fy in px per mm, cx, cy in px" : "fx, fy, cx, cy in px",
        is_telecentric ? ", in mm" : "", bootstrap_resamples, calibration.condition_number));
    page.add_figures({deviation_figure(calibration), model_figure(calibration)});
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
        words.push_back(score.doubt);
    if (score.failed_view)
        words.push_back("cannot predict " + short_name(run.photos[*score.failed_view]));
    else if (!score.failure.empty())
        words.push_back(score.failure);
    return fmt::format("{}", fmt::join(words, ", "));
}

// The difference of mean squares as a difference of RMS values, near the best one's.
std::string difference(const ModelScore& score, const ModelScore& best) {
    if (!score.leave_one_out_rms_px)
        return dash;
    if (&score == &best)
        return "0 (best)";
    const double twice = *score.leave_one_out_rms_px + *best.leave_one_out_rms_px;
    return fmt::format("{:.4f}\u00a0±\u00a0{:.4f}", score.above_best / twice,
                       score.above_best_error / twice);
}

void add_models(HtmlPage& page, const CalibrationRun& run) {
    const ModelAdvice& advice = run.calibration.advice;
    page.add_heading("Which model these photos support");
    TableRows rows;
    for (const ModelScore& score : advice.models)
        rows.push_back({score.model, judged(run, score), std::to_string(score.parameters),
                        score.fit ? fixed(score.rms_px, 4) : dash,
                        fixed(score.leave_one_out_rms_px, 4),
                        advice.best ? difference(score, advice.models[*advice.best]) : dash,
                        significant(score.projection_deviation_px, 3, dash),
                        significant(score.halves_px, 3, dash),
                        score.fit ? fmt::format("{:.1e}", score.fit->condition_number) : dash});
    page.add_table({"model", "judged", "parameters", "fit / px", "left out / px",
                    "above the best / px", "certain to / px", "halves / px", "condition"},
                   rows);
    page.add_paragraph(
        "Left out: every photo in turn is taken away, the camera calibrated from the others, and "
        "of "
        "the photo only its pose fitted. Advised is the simplest model within one standard error "
        "of the best, paired by photo, and not more than a quarter worse. A richer one that "
        "predicts worse overfits. Certain to: the largest standard deviation of a ray's image "
        "among the corners. Halves: how far two calibrations of every second photo project apart. "
        "A model is not advised where the first is twice, or the second three times, what the "
        "best model and the left-out error leave.");
}

void add_residuals(HtmlPage& page, const CalibrationRun& run) {
    page.add_heading("Residuals and where the corners are");
    page.add_figures(
        {residual_figure(run), radial_figure(run), photo_figure(run), coverage_figure(run)});
}

void add_uncertainty(HtmlPage& page, const CameraCalibration& calibration) {
    page.add_heading("What the uncertainty means in pixels");
    page.add_paragraph(fmt::format(
        "Errors of single parameters cancel; what counts is where a ray lands. Left with the "
        "camera held; right after the {} that takes back most of it over the image, which is what "
        "a measurement is left with that finds the camera's pose itself.",
        best_motion(calibration.camera)));
    page.add_figures(uncertainty_figures(calibration));
}

void add_halves(HtmlPage& page, const CameraCalibration& calibration) {
    if (!calibration.halves)
        return;
    const CrossValidation& halves = *calibration.halves;
    page.add_heading("Two halves against each other");
    page.add_paragraph(fmt::format(
        "Calibrated from every second photo ({} and {}), the two cameras project {:.3f} px apart "
        "(RMS over the part of the image that corners reach; worst {:.3f} px). Their formal "
        "covariances lead to expect {:.3f} px, "
        "the cluster-robust ones {:.3f} px.",
        halves.views[0], halves.views[1], halves.rms_px, halves.worst_px, halves.expected_formal_px,
        halves.expected_robust_px));
    page.add_figures({halves_figure(calibration)});
}

void add_board(HtmlPage& page, const CameraCalibration& calibration) {
    if (!calibration.board)
        return;
    page.add_heading("The board's shape");
    page.add_paragraph(fmt::format(
        "Fitted with the camera: {}. Worth {:.0f} parameters. The camera's deviations hold the "
        "board's. Left-out figures are of boards fitted without the photo; the table of models "
        "holds this board for all.",
        board_in_words(*calibration.board), calibration.board->parameters));
    page.add_figures(board_figures(*calibration.board));
}

// Angle between the board's normal and the optical axis.
double tilt_deg(const Rigid& camera_from_target) {
    const double cosine = std::abs((camera_from_target.rotation * Eigen::Vector3d::UnitZ()).z());
    return std::acos(std::min(1.0, cosine)) * 180.0 / std::numbers::pi;
}

void add_photos(HtmlPage& page, const CalibrationRun& run) {
    page.add_heading("Photos");
    const bool is_telecentric = run.calibration.camera.projection.kind == Projection::telecentric;
    TableRows rows;
    for (std::size_t i = 0; i < run.photos.size(); ++i) {
        const CalibratedView& view = run.calibration.views[i];
        const auto left_out = std::count(view.left_out.begin(), view.left_out.end(), true);
        const auto& pose = view.camera_from_target;
        rows.push_back(
            {short_name(run.photos[i]), view.used() ? "used" : "left out: does not fit the others",
             std::to_string(view.left_out.size()), std::to_string(left_out),
             pose ? fixed(view.rms_px, 3) : dash, fixed(view.left_out_rms_px, 3),
             pose && !is_telecentric ? fixed(pose->translation.norm(), 0) : dash,
             pose ? (is_telecentric ? "\u00b1" : "") + fixed(tilt_deg(*pose), 1) : dash});
    }
    for (const std::string& photo : run.without_target)
        rows.push_back({short_name(photo), "target not found", "0", dash, dash, dash, dash, dash});
    for (const std::string& photo : run.others.photos)
        rows.push_back({short_name(photo), "not used: another zoom, focus or camera", dash, dash,
                        dash, dash, dash, dash});
    page.add_table({"photo", "state", "corners", "left out", "fit / px", "predicted / px",
                    "distance / mm", "tilt / deg"},
                   rows);
}

void add_software(HtmlPage& page) {
    page.begin_details("Software");
    page.add_software(software_versions());
    page.end_details();
}

}  // namespace

std::string calibration_html(const CalibrationRun& run) {
    const CameraModel& camera = run.calibration.camera;
    HtmlPage page("Calibration of " + run.camera_file.filename().string(),
                  fmt::format("{} x {} px, {} photos of {}", camera.width, camera.height,
                              run.photos.size(), run.target));
    add_summary(page, run);
    add_parameters(page, run.calibration);
    add_models(page, run);
    add_residuals(page, run);
    add_uncertainty(page, run.calibration);
    add_halves(page, run.calibration);
    add_board(page, run.calibration);
    add_photos(page, run);
    add_software(page);
    return page.finish();
}

}  // namespace etalon
