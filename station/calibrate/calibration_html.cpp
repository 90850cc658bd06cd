// The report of a calibration: what a reader must decide on first, evidence below it.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "core/file/text.h"
#include "report/html.h"
#include "report/number_text.h"
#include "report/svg_plot.h"
#include "station/calibrate/calibration_report.h"

namespace etalon {
namespace {

SvgPlot image_plot(const CameraModel& camera) {
    SvgPlot plot("x / px", "y / px");
    plot.show_image(camera.width, camera.height);
    return plot;
}

// The longest arrow is about a twentieth of `width`. `caption` gets the enlargement.
HtmlPage::Figure arrow_figure(SvgPlot plot, const Series& arrows, double width, Color color,
                              const char* label, const std::string& caption) {
    const double factor = round_scale(width / 20.0 / std::max(arrows.longest(), 1e-9));
    plot.add_arrows(arrows, factor, color, label);
    return {plot.svg(), fmt::format(fmt::runtime(caption), factor)};
}

std::string point_note(const CalibrationRun& run, std::size_t view, std::size_t point) {
    const Eigen::Vector2d& r = run.calibration.views[view].residuals_px[point];
    return fmt::format("{}: ({:.2f}, {:.2f}) px, {:.2f} px", short_name(run.photos[view]), r.x(),
                       r.y(), r.norm());
}

// `take` gets the place of each corner's photo among the views, its own in it, and its pixel.
template <class Function>
void for_each_corner(const CalibrationRun& run, Function take) {
    for (std::size_t v = 0; v < run.views.size(); ++v)
        for (std::size_t i = 0; i < run.views[v].pixels.size(); ++i)
            take(v, i, run.views[v].pixels[i]);
}

// What differs between the photos' names, for labels: "left01.jpg" among its like is "01".
std::vector<std::string> short_labels(const std::vector<std::string>& photos) {
    std::vector<std::string> names;
    for (const std::string& photo : photos)
        names.push_back(std::filesystem::path(photo).stem().string());
    std::size_t common = names.front().size();
    for (const std::string& name : names) {
        const auto end =
            std::mismatch(name.begin(), name.end(), names.front().begin(), names.front().end());
        common = std::min(common, static_cast<std::size_t>(end.first - name.begin()));
    }
    while (common > 0 && std::isdigit(static_cast<unsigned char>(names.front()[common - 1])))
        --common;
    for (std::string& name : names)
        name = name.size() > common ? name.substr(common) : name;
    constexpr std::size_t max_letters = 6;
    const bool fit =
        names.size() <= 30 && std::all_of(names.begin(), names.end(), [&](const std::string& name) {
            return name.size() * names.size() <= max_letters * 14;
        });
    if (!fit)
        for (std::size_t i = 0; i < names.size(); ++i)
            names[i] = i % (1 + names.size() / 15) == 0 ? fmt::format("{}", i + 1) : "";
    return names;
}

// Models that are far worse would press the others into one line.
HtmlPage::Figure model_figure(const CameraCalibration& calibration) {
    constexpr double far_worse = 2.0;
    const double best = chosen_score(calibration).rms_px;
    Series fitted, left_out, wide;
    for (const ModelScore& score : calibration.advice.models) {
        if (!score.fit || score.rms_px > far_worse * best)
            continue;
        const bool contains_others = score.fit->camera.projection.is_flat();
        if (contains_others)
            fitted.add(score.parameters, score.rms_px,
                       fmt::format("{}: {:.4f} px in the fit", score.model, score.rms_px));
        if (const auto error = score.leave_one_out_rms_px;
            error && *error <= 2.0 * far_worse * best)
            (contains_others ? left_out : wide)
                .add(score.parameters, *error,
                     fmt::format("{}: {:.4f} px left out", score.model, *error));
    }
    SvgPlot plot("free parameters of the camera", "error / px");
    plot.add_curve(fitted, Color::gray, "in the fit");
    plot.add_curve(left_out, Color::blue, "on photos left out");
    if (!wide.empty())
        plot.add_points(wide, Color::orange, "the same, models of wide lenses");
    return {plot.svg(),
            "Error of each model, those left out of the picture that are far worse. More "
            "parameters always fit better; where the blue line turns up, they follow the photos "
            "and not the lens."};
}

HtmlPage::Figure deviation_figure(const CameraCalibration& calibration) {
    std::vector<std::string> names;
    Series robust, bootstrap;
    for (const ParameterDeviation& each : calibration.deviations) {
        const double i = static_cast<double>(names.size());
        names.push_back(each.name);
        if (!(each.formal > 0.0))
            continue;
        robust.add(i - 0.12, each.cluster_robust / each.formal);
        if (each.bootstrap)
            bootstrap.add(i + 0.12, *each.bootstrap / each.formal);
    }
    SvgPlot plot("", "standard deviation / formal one");
    plot.add_bars(names, std::vector<double>(names.size(), 1.0), Color::gray);
    plot.add_points(robust, Color::blue, "cluster-robust");
    plot.add_points(bootstrap, Color::orange, "bootstrap");
    plot.add_level(suspicious_deviation_ratio, Color::red, "suspicious above");
    return {plot.svg(),
            "Standard deviations over photos against the formal one (gray), which takes all "
            "corners for independent. Points above the line: the corners of a photo err together."};
}

HtmlPage::Figure photo_figure(const CalibrationRun& run) {
    std::vector<double> fitted, left_out;
    for (const CalibratedView& view : run.calibration.views) {
        fitted.push_back(view.used() ? view.rms_px : 0.0);
        left_out.push_back(view.left_out_rms_px.value_or(0.0));
    }
    const std::vector<std::string> labels = short_labels(run.photos);
    SvgPlot plot("photo", "error / px");
    plot.add_bars(labels, left_out, Color::orange);
    plot.add_bars(labels, fitted, Color::blue);
    return {plot.svg(),
            "RMS of each photo's corners: blue in the fit, orange what is added when the camera "
            "is calibrated without the photo. A tall orange part: this photo decides something "
            "alone."};
}

HtmlPage::Figure coverage_figure(const CalibrationRun& run) {
    Series used, left_out;
    for_each_corner(run, [&](std::size_t v, std::size_t i, const Eigen::Vector2d& pixel) {
        (run.calibration.views[v].left_out[i] ? left_out : used)
            .add(pixel.x(), pixel.y(), point_note(run, v, i));
    });
    SvgPlot plot = image_plot(run.calibration.camera);
    plot.add_points(used, Color::blue, "used");
    if (!left_out.empty())
        plot.add_points(left_out, Color::red, "left out");
    return {plot.svg(),
            fmt::format("Corners of all photos. Their convex hull is {:.0f} % of the image; beyond "
                        "it the model extrapolates.",
                        100.0 * run.calibration.uncertainty.share_among_points())};
}

HtmlPage::Figure residual_figure(const CalibrationRun& run) {
    Series arrows;
    for_each_corner(run, [&](std::size_t v, std::size_t i, const Eigen::Vector2d& pixel) {
        if (!run.calibration.views[v].left_out[i])
            arrows.add(pixel, run.calibration.views[v].residuals_px[i], point_note(run, v, i));
    });
    const CameraModel& camera = run.calibration.camera;
    return arrow_figure(image_plot(camera), arrows, camera.width, Color::blue, "photo minus model",
                        "Residuals, enlarged {:g} times. Neighbouring arrows of different photos "
                        "that agree are a distortion that the model does not have.");
}

HtmlPage::Figure radial_figure(const CalibrationRun& run) {
    const Intrinsics& k = run.calibration.camera.intrinsics;
    constexpr std::size_t rings = 10;
    const double corner =
        0.5 * std::hypot(run.calibration.camera.width, run.calibration.camera.height);
    Series radial, ring_means;
    std::array<double, rings> sums{}, counts{};
    for_each_corner(run, [&](std::size_t v, std::size_t i, const Eigen::Vector2d& pixel) {
        const Eigen::Vector2d arm = pixel - Eigen::Vector2d(k.cx, k.cy);
        const double radius = arm.norm();
        if (run.calibration.views[v].left_out[i] || !(radius > 0.0))
            return;
        radial.add(radius, run.calibration.views[v].residuals_px[i].dot(arm) / radius,
                   point_note(run, v, i));
        const auto ring = std::min(rings - 1, static_cast<std::size_t>(rings * radius / corner));
        sums[ring] += radial.ys.back();
        counts[ring] += 1.0;
    });
    constexpr double min_for_a_mean = 8;
    for (std::size_t ring = 0; ring < rings; ++ring)
        if (counts[ring] >= min_for_a_mean)
            ring_means.add((static_cast<double>(ring) + 0.5) / rings * corner,
                           sums[ring] / counts[ring]);
    SvgPlot plot("distance from the principal point / px", "outward residual / px");
    plot.add_points(radial, Color::blue, "corner");
    plot.add_line(ring_means, Color::orange, "mean of a ring");
    return {plot.svg(),
            "Residuals along the radius. A mean that bends away from zero is radial distortion "
            "that the model does not have."};
}

std::vector<HtmlPage::Figure> uncertainty_figures(const CameraCalibration& calibration) {
    const ProjectionUncertainty& map = calibration.uncertainty;
    HeatMap heat;
    heat.cell_width = map.step_x_px;
    heat.cell_height = map.step_y_px;
    heat.image_width = calibration.camera.width;
    heat.image_height = calibration.camera.height;
    heat.unit = "px";
    const auto figure = [&](double PixelUncertainty::*value, const std::string& what) {
        heat.centres.clear();
        heat.values.clear();
        for (const PixelUncertainty& each : map.pixels) {
            heat.centres.push_back(each.pixel);
            heat.values.push_back(each.*value);
        }
        heat.highest = std::max(map.worst_among_points(value), 1e-12);
        return HtmlPage::Figure{
            heat_map_svg(heat),
            fmt::format("{}: {:.2f} px in the mean over the image, {:.2f} px at worst among the "
                        "corners, where the scale ends, and {:.2f} px beyond them. Do not measure "
                        "where it is bright.",
                        what, map.mean(value), map.worst_among_points(value), map.worst(value))};
    };
    return {figure(&PixelUncertainty::held,
                   "One standard deviation of where a fixed ray lands, camera held"),
            figure(&PixelUncertainty::rotated,
                   fmt::format("The same after the {} that takes back most of it",
                               best_motion(calibration.camera)))};
}

// A cell of the map is as wide as the nearest points are apart.
HtmlPage::Figure height_figure(const BoardShape& board) {
    Eigen::AlignedBox2d box;
    double lowest = board.points.front().displacement_mm.z(), highest = lowest, cell = 1e300;
    for (const ShapedPoint& point : board.points) {
        box.extend(point.drawn_mm.head<2>());
        lowest = std::min(lowest, point.displacement_mm.z());
        highest = std::max(highest, point.displacement_mm.z());
        for (const ShapedPoint& other : board.points)
            if (other.id != point.id)
                cell = std::min(cell, (other.drawn_mm - point.drawn_mm).norm());
    }
    HeatMap heat;
    heat.cell_width = heat.cell_height = cell;
    heat.image_width = static_cast<int>(std::ceil(box.sizes().x() + cell));
    heat.image_height = static_cast<int>(std::ceil(box.sizes().y() + cell));
    heat.unit = heat.axis_unit = "mm";
    heat.highest = std::max(highest - lowest, 1e-9);
    for (const ShapedPoint& point : board.points) {
        heat.centres.push_back(point.drawn_mm.head<2>() - box.min() +
                               Eigen::Vector2d::Constant(0.5 * cell));
        heat.values.push_back(point.displacement_mm.z() - lowest);
    }
    return {heat_map_svg(heat),
            fmt::format("How far each point lies along z = x cross y beyond the one that lies "
                        "least far: {:.3f} mm at most. The board as drawn, x to the right, y down. "
                        "A bow or a twist is paper or a plate that bends.",
                        highest - lowest)};
}

std::vector<HtmlPage::Figure> board_figures(const BoardShape& board) {
    Series arrows;
    Eigen::AlignedBox2d box;
    for (const ShapedPoint& point : board.points) {
        const Eigen::Vector3d &d = point.displacement_mm, &sd = point.deviation_mm;
        arrows.add(point.drawn_mm.head<2>(), d.head<2>(),
                   fmt::format("{}: ({:.3f}, {:.3f}, {:.3f}) +- ({:.3f}, {:.3f}, {:.3f}) mm",
                               point.id, d.x(), d.y(), d.z(), sd.x(), sd.y(), sd.z()));
        box.extend(point.drawn_mm.head<2>());
    }
    SvgPlot plot("x / mm", "y / mm");
    plot.set_image_axes();
    return {height_figure(board),
            arrow_figure(plot, arrows, box.sizes().x(), Color::blue, "in the plane",
                         "How far the points lie from the drawing in its plane, enlarged {:g} "
                         "times. Arrows that grow outwards are a print of another scale.")};
}

HtmlPage::Figure halves_figure(const CameraCalibration& calibration) {
    const CrossValidation& halves = *calibration.halves;
    Series arrows;
    for (std::size_t i = 0; i < halves.pixels.size(); ++i) {
        const Eigen::Vector2d& d = halves.differences_px[i];
        arrows.add(halves.pixels[i], d,
                   fmt::format("({:.0f}, {:.0f}): {:.3f} px", halves.pixels[i].x(),
                               halves.pixels[i].y(), d.norm()));
    }
    const CameraModel& camera = calibration.camera;
    return arrow_figure(
        image_plot(camera), arrows, camera.width, Color::green, "second half minus first",
        std::string("How differently the two halves project, after the best ") +
            best_motion(camera) +
            "; enlarged {:g} times. Look for an edge where they part: the photos do not hold the "
            "camera there.");
}

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
    page.add_table(parameter_table(calibration));
    if (!held_parameters(calibration).empty())
        page.add_notes({std::string("cx and cy are held: the centre ") + reason_held + "."});
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

void add_models(HtmlPage& page, const CalibrationRun& run) {
    page.add_heading("Which model these photos support");
    page.add_table(model_table(run));
    page.add_paragraph(
        "Left out: every photo in turn is taken away, the camera calibrated from the others, and "
        "of the photo only its pose fitted. Advised is the simplest model within one standard "
        "error of the best, paired by photo, and not more than a quarter worse. A richer one that "
        "predicts worse overfits. Certain to: the largest standard deviation of a ray's image "
        "among the corners. Halves: how far two calibrations of every second photo project apart. "
        "A model is not advised where the first is twice, or the second three times, what the best "
        "model and the left-out error leave.");
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
        "covariances lead to expect {:.3f} px, the cluster-robust ones {:.3f} px.",
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

}  // namespace

std::string calibration_html(const CalibrationRun& run) {
    const CameraModel& camera = run.calibration.camera;
    HtmlPage page("Calibration of " + run.camera_file.filename().string(),
                  fmt::format("{} x {} px, {} photos of {}", camera.width, camera.height,
                              run.photos.size(), run.target));
    add_summary(page, run);
    add_parameters(page, run.calibration);
    add_models(page, run);
    page.add_heading("Residuals and where the corners are");
    page.add_figures(
        {residual_figure(run), radial_figure(run), photo_figure(run), coverage_figure(run)});
    add_uncertainty(page, run.calibration);
    add_halves(page, run.calibration);
    add_board(page, run.calibration);
    page.add_heading("Photos");
    page.add_table(photo_table(run));
    page.begin_details("Software");
    page.add_software(software_versions());
    page.end_details();
    return page.finish();
}

}  // namespace etalon
