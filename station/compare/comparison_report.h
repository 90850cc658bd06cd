// The files of a comparison: comparison.json, comparison.csv, photometry.csv, edges.csv,
// profiles.csv, defocus.csv, baseline.csv, the plots as SVG, and report.html. The pictures beside
// them are written photo by photo (station/compare/comparison_pictures.h).
#pragma once

#include <opencv2/core.hpp>
#include <span>
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

// How many times larger than measured shifts are drawn, for all photographs the same: 1, 2 or 5
// times a power of ten that makes their RMS about 12 px.
double arrow_magnification(const Comparison& comparison);

// Edges as thin lines and their shifts as arrows, from the rendering's edge to the photograph's:
// those over three standard deviations in colour. `part` is the part of the image that is shown.
std::string edge_map_svg(std::span<const EdgeShift> edges, const cv::Rect& part,
                         double magnification);

std::string comparison_html(const Comparison& comparison, const std::vector<ComparisonPlot>& plots);

}  // namespace etalon
