#include "station/calibrate/calibration_plots.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "report/svg_plot.h"

namespace etalon {
namespace {

SvgPlot image_plot(const CameraModel& camera) {
    SvgPlot plot("x / px", "y / px");
    plot.show_image(camera.width, camera.height);
    return plot;
}

// The longest arrow is about a twentieth of the image.
double arrow_scale(const Arrows& arrows, const CameraModel& camera) {
    return round_scale(camera.width / 20.0 / std::max(arrows.longest(), 1e-9));
}

std::string point_note(const CalibrationRun& run, std::size_t view, std::size_t point) {
    const Eigen::Vector2d& r = run.calibration.views[view].residuals_px[point];
    return fmt::format("{}: ({:.2f}, {:.2f}) px, {:.2f} px", short_name(run.photos[view]), r.x(),
                       r.y(), r.norm());
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

}  // namespace

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
    for (std::size_t v = 0; v < run.views.size(); ++v)
        for (std::size_t i = 0; i < run.views[v].pixels.size(); ++i) {
            const Eigen::Vector2d& q = run.views[v].pixels[i];
            (run.calibration.views[v].left_out[i] ? left_out : used)
                .add(q.x(), q.y(), point_note(run, v, i));
        }
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
    Arrows arrows;
    for (std::size_t v = 0; v < run.views.size(); ++v)
        for (std::size_t i = 0; i < run.views[v].pixels.size(); ++i)
            if (!run.calibration.views[v].left_out[i])
                arrows.add(run.views[v].pixels[i], run.calibration.views[v].residuals_px[i],
                           point_note(run, v, i));
    const double factor = arrow_scale(arrows, run.calibration.camera);
    SvgPlot plot = image_plot(run.calibration.camera);
    plot.add_arrows(arrows, factor, Color::blue, "photo minus model");
    return {plot.svg(),
            fmt::format("Residuals, enlarged {:g} times. Neighbouring arrows of different photos "
                        "that agree are a distortion that the model does not have.",
                        factor)};
}

HtmlPage::Figure radial_figure(const CalibrationRun& run) {
    const Intrinsics& k = run.calibration.camera.intrinsics;
    constexpr std::size_t rings = 10;
    const double corner =
        0.5 * std::hypot(run.calibration.camera.width, run.calibration.camera.height);
    Series radial, ring_means;
    std::array<double, rings> sums{}, counts{};
    for (std::size_t v = 0; v < run.views.size(); ++v)
        for (std::size_t i = 0; i < run.views[v].pixels.size(); ++i) {
            const Eigen::Vector2d arm = run.views[v].pixels[i] - Eigen::Vector2d(k.cx, k.cy);
            const double radius = arm.norm();
            if (run.calibration.views[v].left_out[i] || !(radius > 0.0))
                continue;
            radial.add(radius, run.calibration.views[v].residuals_px[i].dot(arm) / radius,
                       point_note(run, v, i));
            const auto ring =
                std::min(rings - 1, static_cast<std::size_t>(rings * radius / corner));
            sums[ring] += radial.ys.back();
            counts[ring] += 1.0;
        }
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
                        "where it is "
                        "bright.",
                        what, map.mean(value), map.worst_among_points(value), map.worst(value))};
    };
    return {figure(&PixelUncertainty::held,
                   "One standard deviation of where a fixed ray lands, "
                   "camera held"),
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
    return {
        heat_map_svg(heat),
        fmt::format(
            "How far each point lies along z = x cross y beyond the one that lies "
            "least far: {:.3f} mm at most. The board as drawn, x to the right, y down. A bow or a "
            "twist is paper or a plate that bends.",
            highest - lowest)};
}

std::vector<HtmlPage::Figure> board_figures(const BoardShape& board) {
    Arrows arrows;
    Eigen::AlignedBox2d box;
    for (const ShapedPoint& point : board.points) {
        const Eigen::Vector3d &d = point.displacement_mm, &sd = point.deviation_mm;
        arrows.add(point.drawn_mm.head<2>(), d.head<2>(),
                   fmt::format("{}: ({:.3f}, {:.3f}, {:.3f}) +- ({:.3f}, {:.3f}, {:.3f}) mm",
                               point.id, d.x(), d.y(), d.z(), sd.x(), sd.y(), sd.z()));
        box.extend(point.drawn_mm.head<2>());
    }
    const double factor = round_scale(box.sizes().x() / 20.0 / std::max(arrows.longest(), 1e-9));
    SvgPlot plot("x / mm", "y / mm");
    plot.set_image_axes();
    plot.add_arrows(arrows, factor, Color::blue, "in the plane");
    return {height_figure(board),
            {plot.svg(), fmt::format("How far the points lie from the drawing in its plane, "
                                     "enlarged {:g} times. Arrows that grow outwards "
                                     "are a print of another scale.",
                                     factor)}};
}

HtmlPage::Figure halves_figure(const CameraCalibration& calibration) {
    const CrossValidation& halves = *calibration.halves;
    Arrows arrows;
    for (std::size_t i = 0; i < halves.pixels.size(); ++i) {
        const Eigen::Vector2d& d = halves.differences_px[i];
        arrows.add(halves.pixels[i], d,
                   fmt::format("({:.0f}, {:.0f}): {:.3f} px", halves.pixels[i].x(),
                               halves.pixels[i].y(), d.norm()));
    }
    const double factor = arrow_scale(arrows, calibration.camera);
    SvgPlot plot = image_plot(calibration.camera);
    plot.add_arrows(arrows, factor, Color::green, "second half minus first");
    return {plot.svg(),
            fmt::format(
                "How differently the two halves project, after the best {}; "
                "enlarged {:g} times. Look for an edge where they part: the photos do not hold the "
                "camera there.",
                best_motion(calibration.camera), factor)};
}

}  // namespace etalon
