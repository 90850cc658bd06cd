// What a finished study leaves for people: report.html, summary.csv and .json, pairs-NAME.svg
// (docs/study.md). All of it follows from study.json and results.csv alone.
#pragma once

#include "report/svg_plot.h"
#include "study/study_summary.h"

namespace etalon {

std::string study_html(const StudyResults& results, const StudySummary& summary);

// All files. Throws ConfigError. About 0.3 s for 10 000 poses of four detectors.
void write_study_report(const StudyResults& results, const StudySummary& summary,
                        const std::filesystem::path& folder);

struct BinnedDetector {
    std::string name;
    std::vector<AxisBin> bins;  // of binned_statistics()
};

// Detection rate in percent with its 95 % interval, by bins. `axis` is a label with its unit.
SvgPlot detection_rate_plot(const std::string& axis, std::span<const BinnedDetector> detectors);

// Median |error| of one measure (its place in error_measures) with its 95 % interval, by bins;
// logarithmic where the detectors differ by more than a factor of ten.
SvgPlot median_error_plot(const std::string& axis, std::size_t measure,
                          std::span<const BinnedDetector> detectors);

}  // namespace etalon
