// Pages, tables and JSON of what a camera and a marker are expected to give.
#pragma once

#include "compare/expect/expectation.h"
#include "report/html.h"

namespace etalon {

// A row per component: mean and scatter of the bias, where its map is worst, the noise.
std::vector<std::vector<std::string>> summary_rows(const Expectation& expectation);

// The table, and the maps over distance, image position and tilt as plots.
void add_expectation(HtmlPage& page, const Expectation& expectation);

// The short version: the table and the bias along the line of sight. Nothing without maps.
void add_short_expectation(HtmlPage& page, const Expectation& expectation);

std::string expectation_json(const ExpectationRequest& request, const Expectation& expectation);

// A row per pose: where it is, bias and noise by component. Lengths in mm, angles in mrad.
std::string expectation_csv(const Expectation& expectation);

// report.html, expectation.json and poses.csv in a folder that is made. Throws ConfigError.
void write_expectation(const ExpectationRequest& request, const Expectation& expectation,
                       const std::filesystem::path& folder);

}  // namespace etalon
