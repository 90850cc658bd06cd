// Do the photographs of a run match their renders, pixel by pixel? From what was measured on each
// (compare/diagnosis/pixel_evidence.h) to quantities, findings in words, and evidence for causes.
//
// Figures from least squares on all pixels have its covariance, widened by the photographs' excess
// scatter and by a render that is off by its tolerance in the worst way. Figures of single
// photographs are averaged. k = 3, as any of the eight that is larger than its U is a finding.
#pragma once

#include "compare/diagnosis/pixel_evidence.h"

namespace etalon {

inline constexpr double pixel_coverage_factor = 3.0;

struct PixelFigure {
    double value = 0.0, expanded_uncertainty = 0.0;
    bool is_shown() const { return std::abs(value) > expanded_uncertainty; }
};

// By the names that the errors have among the causes (compare/diagnosis/error_candidates.h), in
// their units.
struct PixelEvidence {
    std::vector<std::string> errors;
    Eigen::VectorXd observed;
    Eigen::MatrixXd covariance;
};

struct ImageAgreement {
    int photos = 0;  // that were compared
    // Signed: photographs less renders. Nothing where the camera's file does not state it, or too
    // few photographs show it.
    std::optional<PixelFigure> residual_gray;    // RMS residual less the stated noise
    std::optional<PixelFigure> blur_px;          // RMS over the photographs, standard deviation
    std::optional<PixelFigure> tone_gray;        // in the middle between black and white
    std::optional<PixelFigure> shading_percent;  // of white, along the image's width and height
    std::optional<PixelFigure> noise_ratio;      // found over stated, less 1
    std::optional<PixelFigure> edge_px;          // by which dark parts are wider at each edge
    std::optional<PixelFigure> background_gray;  // beside the marker
    std::optional<PixelFigure> black_gray;
    std::vector<std::string> findings;  // one sentence each; empty: the photographs match
    bool is_overexposed = false;        // white is at the end of the scale in more than 1 of 20
    PixelEvidence evidence;
};

// `camera` is the calibration that the renders were made from. Fewer photographs than
// min_compared_photos give no figures.
ImageAgreement match_pixels(const RunEvidence& pixels, const CameraModel& camera);

inline constexpr std::size_t min_compared_photos = 8;

}  // namespace etalon
