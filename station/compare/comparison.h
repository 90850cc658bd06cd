// What `etalon compare` found, as plain data: from it the report, the JSON and the CSV files are
// written (station/compare/comparison_report.h). Images are not kept; their pictures are.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "compare/edges/edge_summary.h"
#include "compare/match/photo_findings.h"
#include "compare/photo_pose.h"
#include "compare/photometric/photo_match.h"
#include "station/compare/compare_baseline.h"

namespace etalon {

// A photograph and its rendering at one pose.
struct ComparedFit {
    Rigid camera_from_marker;
    PhotometricModel model;
    ResidualStatistics fitted, scored;
    NoiseSource noise_source = NoiseSource::residuals;
    double noise_gray = 0.0;
    std::vector<MatchParameter> parameters;
    std::vector<EdgeShift> edges;  // of both halves
    EdgeSummary edge_summary;      // of the scored half
};

// The pictures of one photograph: whole images as files of the report's folder, the part around the
// marker as <img> elements.
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
    void drop_figures();
    const char* outcome() const;  // "matched", "not matched", "refused"
    std::string reason() const;   // why it was refused, or what was found; empty when matched
};

// Squared residuals along a coordinate, in equal steps from low to high.
struct ResidualProfile {
    double low = 0.0, high = 1.0;
    std::vector<double> squares, pixels;

    ResidualProfile() = default;
    ResidualProfile(double low_end, double high_end, int steps);
    void add(double place, double residual);
    void add(const ResidualProfile& other);  // of the same steps
    double middle(std::size_t step) const;
    // Nothing where too few pixels lie for a figure.
    std::optional<double> rms(std::size_t step) const;
};

// Scored pixels of all photographs, by distance from the image's centre and by depth.
struct ResidualProfiles {
    ResidualProfile radius, refined_radius, depth, refined_depth;

    void add(const ResidualProfiles& other);
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
    ResidualProfiles profiles;
    std::optional<BaselineChange> baseline;
    // Whether edges at the refined poses are displaced with the marker.
    std::optional<BoardShifts> board;

    bool has_poses() const;        // of any photograph
    std::size_t compared() const;  // photographs with figures
    std::size_t matched() const;   // of them those without findings
    // Of the scored half, at the poses under test and at the photometric ones.
    double mean_rms_gray() const, refined_mean_rms_gray() const;
    double mean_psf_sigma_px() const;  // fitted, at the poses under test
    // Of all compared photographs that have this fit: of the scored half, or of both.
    std::vector<EdgeShift> edges(std::optional<ComparedFit> ComparedPhoto::*fit,
                                 bool only_scored) const;
    // Of the scored half, at the poses under test and at the refined ones; nothing without edges.
    std::optional<std::pair<EdgeSummary, EdgeSummary>> edge_summaries() const;
};

// What this comparison could not have seen, for its user: sentences.
std::vector<std::string> blind_spots(const Comparison& comparison);

// That the marker is not as drawn, where the edges show it; empty otherwise.
std::string board_in_words(const Comparison& comparison);

// Where the poses under test came from, and which part of the marker was scored, in words.
std::string source_of_poses(const Comparison& comparison);
std::string scored_region(const Comparison& comparison);

ComparisonSummary summary_of(const Comparison& comparison);

}  // namespace etalon
