// The plots of a comparison.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "report/svg_plot.h"
#include "station/compare/comparison_report.h"
#include "station/compare/edge_plots.h"

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
        if (photo.refined)
            refined.add(static_cast<double>(names.size() - 1), photo.refined->scored.rms_gray,
                        fmt::format("{}: {:.3g} gray at the refined pose", names.back(),
                                    photo.refined->scored.rms_gray));
    }
    SvgPlot plot("photograph", "residual RMS / gray");
    plot.add_bars(bar_names(names), under_test, Color::blue);
    if (!refined.empty())
        plot.add_points(refined, Color::orange, "at the refined pose");
    plot.add_level(comparison.mean_rms_gray(), Color::blue,
                   fmt::format("mean {:.1f}", comparison.mean_rms_gray()));
    return {"residual-by-photo.svg", plot.svg(),
            "Residual of each photograph, scored half: bars at the pose under test, points at the "
            "photometric pose. Look for a bar that stands out; a point far below its bar is a pose "
            "that was wrong."};
}

void draw_profile(SvgPlot& plot, const ResidualProfile& profile, Color ink, const std::string& name,
                  const char* unit) {
    Series series;
    for (std::size_t i = 0; i < profile.pixels.size(); ++i)
        if (const auto rms = profile.rms(i))
            series.add(profile.middle(i), *rms,
                       fmt::format("{:.0f} {}: {:.2f} gray, {:.0f} pixels", profile.middle(i), unit,
                                   *rms, profile.pixels[i]));
    if (!series.empty())
        plot.add_curve(series, ink, name);
}

double largest_rms(const ResidualProfile& profile) {
    double largest = 0.0;
    for (std::size_t i = 0; i < profile.pixels.size(); ++i)
        largest = std::max(largest, profile.rms(i).value_or(0.0));
    return largest;
}

void add_profile(const ResidualProfile& calibrated, const ResidualProfile& refined,
                 const char* label, const char* unit, const std::string& file,
                 const std::string& caption, std::vector<ComparisonPlot>& plots) {
    const double highest = std::max(largest_rms(calibrated), largest_rms(refined));
    if (!(highest > 0.0))
        return;
    SvgPlot plot(label, "residual RMS / gray");
    draw_profile(plot, calibrated, Color::blue, "pose under test", unit);
    draw_profile(plot, refined, Color::orange, "refined pose", unit);
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

}  // namespace

std::vector<ComparisonPlot> comparison_plots(const Comparison& comparison) {
    std::vector<ComparisonPlot> plots{residual_by_photo(comparison)};
    const ResidualProfiles& profiles = comparison.profiles;
    add_profile(profiles.radius, profiles.refined_radius, "distance from the image's centre / px",
                "px", "residual-by-radius.svg",
                "Residual by distance from the image's centre, all photographs together. A rise "
                "outwards points at the distortion or at the lens, not at the sensor.",
                plots);
    add_profile(
        profiles.depth, profiles.refined_depth, "depth / mm", "mm", "residual-by-depth.svg",
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
