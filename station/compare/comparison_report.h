// The files of a comparison: comparison.json, comparison.csv, photometry.csv, edges.csv,
// profiles.csv, defocus.csv, baseline.csv, the plots as SVG, and report.html. The pictures beside
// them are written photo by photo (station/compare/comparison_pictures.h).
#pragma once

#include <string>
#include <vector>

#include "station/compare/comparison.h"

namespace etalon {

std::string comparison_json(const Comparison& comparison);
std::string comparison_csv(const Comparison& comparison);  // one row a photograph
std::string photometry_csv(const Comparison& comparison);  // one row a parameter
std::string edges_csv(const Comparison& comparison);       // one row an edge and pose
std::string profiles_csv(const Comparison& comparison);    // residuals by radius and depth
std::string defocus_csv(const Comparison& comparison);     // one row a photograph and depth

// A plot for the report and for a file of its own.
struct ComparisonPlot {
    std::string file;  // "residual-by-photo.svg"
    std::string svg;   // for a page; stand_alone_svg() makes a file of it
    std::string caption;
};
// Those for which this comparison has figures.
std::vector<ComparisonPlot> comparison_plots(const Comparison& comparison);

std::string comparison_html(const Comparison& comparison, const std::vector<ComparisonPlot>& plots);

}  // namespace etalon
