// What a study's results say: statistics of every detector in every variant, over its own poses and
// over those that all detectors of the variant detect; and the same as tables, CSV and JSON.
#pragma once

#include "report/result_table.h"
#include "study/study_results.h"

namespace etalon {

// Poses with from_px <= size < to_px: the root of the area of the marker's points in the image.
struct SizeClass {
    double from_px = 0.0;
    std::optional<double> to_px;  // nothing: no upper end
    std::size_t poses = 0;
    std::optional<Proportion> detected;  // nothing without poses
    // Of the RMS corner errors of the detected poses. Nothing where no pose has corners; the
    // quantile (the smallest error that 95 % of them do not exceed) not of too few.
    std::optional<Estimate> median_corner_px;
    std::optional<double> corner_quantile_px;
};

// The quantile needs this many values: below, it is the largest of them.
inline constexpr std::size_t min_quantile_values = 20;

// Below 25 px, 25 to 40, 40 to 60, 60 to 100, from 100; then, over some of these, from 60 and all.
// An entry per pose in each argument (NumericalError otherwise). 0.2 us a pose.
std::vector<SizeClass> size_classes(const DetectorErrors& errors, std::span<const double> sizes_px,
                                    std::span<const std::optional<double>> corner_rms_px);

// "below 25", "25 to 40", "from 60", "all"
std::string size_words(const SizeClass& one);

struct DetectorSummary {
    PoseStatistics own, common;
    std::vector<SizeClass> sizes;  // over its own poses

    // Over all sizes.
    const std::optional<Estimate>& median_corner_px() const {
        return sizes.back().median_corner_px;
    }
};

struct StudySummary {
    std::vector<std::size_t> common;  // by variant: poses that every detector detects
    std::vector<std::vector<DetectorSummary>> detectors;  // by variant, by detector
};

// 25 ms and 1 us a line of the results.
StudySummary summarise(const StudyResults& results);

// Of the study as it is, for the page and for a terminal. The short errors, of the common poses,
// have a column for each component, as the published comparison has.
ResultTable detection_table(const StudyDescription& description,
                            const std::vector<DetectorSummary>& detectors);
ResultTable size_table(const StudyDescription& description,
                       const std::vector<DetectorSummary>& detectors);
ResultTable error_table(const StudyDescription& description,
                        const std::vector<DetectorSummary>& detectors,
                        PoseStatistics DetectorSummary::*set);
ResultTable short_error_table(const StudyDescription& description,
                              const std::vector<DetectorSummary>& detectors);
ResultTable variant_table(const StudyDescription& description, const StudySummary& summary);

// Of those what fits a terminal.
std::string summary_text(const StudyResults& results, const StudySummary& summary);

// docs/study.md, "What it leaves".
std::string summary_csv(const StudyDescription& description, const StudySummary& summary);

std::string summary_json(const StudyResults& results, const StudySummary& summary);

// "-0.0213", "12.90": four figures; for cells of tables.
std::string figure_text(double value);

}  // namespace etalon
