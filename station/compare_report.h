// What `etalon compare` found, and the files it writes: comparison.csv, comparison.json and
// report.html. The pictures beside them are written photo by photo, by the command.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "compare/pixel_difference.h"
#include "station/photo_pose.h"

namespace etalon {

inline constexpr double overlay_gain = 2.0;              // of the red/cyan overlays
inline constexpr double residual_map_scale_gray = 30.0;  // full colour of the residual maps
inline constexpr int radius_bins = 12;                   // image centre to image corner

// Sums of squared residuals by distance from the image's centre, equal steps to the corner.
struct RadialResidual {
    std::vector<double> squares = std::vector<double>(radius_bins, 0.0);
    std::vector<double> pixels = std::vector<double>(radius_bins, 0.0);
};

// One photograph. Without a failure everything below it is there.
struct ComparedPhoto {
    std::filesystem::path photo;
    std::string failure;  // why it was not compared; empty when it was
    Rigid camera_from_marker;
    std::optional<PoseEstimate> estimate;  // nothing when the pose was given
    PhotometricModel model;
    ResidualStatistics fitted, scored;
    std::string overlay_file, residual_file;    // within the report's folder
    std::string overlay_image, residual_image;  // <img> elements of the part around the marker
};

struct Comparison {
    std::filesystem::path camera_file;
    CameraModel camera;
    std::string marker;    // its full name
    std::string detector;  // empty: poses were given
    std::string poses;     // the pose file, if there was one
    bool is_chessboard = false;
    ScoreMargin margin;  // of a chessboard
    std::string render_plan;
    std::vector<ComparedPhoto> photos;
    RadialResidual radial;

    std::size_t compared() const;  // photographs without a failure
    double mean_rms_gray() const;  // mean over them of the scored half's RMS
};

void write_comparison_csv(const std::filesystem::path& path, const Comparison& comparison);
std::string comparison_json(const Comparison& comparison);
std::string comparison_html(const Comparison& comparison);

}  // namespace etalon
