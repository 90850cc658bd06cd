#include "station/calibrate/calibration_plots.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "report/heat_map.h"
#include "report/svg_plot.h"

namespace etalon {
namespace {

constexpr int map_width = 560, map_height = 440;

// The image's border, which also makes every map show the whole image.
void add_border(SvgPlot& plot, const CameraModel& camera) {
    const double x = camera.width - 0.5, y = camera.height - 0.5;
    plot.add_line(std::array{-0.5, x, x, -0.5, -0.5}, std::array{-0.5, -0.5, y, y, -0.5}, Ink::gray,
                  "");
}

SvgPlot image_plot(const CameraModel& camera) {
    SvgPlot plot("x / px", "y / px");
    plot.set_size(map_width, map_height);
    plot.set_image_axes();
    add_border(plot, camera);
    return plot;
}

// Of 1, 2, 5 times a power of ten: makes the longest arrow about a twentieth of the image.
double arrow_scale(double longest, const CameraModel& camera) {
    const double wanted = camera.width / 20.0 / std::max(longest, 1e-9);
    const double power = std::pow(10.0, std::floor(std::log10(wanted)));
    const double digit = wanted / power;
    return power * (digit >= 5.0 ? 5.0 : digit >= 2.0 ? 2.0 : 1.0);
}

struct Arrows {
    std::vector<double> x, y, dx, dy;
    std::vector<std::string> notes;

