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
    constexpr std::size_t readable = 14;
    const std::size_t step = (photos.size() + readable - 1) / readable;
    std::vector<std::string> names;
    for (std::size_t i = 0; i < photos.size(); ++i)
        names.push_back(i % step == 0 ? photos[i] : std::string());
    return names;
}

// One figure of each photograph: bars at the pose under test, points at the refined one.
struct ByPhoto {
    std::vector<std::string> names, notes;
    std::vector<double> before, places, after;

    void add(const ComparedPhoto& photo, double value, const std::optional<double>& refined,
             const char* unit) {
        names.push_back(photo.photo.stem().string());
        before.push_back(value);
        if (!refined)
            return;
        places.push_back(static_cast<double>(names.size() - 1));
        after.push_back(*refined);
        notes.push_back(
            fmt::format("{}: {:.3g} {} at the refined pose", names.back(), *refined, unit));
    }
    void draw(SvgPlot& plot) const {
        plot.add_bars(bar_names(names), before, Ink::blue);
        if (!after.empty())
            plot.add_points(places, after, Ink::orange, "at the refined pose", notes);
    }
};

ComparisonPlot residual_by_photo(const Comparison& comparison) {
    ByPhoto residuals;
    for (const ComparedPhoto& photo : comparison.photos)
        if (photo.has_figures())
            residuals.add(
                photo, photo.calibrated->scored.rms_gray,
                photo.refined ? std::optional(photo.refined->scored.rms_gray) : std::nullopt,
                "gray");
    SvgPlot plot("photograph", "residual RMS / gray");
    residuals.draw(plot);
    plot.add_level(comparison.mean_rms_gray(), Ink::blue,
                   fmt::format("mean {:.1f}", comparison.mean_rms_gray()));
    return {"residual-by-photo.svg", plot.svg(),
            "Residual of each photograph, scored half: bars at the pose under test, points at the "
            "photometric pose."};
}

void draw_profile(SvgPlot& plot, const ResidualProfile& profile, Ink ink, const std::string& name,
                  const char* unit) {
    std::vector<double> places, values;
    std::vector<std::string> notes;
    for (std::size_t i = 0; i < profile.pixels.size(); ++i) {
        const auto rms = profile.rms(i);
        if (!rms)
            continue;
        places.push_back(profile.middle(i));
        values.push_back(*rms);
        notes.push_back(fmt::format("{:.0f} {}: {:.2f} gray, {:.0f} pixels", places.back(), unit,
                                    *rms, profile.pixels[i]));
    }
    if (values.empty())
        return;
    plot.add_line(places, values, ink, "");
    plot.add_points(places, values, ink, name, notes);
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
    draw_profile(plot, calibrated, Ink::blue, "pose under test", unit);
    draw_profile(plot, refined, Ink::orange, "refined pose", unit);
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
    plot.add_bars(bar_names(names), differences, Ink::blue);
    return {"baseline-residual.svg", plot.svg(),
            "Residual now minus residual then, photograph by photograph, at the poses under test."};
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
