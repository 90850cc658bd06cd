#include <fmt/format.h>

#include <tuple>

#include "report/svg_plot.h"
#include "station/compare/comparison.h"

namespace etalon {
namespace {

// Names under bars; where there are too many to read, every second or third or ...
std::vector<std::string> bar_names(const std::vector<std::string>& photos) {
    constexpr std::size_t readable = 10;
    const std::size_t step = (photos.size() + readable - 1) / readable;
    std::vector<std::string> names;
    for (std::size_t i = 0; i < photos.size(); ++i)
        names.push_back(i % step == 0 ? photos[i] : std::string());
    return names;
}

ComparisonPlot residual_by_photo(const Comparison& comparison) {
    std::vector<std::string> names;
    std::vector<double> under_test;
    Series refined;
    for (const ComparedPhoto& photo : comparison.photos) {
        if (!photo.has_figures())
            continue;
        names.push_back(photo.photo.stem().string());
        under_test.push_back(photo.calibrated->scored.rms_gray);
        const double rms_gray = photo.refined->scored.rms_gray;
        refined.add(static_cast<double>(names.size() - 1), rms_gray,
                    fmt::format("{}: {:.3g} gray at the refined pose", names.back(), rms_gray));
    }
    SvgPlot plot("photograph", "residual RMS / gray");
    plot.add_bars(bar_names(names), under_test, Color::blue);
    plot.add_points(refined, Color::orange, "at the refined pose");
    plot.add_level(comparison.mean_rms_gray(), Color::blue,
                   fmt::format("mean {:.1f}", comparison.mean_rms_gray()));
    return {"residual-by-photo.svg", plot.svg(),
            "Residual of each photograph, scored half: bars at the pose under test, points at the "
            "photometric pose. Look for a bar that stands out; a point far below its bar is a pose "
            "that was wrong."};
}

// Of both poses; nothing where neither has a figure.
void add_profiles(const ResidualProfile& calibrated, const ResidualProfile& refined,
                  const char* label, const char* unit, const std::string& file,
                  const std::string& caption, std::vector<ComparisonPlot>& plots) {
    SvgPlot plot(label, "residual RMS / gray");
    double highest = 0.0;
    for (const auto& [profile, color, name] :
         {std::tuple(&calibrated, Color::blue, "pose under test"),
          std::tuple(&refined, Color::orange, "refined pose")}) {
        Series series;
        for (const auto& [middle, rms_gray, pixels] : profile->points()) {
            series.add(middle, rms_gray,
                       fmt::format("{:.0f} {}: {:.2f} gray, {:.0f} pixels", middle, unit, rms_gray,
                                   pixels));
            highest = std::max(highest, rms_gray);
        }
        if (!series.empty())
            plot.add_curve(series, color, name);
    }
    if (!(highest > 0.0))
        return;
    plot.set_y_range(0.0, 1.15 * highest);
    plots.push_back({file, plot.svg(), caption});
}

ComparisonPlot baseline_plot(const BaselineChange& change) {
    std::vector<std::string> names;
    std::vector<double> differences;
    for (const auto& [earlier, now] : change.pairs)
        if (earlier.residual_gray && now.residual_gray) {
            names.push_back(std::filesystem::path(now.name).stem().string());
            differences.push_back(*now.residual_gray - *earlier.residual_gray);
        }
    SvgPlot plot("photograph", "change of the residual / gray");
    plot.add_bars(bar_names(names), differences, Color::blue);
    return {"baseline-residual.svg", plot.svg(),
            "Residual now minus residual then, photograph by photograph, at the poses under test. "
            "Bars of one sign are a change of the camera, a single one of its photograph."};
}

constexpr int bins = 8;

// A line with a head at its end, in the drawing's coordinates.
std::string arrow(const Eigen::Vector2d& from, const Eigen::Vector2d& to) {
    const Eigen::Vector2d way = to - from;
    const double length = way.norm();
    std::string path =
        fmt::format("M{:.1f} {:.1f}L{:.1f} {:.1f}", from.x(), from.y(), to.x(), to.y());
    if (length > 2.0) {
        const Eigen::Vector2d along = way / length * std::min(4.0, 0.5 * length);
        const Eigen::Vector2d across(-0.5 * along.y(), 0.5 * along.x());
        const Eigen::Vector2d left = to - along + across, right = to - along - across;
        path += fmt::format("M{:.1f} {:.1f}L{:.1f} {:.1f}L{:.1f} {:.1f}", left.x(), left.y(),
                            to.x(), to.y(), right.x(), right.y());
    }
    return path;
}

std::string edge_svg(const EdgeShift& edge, const Eigen::Vector2d& origin, double magnification) {
    const Eigen::Vector2d middle = edge.middle_px - origin;
    const Eigen::Vector2d half =
        0.5 * edge.length_px * Eigen::Vector2d(-edge.normal.y(), edge.normal.x());
    const Eigen::Vector2d from = middle - half, to = middle + half;
    std::string text =
        fmt::format("<path class='axis' stroke-width='1' d='M{:.1f} {:.1f}L{:.1f} {:.1f}'/>",
                    from.x(), from.y(), to.x(), to.y());
    if (edge.is_beyond_range)
        return text + fmt::format(
                          "<g class='red'><circle class='stroke' stroke-width='1.5' "
                          "cx='{:.1f}' cy='{:.1f}' r='4'/></g>",
                          middle.x(), middle.y());
    const bool is_significant = std::abs(edge.shift_px) > 3.0 * edge.shift_deviation_px;
    return text + fmt::format(
                      "<g class='{}'><path class='stroke' stroke-width='1.6' d='{}'/>"
                      "<title>({:.0f}, {:.0f}): {:+.3f} px, σ {:.3f} px</title></g>",
                      is_significant ? "red" : "blue",
                      arrow(middle, middle + magnification * edge.shift_px * edge.normal),
                      edge.middle_px.x(), edge.middle_px.y(), edge.shift_px,
                      edge.shift_deviation_px);
}

// 1, 2 or 5 times a power of ten that draws this RMS about `drawn` long.
double round_magnification(double rms, double drawn) {
    if (!(rms > 0.0))
        return 100.0;
    return round_scale(std::min(1e4, drawn / rms));
}

ComparisonPlot field_plot(const std::vector<ShiftVector>& field, const CameraModel& camera,
                          double magnification, const std::string& file, const std::string& where) {
    Series arrows;
    for (const ShiftVector& vector : field)
        arrows.add(vector.position_px, vector.shift_px,
                   fmt::format("({:.0f}, {:.0f}): {:+.3f}, {:+.3f} px (σ {:.3f}, {:.3f}), {} edges",
                               vector.position_px.x(), vector.position_px.y(), vector.shift_px.x(),
                               vector.shift_px.y(), std::sqrt(vector.covariance_px2(0, 0)),
                               std::sqrt(vector.covariance_px2(1, 1)), vector.edges));
    SvgPlot plot("x / px", "y / px");
    plot.show_image(camera.width, camera.height);
    plot.add_arrows(arrows, magnification, Color::blue,
                    fmt::format("photograph minus rendering × {:.0f}", magnification));
    return {file, plot.svg(),
            fmt::format("Where edges lie in the photographs against the renderings, {}, mean over "
                        "all photographs, drawn {:.0f} times as large. A pattern that all "
                        "photographs share is the camera's.",
                        where, magnification)};
}

Series shifts_of(const std::vector<EdgeBin>& binned) {
    Series series;
    for (const EdgeBin& bin : binned) {
        const auto& shift = bin.summary.shift;
        if (bin.summary.edges >= 4)
            series.add(0.5 * (bin.low + bin.high), shift.rms_px,
                       std::max(0.0, shift.rms_px - shift.rms_deviation_px),  // a root mean square
                       shift.rms_px + shift.rms_deviation_px,
                       fmt::format("{:.3f} px, σ {:.3f}, {} edges", shift.rms_px,
                                   shift.rms_deviation_px, bin.summary.edges));
    }
    return series;
}

// Adds the series; returns where its band ends.
double draw(SvgPlot& plot, const Series& series, Color color, const std::string& name) {
    plot.add_band(series, color, "");
    plot.add_curve(series, color, name);
    return series.empty() ? 0.0 : *std::max_element(series.vs.begin(), series.vs.end());
}

ComparisonPlot shift_plot(const std::vector<EdgeBin>& before, const std::vector<EdgeBin>& after,
                          const char* label, const std::string& file, const std::string& caption) {
    SvgPlot plot(label, "edge shift RMS / px");
    const double under_test = draw(plot, shifts_of(before), Color::blue, "pose under test");
    const double refined = draw(plot, shifts_of(after), Color::orange, "refined pose");
    plot.set_y_range(0.0, 1.05 * std::max({under_test, refined, 1e-3}));
    return {file, plot.svg(), caption};
}

ComparisonPlot width_plot(const Comparison& comparison) {
    SvgPlot plot("depth / mm", "width of edges, variance / px²");
    bool is_named = false;
    for (const ComparedPhoto& photo : comparison.photos) {
        if (!photo.defocus)
            continue;
        Series photographed, rendered;
        for (const DepthBin& bin : photo.defocus->bins) {
            if (bin.edges < 2)
                continue;
            rendered.add(bin.depth_mm, bin.rendered_px2);
            photographed.add(
                bin.depth_mm, bin.measured_px2,
                fmt::format("{}: {:.1f} mm, {:.3f} px² (σ {:.3f}) against {:.3f}",
                            photo.photo.filename().string(), bin.depth_mm, bin.measured_px2,
                            bin.measured_deviation_px2, bin.rendered_px2));
        }
        plot.add_line(rendered, Color::gray, is_named ? "" : "rendering");
        plot.add_points(photographed, Color::blue, is_named ? "" : "photograph");
        is_named = true;
    }
    return {"edge-width-by-depth.svg", plot.svg(),
            "Width of edges by depth, at the refined poses: what the lens section promises, and "
            "what the photographs have. Widths that part on one side only have another focus "
            "distance; that part on both, another f-number or another sharpness."};
}

// Of all photographs together; none where no edges were measured.
std::vector<ComparisonPlot> edge_plots(const Comparison& comparison) {
    const std::vector<EdgeShift> before = comparison.edges(&ComparedPhoto::calibrated, false);
    const std::vector<EdgeShift> after = comparison.edges(&ComparedPhoto::refined, false);
    if (before.empty() || after.empty())
        return {};
    const CameraModel& camera = comparison.camera;
    const cv::Size image(camera.width, camera.height);
    const double spacing = std::max(camera.width, camera.height) / 12.0;
    const std::vector<ShiftVector> field = shift_field(before, image, spacing);
    double squares = 0.0;
    for (const ShiftVector& vector : field)
        squares += vector.shift_px.squaredNorm();
    const auto vectors = static_cast<double>(std::max<std::size_t>(field.size(), 1));
    const double magnification = round_magnification(std::sqrt(squares / vectors), 0.4 * spacing);
    std::vector<ComparisonPlot> plots;
    plots.push_back(field_plot(field, camera, magnification, "edge-shift-field.svg",
                               "at the poses under test"));
    plots.push_back(field_plot(shift_field(after, image, spacing), camera, magnification,
                               "edge-shift-field-refined.svg", "at the refined poses"));
    plots.push_back(shift_plot(
        edges_by_radius(before, image, bins), edges_by_radius(after, image, bins),
        "distance from the image's centre / px", "edge-shift-by-radius.svg",
        "Edge shift by distance from the image's centre, noise taken out; bands: one standard "
        "deviation. What grows outwards and stays at the refined poses is distortion."));
    plots.push_back(shift_plot(edges_by_depth(before, bins), edges_by_depth(after, bins),
                               "depth / mm", "edge-shift-by-depth.svg",
                               "Edge shift by depth, noise taken out. What the refined poses take "
                               "away was the poses' error."));
    if (camera.lens)
        plots.push_back(width_plot(comparison));
    return plots;
}

}  // namespace

double arrow_magnification(const Comparison& comparison) {
    constexpr double drawn_px = 12.0;
    double squares = 0.0, count = 0.0;
    for (const EdgeShift& edge : comparison.edges(&ComparedPhoto::calibrated, false))
        if (!edge.is_beyond_range) {
            squares += edge.shift_px * edge.shift_px;
            count += 1.0;
        }
    return round_magnification(count > 0.0 ? std::sqrt(squares / count) : 0.0, drawn_px);
}

std::string edge_map_svg(const ComparedPhoto& photo, double magnification) {
    const cv::Rect& part = photo.pictures.part;
    std::string text =
        fmt::format("<svg class='plot' viewBox='0 0 {} {}' role='img' aria-label='edge shifts'>",
                    part.width, part.height);
    for (const EdgeShift& edge : photo.refined->edges)
        text += edge_svg(edge, Eigen::Vector2d(part.x, part.y), magnification);
    // A bar of 20 px as drawn, with its length as measured.
    const double x = 8.0, y = part.height - 8.0;
    return text + fmt::format(
                      "<g class='red'><path class='stroke' stroke-width='2' d='M{:.1f} {:.1f}h20'/>"
                      "</g><text x='{:.1f}' y='{:.1f}'>{:.2g} px</text></svg>",
                      x, y, x + 25.0, y + 4.0, 20.0 / magnification);
}

std::vector<ComparisonPlot> comparison_plots(const Comparison& comparison) {
    std::vector<ComparisonPlot> plots{residual_by_photo(comparison)};
    const auto& profiles = comparison.profiles;
    add_profiles(profiles[0], profiles[1], "distance from the image's centre / px", "px",
                 "residual-by-radius.svg",
                 "Residual by distance from the image's centre, all photographs together. A rise "
                 "outwards points at the distortion or at the lens, not at the sensor.",
                 plots);
    add_profiles(
        profiles[2], profiles[3], "depth / mm", "mm", "residual-by-depth.svg",
        "Residual by depth. A valley at one depth is the focus; a change with depth that the "
        "refined poses do not have is the pose's.",
        plots);
    for (ComparisonPlot& plot : edge_plots(comparison))
        plots.push_back(std::move(plot));
    if (comparison.baseline && !comparison.baseline->pairs.empty())
        plots.push_back(baseline_plot(*comparison.baseline));
    return plots;
}

}  // namespace etalon
