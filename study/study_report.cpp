#include "study/study_report.h"

#include <fmt/format.h>

#include "core/file/text.h"
#include "core/program/version.h"
#include "report/number_text.h"
#include "study/pair_matrix.h"

namespace etalon {
namespace {

constexpr std::size_t z = 2, angle = 7;  // places in error_measures

// The most frequent ones by name, the rest in one line.
void add_failures(HtmlPage& page, const StudyResults& results) {
    constexpr std::size_t max_reasons = 4;
    TableRows rows;
    for (std::size_t i = 0; i < results.failures.size(); ++i) {
        std::vector<std::pair<std::string, std::size_t>> reasons(results.failures[i].begin(),
                                                                 results.failures[i].end());
        std::ranges::stable_sort(
            reasons, [](const auto& one, const auto& two) { return one.second > two.second; });
        std::size_t others = 0;
        for (std::size_t k = max_reasons; k < reasons.size(); ++k)
            others += reasons[k].second;
        reasons.resize(std::min(reasons.size(), max_reasons));
        if (others > 0)
            reasons.emplace_back("others, see results.csv", others);
        for (const auto& [reason, poses] : reasons)
            rows.push_back(
                {&reason == &reasons.front().first ? results.description.detectors[i].name : "",
                 fmt::format("{}", poses), reason});
    }
    if (rows.empty())
        return;
    page.add_paragraph("Poses that were not detected:");
    page.add_table({"detector", "poses", "why"}, rows);
}

void add_detection(HtmlPage& page, const StudyResults& results, const StudySummary& summary) {
    page.add_heading("Detection");
    page.add_table(detection_table(results.description, summary.detectors[0]));
    page.add_paragraph(
        "In brackets the 95 % interval. A flip is the wrong one of a planar marker's two poses. "
        "The corner error is the median over the poses of the RMS distance of the corners from the "
        "projected truth; what reports a pose without corners has none.");
    add_failures(page, results);
}

void add_sizes(HtmlPage& page, const StudyResults& results, const StudySummary& summary) {
    page.add_heading("Corner errors by the marker's size in the image");
    page.add_paragraph(
        "The size is the root of the area that the marker's points span: a tag's corners, a "
        "board's inner corners, a TopoTag's vertices, which span less than its square. Errors are "
        "those of the poses that the detector detects itself: where it detects few, they are the "
        "easier ones.");
    page.add_table(size_table(results.description, summary.detectors[0]));
    page.add_paragraph(fmt::format(
        "No 95 % quantile is given of fewer than {} poses. \"From 60\" and \"all\" hold the poses "
        "of the classes above them once more.",
        min_quantile_values));
}

void add_accuracy(HtmlPage& page, const StudyResults& results, const StudySummary& summary) {
    page.add_heading("Accuracy");
    page.add_paragraph(fmt::format(
        "On the {} poses that every detector detects, so that no detector is favoured for leaving "
        "the difficult ones out. Errors are estimated minus true pose.",
        summary.common[0]));
    const std::vector<DetectorSummary>& detectors = summary.detectors[0];
    page.add_table(short_error_table(results.description, detectors));
    page.begin_details("With 95 % intervals");
    page.add_table(error_table(results.description, detectors, &DetectorSummary::common));
    page.end_details();
    page.begin_details("Each detector on all poses that it detects itself");
    page.add_table(error_table(results.description, detectors, &DetectorSummary::own));
    page.end_details();
}

void add_variants(HtmlPage& page, const StudyResults& results, const StudySummary& summary) {
    const StudyDescription& description = results.description;
    if (description.variants.size() < 2)
        return;
    page.add_heading("Where the errors come from");
    page.add_paragraph(
        "The same study with one thing switched: an error that changes with it is made of it. Each "
        "line is over the poses that all detectors detect in that variant.");
    page.add_table(variant_table(description, summary));
}

void add_pairs(HtmlPage& page, const std::vector<PairMatrix>& matrices) {
    page.add_heading("Errors against the degrees of freedom");
    page.add_paragraph(
        "Each of the six errors against each of the six components of the true pose: how many "
        "poses lie where, their mean and the mean ± one standard deviation. A detector's panels "
        "show all poses that it detects itself, those that it misses are in none.");
    add_pair_matrices(page, matrices);
}

// The detected poses of a mask; bins of an axis do not depend on which are detected.
DetectorErrors only(const DetectorErrors& errors, const std::vector<bool>& mask) {
    DetectorErrors kept = errors;
    for (std::size_t i = 0; i < kept.size(); ++i)
        if (!mask[i])
            kept[i].reset();
    return kept;
}

// One value of the axis per pose and detector.
using AxisValues = std::vector<const std::vector<double>*>;

HtmlPage::Figures error_figures(const std::string& label,
                                const std::vector<BinnedDetector>& binned) {
    return {
        {median_error_plot(label, z, binned).svg(),
         "Median |Z error|, with 95 % intervals. Look where lines cross: the better detector "
         "changes there."},
        {median_error_plot(label, angle, binned).svg(),
         "Median angle between the poses, with 95 % intervals. Lines whose bands overlap are not "
         "told apart."}};
}

void add_axis(HtmlPage& page, const StudyResults& results, const std::string& label,
              const AxisValues& values, const std::vector<bool>& common) {
    std::vector<BinnedDetector> own, shared;
    for (std::size_t i = 0; i < results.description.detectors.size(); ++i) {
        const std::string& name = results.description.detectors[i].name;
        const DetectorErrors& errors = results.errors[0][i];
        own.push_back({name, binned_statistics(errors, *values[i])});
        shared.push_back({name, binned_statistics(only(errors, common), *values[i])});
    }
    HtmlPage::Figures figures = error_figures(label, own);
    figures.insert(figures.begin(), {detection_rate_plot(label, own).svg(),
                                     "Detected, with 95 % intervals. Look where a line leaves 100 "
                                     "%: the detector's reach ends."});
    page.add_figures(figures);
    page.begin_details(fmt::format("The errors on the {} poses that every detector detects",
                                   std::ranges::count(common, true)));
    page.add_figures(error_figures(label, shared));
    page.end_details();
}

void add_axes(HtmlPage& page, const StudyResults& results) {
    const StudyDescription& description = results.description;
    const std::vector<bool> common = commonly_detected(results.errors[0]);
    page.add_heading("Against the marker's size in the image");
    page.add_paragraph(
        "Errors here and below are those of the poses that each detector detects itself; folded "
        "away beneath are those of the poses that all detect.");
    AxisValues values;
    for (const std::vector<double>& sizes : results.sizes_px)
        values.push_back(&sizes);
    add_axis(page, results, "root of the marker's area in the image / px", values, common);
    for (std::size_t k = 0; k < description.axes.size(); ++k) {
        const StudyAxis& axis = description.axes[k];
        page.add_heading("Against " + axis.name);
        add_axis(page, results, axis.unit.empty() ? axis.name : axis.name + " / " + axis.unit,
                 AxisValues(description.detectors.size(), &results.axes[k]), common);
    }
}

std::vector<PairMatrix> matrices_of(const StudyResults& results) {
    std::vector<PairMatrix> matrices;
    for (std::size_t i = 0; i < results.description.detectors.size(); ++i)
        matrices.push_back(pair_matrix(results.description.detectors[i].name, results.truth,
                                       results.errors[0][i]));
    return matrices;
}

std::string best_sentence(const StudyResults& results,
                          const std::vector<DetectorSummary>& detectors) {
    double most = 0.0, least_mm = std::numeric_limits<double>::infinity();
    std::string who_most, who_least;
    for (std::size_t i = 0; i < detectors.size(); ++i) {
        const std::string& name = results.description.detectors[i].name;
        const double share = detectors[i].own.detected ? detectors[i].own.detected->value : 0.0;
        if (share >= most)
            who_most = share > most || who_most.empty() ? name : who_most + ", " + name;
        most = std::max(most, share);
        const auto& common = detectors[i].common.all;
        if (common && (*common)[z].median_absolute.value < least_mm) {
            least_mm = (*common)[z].median_absolute.value;
            who_least = name;
        }
    }
    std::string text =
        fmt::format("Most poses are detected by {}: {:.1f} %.", who_most, 100.0 * most);
    if (!who_least.empty())
        text += fmt::format(" Where all detect, {} is least off in depth: median |Z error| {} mm.",
                            who_least, figure_text(least_mm));
    return text;
}

std::string html_of(const StudyResults& results, const StudySummary& summary,
                    const std::vector<PairMatrix>& matrices) {
    const StudyDescription& description = results.description;
    HtmlPage page("Study " + description.id, "detectors compared on rendered images");
    page.add_verdict(counted(description.detectors.size(), "detector"),
                     best_sentence(results, summary.detectors[0]));
    page.add_facts({{"poses", fmt::format("{}", description.poses)},
                    {"detectors", fmt::format("{}", description.detectors.size())},
                    {"poses that all detect", fmt::format("{}", summary.common[0])},
                    {"etalon", version}});
    page.add_paragraph("Camera: " + description.camera + ".");
    page.add_paragraph("Poses: " + description.volume + ".");
    if (results.refused > 0)
        page.add_paragraph(fmt::format(
            "{} poses could not be rendered (results.csv says why); they count as not detected.",
            results.refused));
    add_detection(page, results, summary);
    add_accuracy(page, results, summary);
    add_sizes(page, results, summary);
    add_variants(page, results, summary);
    add_pairs(page, matrices);
    add_axes(page, results);
    return page.finish();
}

std::string file_word(const std::string& name) {
    std::string word = name;
    for (char& c : word)
        if (!std::isalnum(static_cast<unsigned char>(c)) && c != '-' && c != '.')
            c = '_';
    return word;
}

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

std::string study_html(const StudyResults& results, const StudySummary& summary) {
    return html_of(results, summary, matrices_of(results));
}

void write_study_report(const StudyResults& results, const StudySummary& summary,
                        const std::filesystem::path& folder) {
    const std::vector<PairMatrix> matrices = matrices_of(results);
    for (const PairMatrix& matrix : matrices)
        write_text(folder / ("pairs-" + file_word(matrix.detector) + ".svg"),
                   pair_matrix_svg(matrix));
    write_text(folder / "summary.csv", summary_csv(results.description, summary));
    write_text(folder / "summary.json", summary_json(results, summary));
    write_text(folder / "report.html", html_of(results, summary, matrices));
}

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
