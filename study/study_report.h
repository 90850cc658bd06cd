// What a finished study leaves for people: in its folder
//
//   report.html          tables, the 36 pairs of every detector, plots against every axis
//   summary.csv/.json    the tables' figures with their intervals
//   pairs-NAME.svg       a detector's 36 pairs, for papers
//
// All of it follows from study.json and results.csv alone: resumed, merged and undisturbed studies
// leave the same bytes.
#pragma once

#include "report/svg_plot.h"
#include "study/study_summary.h"

namespace etalon {

std::string study_html(const StudyResults& results, const StudySummary& summary);

// All of the files. Throws ConfigError when one cannot be written. About 0.3 s for 10 000 poses of
// four detectors.
void write_study_report(const StudyResults& results, const StudySummary& summary,
                        const std::filesystem::path& folder);

// Plots of several detectors of one study against one axis: a disturbance, a degree of freedom or
// the marker's size in the image.

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
