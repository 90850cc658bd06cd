// Two comparisons of one camera against each other, photograph by photograph: did the residual, the
// blur, the edges or the poses change between them, and by more than chance? For a camera before
// and after a repair, one calibration after another, or a year later.
//
// Photographs are paired by their file's name. Of every quantity the differences, present minus
// earlier, give a Student t interval of their mean (paired t test). The intervals of all quantities
// hold together at 95 % (Bonferroni). They take the photographs as independent of each other.
#pragma once

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "report/result_table.h"

namespace etalon {

// What of one photograph is set against another comparison of it. Nothing where there is no figure.
struct PhotoSummary {
    std::string name;     // of the file, without folder
    std::string outcome;  // "matched", "not matched", "refused"
    std::optional<double> residual_gray, refined_residual_gray;    // scored half, RMS
    std::optional<double> edge_shift_px, refined_edge_shift_px;    // RMS
    std::optional<double> psf_sigma_px;                            // fitted to the photograph
    std::optional<Rigid> camera_from_marker, refined_from_marker;  // as given, photometric
};

struct ComparisonSummary {
    std::string serial;  // of the camera; empty: not known
    int width = 0, height = 0;
    std::string marker;
    std::vector<PhotoSummary> photos;
};

// DIR/comparison.json of an earlier run. Throws ConfigError with file, line and key.
ComparisonSummary read_comparison(const std::filesystem::path& folder);

// Throws ConfigError (at --baseline) for another known serial number, image size or marker.
void require_same_camera(const ComparisonSummary& earlier, const ComparisonSummary& now);

// One quantity over all pairs that have it: present minus earlier.
struct PairedChange {
    std::string quantity, unit;
    int pairs = 0;
    double earlier = 0.0, now = 0.0, mean = 0.0;  // means over the pairs; mean of the differences
    std::optional<double> half_width;             // of the interval; needs two pairs
    bool changed() const {
        constexpr double rounding = 1e-9;  // of poses that were written and read
        return half_width && std::abs(mean) > std::max(*half_width, rounding);
    }
};

struct PhotoPair {
    PhotoSummary earlier, now;
};

struct BaselineChange {
    std::filesystem::path folder;
    bool serials_known = false;    // of both
    std::vector<PhotoPair> pairs;  // in the present order
    std::vector<std::string> only_earlier, only_now;
    std::vector<std::string> ambiguous;    // names that one of the two has twice
    std::vector<PairedChange> quantities;  // those that at least one pair has
};

inline constexpr double baseline_confidence = 0.95;  // of all intervals together

BaselineChange compare_with_baseline(const ComparisonSummary& earlier, const ComparisonSummary& now,
                                     const std::filesystem::path& folder);

// Of a pose: mm along the camera's axes and mrad about the marker's.
Vector6d pose_change(const Rigid& earlier, const Rigid& now);

// One row a quantity.
ResultTable change_table(const BaselineChange& change);

// For a terminal; baseline.csv, one row a pair.
std::string baseline_text(const BaselineChange& change);
std::string baseline_csv(const BaselineChange& change);

}  // namespace etalon
