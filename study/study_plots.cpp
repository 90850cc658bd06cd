#include "study/study_plots.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>

namespace etalon {
namespace {

constexpr std::array inks{Color::blue,   Color::orange, Color::green, Color::red,
                          Color::purple, Color::sky,    Color::gray};

// Small: on a phone a page shows them at three quarters of this, and letters must stay readable.
constexpr int plot_width = 440, plot_height = 300;

// The line of one detector, with the interval where there is one.
void add(Series& curve, double place, double value,
         const std::optional<ConfidenceInterval>& interval, const std::string& note) {
    constexpr double none = std::numeric_limits<double>::quiet_NaN();  // SvgPlot leaves it out
    curve.add(place, value, interval ? interval->low : none, interval ? interval->high : none,
              note);
}

void draw(SvgPlot& plot, const std::vector<Series>& curves,
          std::span<const BinnedDetector> detectors) {
    for (std::size_t i = 0; i < curves.size(); ++i)
        plot.add_band(curves[i], inks[i % inks.size()], "");
    for (std::size_t i = 0; i < curves.size(); ++i)
        plot.add_curve(curves[i], inks[i % inks.size()], detectors[i].name);
}

Series rate_curve(const BinnedDetector& detector) {
    Series curve;
    for (const AxisBin& bin : detector.bins)
        if (const auto& share = bin.detected)
            add(curve, bin.place, 100.0 * share->value,
                ConfidenceInterval{100.0 * share->low, 100.0 * share->high},
                fmt::format("{} at {:.4g}: {} of {} detected, {:.1f} % ({:.1f} to {:.1f})",
                            detector.name, bin.place, share->count, share->trials,
                            100.0 * share->value, 100.0 * share->low, 100.0 * share->high));
    return curve;
}

Series median_curve(const BinnedDetector& detector, std::size_t measure) {
    const MeasureName& name = error_measures.at(measure);
    Series curve;
    for (const AxisBin& bin : detector.bins) {
        if (!bin.errors)
            continue;
        const Estimate& median = (*bin.errors)[measure].median_absolute;
        std::string note = fmt::format("{} at {:.4g}: median |{} error| {:.3g} {}", detector.name,
                                       bin.place, name.name, median.value, name.unit);
        if (median.interval)
            note += fmt::format(" ({:.3g} to {:.3g})", median.interval->low, median.interval->high);
        add(curve, bin.place, median.value, median.interval,
            note + fmt::format(", {} poses", bin.detected->count));
    }
    return curve;
}

bool spans_a_decade(const std::vector<Series>& curves) {
    double low = std::numeric_limits<double>::infinity(), high = 0.0;
    for (const Series& curve : curves)
        for (const double value : curve.ys) {
            if (value > 0.0)
                low = std::min(low, value);
            high = std::max(high, value);
        }
    return high > 10.0 * low;
}

}  // namespace

SvgPlot detection_rate_plot(const std::string& axis, std::span<const BinnedDetector> detectors) {
    SvgPlot plot(axis, "detected / %", plot_width, plot_height);
    plot.set_y_range(0.0, 103.0);
    std::vector<Series> curves;
    for (const BinnedDetector& detector : detectors)
        curves.push_back(rate_curve(detector));
    draw(plot, curves, detectors);
    return plot;
}

SvgPlot median_error_plot(const std::string& axis, std::size_t measure,
                          std::span<const BinnedDetector> detectors) {
    const MeasureName& name = error_measures.at(measure);
    SvgPlot plot(axis, fmt::format("median |{} error| / {}", name.name, name.unit), plot_width,
                 plot_height);
    std::vector<Series> curves;
    for (const BinnedDetector& detector : detectors)
        curves.push_back(median_curve(detector, measure));
    if (spans_a_decade(curves))
        plot.set_log_y_axis();
    draw(plot, curves, detectors);
    return plot;
}

}  // namespace etalon
