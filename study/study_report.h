// What a finished study leaves for people: in its folder
//
//   report.html          tables, the 36 pairs of every detector, plots against every axis
//   summary.csv/.json    the tables' figures with their intervals
//   pairs-NAME.svg       a detector's 36 pairs, for papers
//
// All of it follows from study.json and results.csv alone: resumed, merged and undisturbed studies
// leave the same bytes.
#pragma once

#include <filesystem>
#include <string>

#include "study/study_summary.h"

namespace etalon {

std::string study_html(const StudyResults& results, const StudySummary& summary);

// All of the files. Throws ConfigError when one cannot be written. About 0.3 s for 10 000 poses of
// four detectors.
void write_study_report(const StudyResults& results, const StudySummary& summary,
                        const std::filesystem::path& folder);

}  // namespace etalon
