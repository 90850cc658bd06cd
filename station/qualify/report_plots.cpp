#include "station/qualify/report_plots.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "calib/camera/viewing_geometry.h"
#include "compare/pose/pose_bias.h"
#include "core/geometry/units.h"
#include "report/svg_plot.h"

namespace etalon {
namespace {

constexpr int plot_width = 420, plot_height = 340;  // three beside each other stay readable

// The hold-out poses that have a B3: place and angle of the marker's centre in the camera frame,
// its bias, and the fitted field there.
struct HoldOut {
    Arrows biases, field;
    std::array<Series, 3> by_depth, by_angle;  // x, y and z of the bias
    double span_mm = 1.0;                      // of the places, across
};

HoldOut hold_out_biases(const QualifyResult& result) {
    const Qualification& analysis = *result.analysis;
    const LensProjection& projection = result.station.camera.model.projection;
    HoldOut poses;
    for (const Pose& pose : result.poses) {
        if (!pose.hold_out || !pose.bias.b3)
            continue;
        const Eigen::Vector3d p = pose.bias.predicted.translation, b = pose.bias.b3->translation_mm;
        const Eigen::Vector3d field = analysis.position_field
                                          ? analysis.position_field->at(p)
                                          : Eigen::Vector3d::Constant(std::nan(""));
        const std::string note =
            fmt::format("pose {}: B3 = ({:.3f}, {:.3f}, {:.3f}) mm at ({:.0f}, {:.0f}, {:.0f}) mm",
                        pose.index, b.x(), b.y(), b.z(), p.x(), p.y(), p.z());
        poses.biases.add(p.head<2>(), b.head<2>(), note);
        poses.field.add(p.head<2>(), field.head<2>());
        for (int axis = 0; axis < 3; ++axis) {
            poses.by_depth[axis].add(depth_mm(projection, p), b(axis), note);
            poses.by_angle[axis].add(off_axis_deg(pose.bias.predicted), b(axis), note);
        }
        poses.span_mm = std::max({poses.span_mm, 2 * std::abs(p.x()), 2 * std::abs(p.y())});
    }
    return poses;
}

// The longest arrow is about a sixth of the plot's width.
HtmlPage::Figure arrow_figure(const HoldOut& poses) {
    const double longest = std::max({1e-9, poses.biases.longest(), poses.field.longest()});
    const double factor = round_scale(poses.span_mm / 6.0 / longest);
    SvgPlot plot("x / mm", "y / mm");
    plot.set_size(plot_width, plot_height);
    plot.set_image_axes();
    plot.add_arrows(poses.field, factor, Color::gray, "fitted field");
    plot.add_arrows(poses.biases, factor, Color::blue, "B3");
    return {
        plot.svg(),
        fmt::format("B3 across the field of view, seen by the camera, enlarged {:g} times. Look "
                    "for arrows that turn or grow together: that is the field which is judged "
                    "(gray), the rest is noise.",
                    factor)};
}

HtmlPage::Figure component_figure(const std::array<Series, 3>& biases, const std::string& label,
                                  const std::string& caption, double limit) {
    SvgPlot plot(label, "B3 / mm");
    plot.set_size(plot_width, plot_height);
    plot.add_points(biases[0], Color::blue, "x");
    plot.add_points(biases[1], Color::green, "y");
    plot.add_points(biases[2], Color::orange, "z");
    plot.add_level(limit, Color::red, fmt::format("limit of the maximum, {:g} mm", limit));
    plot.add_level(-limit, Color::red, "");
    return {plot.svg(), caption};
}

}  // namespace

double off_axis_deg(const Rigid& camera_from_marker) {
    const Eigen::Vector3d& p = camera_from_marker.translation;
    return std::atan2(std::hypot(p.x(), p.y()), p.z()) * deg_per_rad;
}

void add_bias_plots(HtmlPage& page, const QualifyResult& result) {
    const HoldOut poses = hold_out_biases(result);
    if (poses.biases.xs.empty())
        return;
    const double limit = *result.station.limits.b3_position_field_max_mm;
    const bool is_flat = result.station.camera.model.projection.is_flat();
    page.add_heading("Bias over the volume");
    page.add_figures(
        {arrow_figure(poses),
         component_figure(poses.by_depth, is_flat ? "depth z / mm" : "distance / mm",
                          "B3 against depth. Look for z rising or falling with depth: focal "
                          "length, marker size or stage scale.",
                          limit),
         component_figure(poses.by_angle, "angle to the optical axis / deg",
                          "B3 against the distance from the axis. Look for points that leave "
                          "zero on the right: distortion.",
                          limit)});
}

void add_residual_summary(HtmlPage& page, const QualifyResult& result) {
    Series residuals;
    for (const Pose& each : result.poses)
        if (each.residual)
            residuals.add(each.index, each.residual->rms_gray,
                          fmt::format("pose {}: RMS {:.2f}, p99 {:.2f} gray", each.index,
                                      each.residual->rms_gray, each.residual->p99_gray));
    if (residuals.empty())
        return;
    page.add_paragraph(fmt::format(
        "Mean residual {:.2f} gray (code value / full scale * 255) over {} hold-out poses, after "
        "black and white level (a plane each) and one blur width were fitted on half of the "
        "marker's cells; scored on the other half.",
        *mean_residual_gray(result), residuals.xs.size()));
    SvgPlot plot("pose", "residual RMS / gray");
    plot.set_size(640, 260);
    plot.add_points(residuals, Color::blue, "");
    plot.set_y_range(0.0,
                     1.15 * *std::max_element(residuals.ys.begin(), residuals.ys.end()) + 1e-9);
    page.add_figures(
        {{plot.svg(),
          "Photograph minus render, RMS per hold-out pose. Look for poses that stand out: "
          "something covered the marker, moved or reflected there."}});
}

}  // namespace etalon