    void add(const Eigen::Vector2d& at, const Eigen::Vector2d& along, std::string note) {
        x.push_back(at.x());
        y.push_back(at.y());
        dx.push_back(along.x());
        dy.push_back(along.y());
        notes.push_back(std::move(note));
    }
    double longest() const {
        double longest = 0.0;
        for (std::size_t i = 0; i < dx.size(); ++i)
            longest = std::max(longest, std::hypot(dx[i], dy[i]));
        return longest;
    }
    void draw(SvgPlot& plot, double factor, Ink ink, const std::string& name) const {
        std::vector<double> u = dx, v = dy;
        for (std::size_t i = 0; i < u.size(); ++i) {
            u[i] *= factor;
            v[i] *= factor;
        }
        plot.add_arrows(x, y, u, v, ink, name, notes);
    }
};

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
    constexpr std::size_t most_letters = 6;
    const bool fit =
        names.size() <= 30 && std::all_of(names.begin(), names.end(), [&](const std::string& name) {
            return name.size() * names.size() <= most_letters * 14;
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
    std::vector<double> parameters, fitted, left_out_parameters, left_out;
    std::vector<std::string> notes, left_out_notes;
    for (const ModelScore& score : calibration.advice.models) {
        if (!score.fit || score.rms_px > far_worse * best)
            continue;
        parameters.push_back(score.parameters);
        fitted.push_back(score.rms_px);
        notes.push_back(fmt::format("{}: {:.4f} px in the fit", score.model, score.rms_px));
        if (!score.leave_one_out_rms_px || *score.leave_one_out_rms_px > 2.0 * far_worse * best)
            continue;
        left_out_parameters.push_back(score.parameters);
        left_out.push_back(*score.leave_one_out_rms_px);
        left_out_notes.push_back(
            fmt::format("{}: {:.4f} px left out", score.model, *score.leave_one_out_rms_px));
    }
    SvgPlot plot("free parameters of the camera", "error / px");
    plot.set_size(map_width, map_height);
    plot.add_line(parameters, fitted, Ink::gray, "");
    plot.add_points(parameters, fitted, Ink::gray, "in the fit", notes);
    plot.add_line(left_out_parameters, left_out, Ink::blue, "");
    plot.add_points(left_out_parameters, left_out, Ink::blue, "on photos left out", left_out_notes);
    return {plot.svg(),
            "Error of each model, those left out of the picture that are far worse. More "
            "parameters always fit better; where the blue line turns up, they follow the photos "
            "and not the lens."};
}

HtmlPage::Figure deviation_figure(const CameraCalibration& calibration) {
    std::vector<std::string> names;
    std::vector<double> ones, robust_x, robust, bootstrap_x, bootstrap;
    for (const ParameterDeviation& each : calibration.deviations) {
        const double i = static_cast<double>(names.size());
        names.push_back(each.name);
        ones.push_back(1.0);
        if (!(each.formal > 0.0))
            continue;
        robust_x.push_back(i - 0.12);
        robust.push_back(each.cluster_robust / each.formal);
        if (!each.bootstrap)
            continue;
        bootstrap_x.push_back(i + 0.12);
        bootstrap.push_back(*each.bootstrap / each.formal);
    }
    SvgPlot plot("", "standard deviation / formal one");
    plot.set_size(map_width, map_height);
    plot.add_bars(names, ones, Ink::gray);
    plot.add_points(robust_x, robust, Ink::blue, "cluster-robust");
    plot.add_points(bootstrap_x, bootstrap, Ink::orange, "bootstrap");
    plot.add_level(suspicious_deviation_ratio, Ink::red, "suspicious above");
    return {plot.svg(),
            "Standard deviations over photos against the formal one (gray), which takes all "
            "corners for independent. The largest of each is used."};
}

HtmlPage::Figure photo_figure(const CalibrationRun& run) {
    std::vector<double> fitted, left_out;
    for (const CalibratedView& view : run.calibration.views) {
        fitted.push_back(view.used() ? view.rms_px : 0.0);
        left_out.push_back(view.left_out_rms_px.value_or(0.0));
    }
    const std::vector<std::string> labels = short_labels(run.photos);
    SvgPlot plot("photo", "error / px");
    plot.set_size(map_width, map_height);
    plot.add_bars(labels, left_out, Ink::orange);
    plot.add_bars(labels, fitted, Ink::blue);
    return {plot.svg(),
            "RMS of each photo's corners: blue in the fit, orange what is added when the camera "
            "is calibrated without the photo. A tall orange part: this photo decides something "
            "alone."};
}

HtmlPage::Figure coverage_figure(const CalibrationRun& run) {
    std::vector<double> x, y, left_out_x, left_out_y;
    std::vector<std::string> notes, left_out_notes;
    for (std::size_t v = 0; v < run.views.size(); ++v)
        for (std::size_t i = 0; i < run.views[v].pixels.size(); ++i) {
            const bool left_out = run.calibration.views[v].left_out[i];
            (left_out ? left_out_x : x).push_back(run.views[v].pixels[i].x());
            (left_out ? left_out_y : y).push_back(run.views[v].pixels[i].y());
            (left_out ? left_out_notes : notes).push_back(point_note(run, v, i));
        }
    SvgPlot plot = image_plot(run.calibration.camera);
    plot.add_points(x, y, Ink::blue, "used", notes);
    if (!left_out_x.empty())
        plot.add_points(left_out_x, left_out_y, Ink::red, "left out", left_out_notes);
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
    const double factor = arrow_scale(arrows.longest(), run.calibration.camera);
    SvgPlot plot = image_plot(run.calibration.camera);
    arrows.draw(plot, factor, Ink::blue, "photo minus model");
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
    std::vector<double> radii, radial, ring_radii, ring_means;
    std::array<double, rings> sums{}, counts{};
    std::vector<std::string> notes;
    for (std::size_t v = 0; v < run.views.size(); ++v)
        for (std::size_t i = 0; i < run.views[v].pixels.size(); ++i) {
            const Eigen::Vector2d arm = run.views[v].pixels[i] - Eigen::Vector2d(k.cx, k.cy);
            const double radius = arm.norm();
            if (run.calibration.views[v].left_out[i] || !(radius > 0.0))
                continue;
            radii.push_back(radius);
            radial.push_back(run.calibration.views[v].residuals_px[i].dot(arm) / radius);
            notes.push_back(point_note(run, v, i));
            const auto ring =
                std::min(rings - 1, static_cast<std::size_t>(rings * radius / corner));
            sums[ring] += radial.back();
            counts[ring] += 1.0;
        }
    constexpr double least_for_a_mean = 8;
    for (std::size_t ring = 0; ring < rings; ++ring)
        if (counts[ring] >= least_for_a_mean) {
            ring_radii.push_back((static_cast<double>(ring) + 0.5) / rings * corner);
            ring_means.push_back(sums[ring] / counts[ring]);
        }
    SvgPlot plot("distance from the principal point / px", "outward residual / px");
    plot.set_size(map_width, map_height);
    plot.add_points(radii, radial, Ink::blue, "corner", notes);
    plot.add_line(ring_radii, ring_means, Ink::orange, "mean of a ring");
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
                        "corners, where the scale ends, and {:.2f} px beyond them.",
                        what, map.mean(value), map.worst_among_points(value), map.worst(value))};
    };
    return {figure(&PixelUncertainty::held,
                   "One standard deviation of where a fixed ray lands, "
                   "camera held"),
            figure(&PixelUncertainty::rotated,
                   "The same after the rotation that takes back most of it")};
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
    const double factor = arrow_scale(arrows.longest(), calibration.camera);
    SvgPlot plot = image_plot(calibration.camera);
    arrows.draw(plot, factor, Ink::green, "second half minus first");
    return {plot.svg(),
            fmt::format("How differently the two halves project, after the best rotation; "
                        "enlarged {:g} times.",
                        factor)};
}

}  // namespace etalon
