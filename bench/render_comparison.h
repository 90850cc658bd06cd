// A render against the reference integrator, on windows that hold what is hard: a marker's corners
// and edges, its inside, and the background beside and far from it (diffraction tails). Used by
// tests and by `etalon bench`.
//
// Errors are in gray, 1/255 of linear full scale. The edge shift is the displacement that would
// change the same light. A profile across an edge is a row or a column of pixels, the one nearer to
// the edge's normal. The sum of its signed errors over the edge's contrast is the shift along the
// profile; times the cosine between profile and normal, it is that of the edge, px.
#pragma once

#include "bench/benchmark_scenes.h"
#include "sim/render/reference_integrator.h"

namespace etalon {

// A window of the image; across an edge it is as long as the blur needs and holds profiles.
struct ComparisonWindow {
    cv::Rect pixels;
    enum class Profiles { none, rows, columns } profiles = Profiles::none;
    double shift_px_per_gray = 0.0;  // edge displacement for a profile's sum of errors
};

// What the pixels of some windows should be.
struct RenderTruth {
    std::vector<ComparisonWindow> windows;
    std::vector<cv::Point> pixels;  // window by window, row by row
    std::vector<ReferencePixel> values;
};

// Two corners, the inside, background beside and far away, side x side pixels each; and two edges,
// side pixels along the edge and at least so many across. Windows that would lie outside the image
// are moved towards the marker's centre. Throws NumericalError when that is outside too, or for a
// scene without a marker. Parallel. A pixel costs what integrate_reference() says.
RenderTruth integrate_truth(const CameraModel& camera, const Scene& scene, int side,
                            const ReferenceOptions& reference);

struct RenderComparison {
    int pixels = 0;
    double rms_gray = 0.0;            // of render - reference
    double reference_rms_gray = 0.0;  // of the reference's standard error
    double reference_fourth = 0.0;    // mean of its fourth power, gray^4
    double p99_gray = 0.0;            // 99th percentile of |render - reference|
    double max_gray = 0.0;            // largest
    double max_sigmas = 0.0;          // largest excess of |render - reference| over 0.1 gray, in
                                      // standard errors of the reference
    double edge_shift_px = 0.0;       // RMS over the profiles
    double reference_shift_px = 0.0;  // of that, what the reference's standard error amounts to

    // What remains of the RMS values when the reference's own noise is taken off.
    double corrected_rms_gray() const;
    double corrected_shift_px() const;
};

std::vector<double> values_at(const Radiance& image, const std::vector<cv::Point>& pixels);

// `radiance`: one value per pixel of the truth. All zero without pixels.
RenderComparison compare_with_truth(std::span<const double> radiance, const RenderTruth& truth);

}  // namespace etalon
