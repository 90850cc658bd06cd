// What `etalon compare` found, as plain data, and the files that are written from it:
// comparison.json, comparison.csv, photometry.csv, edges.csv, profiles.csv, defocus.csv,
// baseline.csv, pictures, plots as SVG, and report.html. Images are not kept; their pictures are.
#pragma once

#include "compare/edges/edge_summary.h"
#include "compare/match/photo_findings.h"
#include "compare/photo_pose.h"
#include "core/file/file_writing.h"
#include "station/compare/compare_baseline.h"

namespace etalon {

// A photograph and its rendering at one pose, without the images.
struct ComparedFit : PhotoFit {
    std::vector<EdgeShift> edges;  // of both halves
    EdgeSummary edge_summary;      // of the scored half

    const Rigid& camera_from_marker() const { return state.camera_from_marker; }
    double psf_sigma_px() const { return state.photometry.psf_sigma_px; }
    // Nothing without edges.
    const EdgeSummary* edges_if_any() const {
        return edge_summary.edges > 0 ? &edge_summary : nullptr;
    }
};

// Whole images as files of the report's folder, the part around the marker as <img> elements.
struct PhotoPictures {
    std::string overlay_file, residual_file, significance_file, rendering_file, edges_file;
    std::string thumbnail, photo, rendering, refined_rendering;
    std::string overlay, residual, refined_residual, significance;
    cv::Rect part;  // of the image that the elements show
};

// One photograph. Where there is no `calibrated`, `findings` or `failure` say why.
struct ComparedPhoto {
    std::filesystem::path photo;
    bool is_jpeg = false;
    std::string failure;                   // why no figures are possible; empty otherwise
    std::optional<PoseEstimate> estimate;  // nothing when the pose was given
    Rigid under_test;                      // camera_from_marker; without a failure
    // At the pose under test, and at the one fitted to the pixels; all three or none.
    std::optional<ComparedFit> calibrated, refined;
    std::optional<PhotometricPose> photometric;  // of `refined`
    // At the refined pose; of a camera with a lens section.
    std::optional<DefocusProfile> defocus;
    Findings findings;
    PhotoPictures pictures;

    bool has_figures() const { return calibrated && failure.empty() && !is_refused(findings); }
    bool is_matched() const { return has_figures() && findings.empty(); }
    const char* outcome() const;  // "matched", "not matched", "refused"
    std::string reason() const;   // why it was refused, or what was found; empty when matched
    std::string name() const { return photo.filename().string(); }
    std::vector<std::string> names_of_findings() const;
};

// Scored pixels of all photographs along a coordinate, in equal steps from low to high.
struct ResidualProfile {
    const char* against;  // "radius_px": distance from the image's centre; "depth_mm"
    const char* pose;     // "calibrated", "refined"
    double low, high;
    struct Step {
        double squares = 0.0, pixels = 0.0;
    };
    std::array<Step, 12> steps = {};

    void add(double place, double residual);
    struct Point {
        double middle, rms_gray, pixels;
    };
    std::vector<Point> points() const;  // of the steps with enough pixels for a figure
};

struct Comparison {
    std::filesystem::path camera_file;
    CameraModel camera;
    Marker marker;
    std::string detector;  // empty: poses were given
    std::string poses;     // the pose file, if there was one
    ScoreMargin margin;    // of a chessboard
    std::string render_plan;
    std::vector<ComparedPhoto> photos;
    std::vector<ResidualProfile> profiles;  // radius, then depth; each calibrated, then refined
    std::optional<BaselineChange> baseline;
    // Whether edges at the refined poses are displaced with the marker.
    std::optional<BoardShifts> board;

    std::size_t compared() const;  // photographs with figures
    std::size_t matched() const;   // of them those without findings
    // Means over the compared photographs, scored half, at the poses under test and photometric.
    double mean_rms_gray() const, refined_mean_rms_gray() const;
    double mean_psf_sigma_px() const;  // fitted, at the poses under test
    // Of all compared photographs: of the scored half, or of both.
    std::vector<EdgeShift> edges(std::optional<ComparedFit> ComparedPhoto::*fit,
                                 bool only_scored) const;
    // Of the scored half, at the poses under test and at the refined ones; nothing without edges.
    std::optional<std::pair<EdgeSummary, EdgeSummary>> edge_summaries() const;

    // What it could not have seen, for its user: sentences.
    std::vector<std::string> blind_spots() const;
    // That the marker is not as drawn, where the edges show it; empty otherwise.
    std::string board_in_words() const;
    std::string source_of_poses() const;  // of those under test, in words
    ComparisonSummary summary() const;
};

// ---- files

inline constexpr double overlay_gain = 2.0;              // of the red/cyan overlays
inline constexpr double residual_map_scale_gray = 30.0;  // full colour of the residual maps
inline constexpr double significance_map_scale = 6.0;    // standard deviations, full colour

// Writes picture files of photograph `number` (from 1) to `folder`; makes the report's elements.
PhotoPictures make_pictures(ReportFolder& folder, std::size_t number,
                            const std::filesystem::path& photo, const PhotoFit& calibrated,
                            const PhotoFit& refined);
// Of a photograph that was not compared: the whole of it, for the report only.
PhotoPictures pictures_of_photo(const CodeImage& image, const std::filesystem::path& photo);

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

// Of drawn shifts, for all photographs: 1, 2 or 5 times 10^n that makes their RMS about 12 px.
double arrow_magnification(const Comparison& comparison);

// Edges of the refined pose as thin lines and their shifts as arrows, from the rendering's edge to
// the photograph's: those over three standard deviations in colour.
std::string edge_map_svg(const ComparedPhoto& photo, double magnification);

std::string comparison_html(const Comparison& comparison, const std::vector<ComparisonPlot>& plots);

}  // namespace etalon
