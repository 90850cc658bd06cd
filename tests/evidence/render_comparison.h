// The renderer against the reference integrator, on windows that hold what is hard: edges, corners,
// the inside, and the background beside and far from the marker (diffraction tails). Used at
// reduced size by a test and at full size by the program render_accuracy.
#pragma once

#include "sim/benchmark_scenes.h"
#include "sim/reference_integrator.h"

namespace etalon {

struct RenderComparison {
    int pixels = 0;
    double rms_gray = 0.0;            // of render - reference
    double reference_rms_gray = 0.0;  // of the reference's standard error
    double reference_fourth = 0.0;    // mean of its fourth power, gray^4
    double max_gray = 0.0;            // largest |render - reference|
    double max_sigmas = 0.0;          // largest excess of |render - reference| over 0.1 gray, in
                                      // standard errors of the reference
    RenderPlan plan;

    // What remains of the RMS when the reference's own noise is taken off.
    double corrected_rms_gray() const;
};

// Six windows of side x side pixels.
std::vector<cv::Rect> comparison_windows(const BenchmarkScene& scene, int side);

RenderComparison compare_with_reference(const BenchmarkScene& scene, int side,
                                        const ReferenceOptions& reference,
                                        const RenderOptions& options = {});

}  // namespace etalon
