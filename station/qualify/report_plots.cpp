#include "station/qualify/report_plots.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "report/svg_plot.h"

namespace etalon {
namespace {

// The hold-out poses that have a B3, in columns.
struct HoldOut {
    std::vector<double> x, y, z, tangent;  // of the marker's centre, camera frame
    std::vector<double> bias_x, bias_y, bias_z;
    std::vector<double> field_x, field_y, field_z;  // the fitted field at the same poses
    std::vector<std::string> notes;
};

HoldOut hold_out_biases(const QualifyResult& result) {
    const Qualification& analysis = *result.analysis;
    HoldOut columns;
    for (std::size_t i = 0; i < analysis.poses.size(); ++i) {
        const QualifiedPose& pose = analysis.poses[i];
        if (!pose.hold_out || !pose.bias.b3)
            continue;
        const Eigen::Vector3d p = pose.bias.predicted.translation, b = pose.bias.b3->translation_mm;
        const Eigen::Vector3d field = analysis.position_field
                                          ? analysis.position_field->at(p)
                                          : Eigen::Vector3d::Constant(std::nan(""));
        columns.x.push_back(p.x());
        columns.y.push_back(p.y());
        columns.z.push_back(p.z());
        columns.tangent.push_back(off_axis_tangent(pose.bias.predicted));
        columns.bias_x.push_back(b.x());
        columns.bias_y.push_back(b.y());
        columns.bias_z.push_back(b.z());
        columns.field_x.push_back(field.x());
        columns.field_y.push_back(field.y());
        columns.field_z.push_back(field.z());
        columns.notes.push_back(
            fmt::format("pose {}: B3 = ({:.3f}, {:.3f}, {:.3f}) mm at ({:.0f}, "
                        "{:.0f}, {:.0f}) mm",
                        result.poses[i].index, b.x(), b.y(), b.z(), p.x(), p.y(), p.z()));
    }
    return columns;
}

// A 1-2-5 factor that makes the longest arrow about a sixth of the plot's width.
double arrow_scale(const HoldOut& columns) {
    double longest = 1e-9, span = 1.0;
    for (std::size_t i = 0; i < columns.x.size(); ++i) {
        longest = std::max({longest, std::hypot(columns.bias_x[i], columns.bias_y[i]),
                            std::hypot(columns.field_x[i], columns.field_y[i])});
        span = std::max({span, 2 * std::abs(columns.x[i]), 2 * std::abs(columns.y[i])});
    }
    const double wanted = span / 6.0 / longest;
    const double power = std::pow(10.0, std::floor(std::log10(wanted)));
    return wanted / power >= 5.0 ? 5.0 * power : wanted / power >= 2.0 ? 2.0 * power : power;
}

std::vector<double> scaled(std::vector<double> values, double factor) {
    for (double& value : values)
        value *= factor;
    return values;
}

HtmlPage::Figure arrow_figure(const HoldOut& columns) {
    const double factor = arrow_scale(columns);
    SvgPlot plot("x / mm", "y / mm");
    plot.set_size(560, 440);
    plot.set_image_axes();
    plot.add_arrows(columns.x, columns.y, scaled(columns.field_x, factor),
                    scaled(columns.field_y, factor), Ink::gray, "fitted field");
    plot.add_arrows(columns.x, columns.y, scaled(columns.bias_x, factor),
                    scaled(columns.bias_y, factor), Ink::blue, "B3", columns.notes);
    return {plot.svg(),
            fmt::format("Lateral position bias across the field of view, seen by the camera; "
                        "arrows are enlarged {:g} times.",
                        factor)};
}

HtmlPage::Figure component_figure(const HoldOut& columns, const std::vector<double>& abscissa,
                                  const std::string& label, const std::string& caption,
                                  double limit) {
    SvgPlot plot(label, "B3 / mm");
    plot.set_size(560, 440);
    plot.add_points(abscissa, columns.bias_x, Ink::blue, "x", columns.notes);
    plot.add_points(abscissa, columns.bias_y, Ink::green, "y", columns.notes);
    plot.add_points(abscissa, columns.bias_z, Ink::orange, "z", columns.notes);
    const std::string name = fmt::format("limit of the field's maximum, {:g} mm", limit);
    plot.add_level(limit, Ink::red, name);
    plot.add_level(-limit, Ink::red, "");
    return {plot.svg(), caption};
}

}  // namespace

double off_axis_tangent(const Rigid& camera_from_marker) {
    const Eigen::Vector3d& p = camera_from_marker.translation;
    return std::hypot(p.x(), p.y()) / p.z();
}

void add_bias_plots(HtmlPage& page, const QualifyResult& result) {
    const HoldOut columns = hold_out_biases(result);
    if (columns.x.empty())
        return;
    const double limit = result.station.limits.b3_position_field_max_mm;
    page.add_heading("Bias over the volume");
    page.add_figures(
        {arrow_figure(columns),
         component_figure(columns, columns.z, "depth z / mm", "Position bias against depth.",
                          limit),
         component_figure(columns, columns.tangent, "tangent of the angle to the optical axis",
                          "Position bias against the distance from the axis.", limit)});
}

void add_residual_summary(HtmlPage& page, const QualifyResult& result) {
    std::vector<double> pose, rms;
    std::vector<std::string> notes;
    for (const PoseRecord& each : result.poses) {
        if (!each.residual)
            continue;
        pose.push_back(each.index);
        rms.push_back(each.residual->scored.rms_gray);
        notes.push_back(fmt::format("pose {}: RMS {:.2f}, p99 {:.2f} gray", each.index,
                                    each.residual->scored.rms_gray,
                                    each.residual->scored.p99_gray));
    }
    if (pose.empty())
        return;
    page.add_paragraph(fmt::format(
        "Mean residual {:.2f} gray (code value / full scale * 255) over {} hold-out poses, after "
        "black and white level (a plane each) and one blur width were fitted on half of the "
        "marker's cells; scored on the other half.",
        *mean_residual_gray(result), rms.size()));
    SvgPlot plot("pose", "residual RMS / gray");
    plot.set_size(560, 260);
    plot.add_points(pose, rms, Ink::blue, "", notes);
    plot.set_y_range(0.0, 1.15 * *std::max_element(rms.begin(), rms.end()) + 1e-9);
    page.add_figures({{plot.svg(), "Photograph minus render, RMS per hold-out pose."}});
}

}  // namespace etalon
