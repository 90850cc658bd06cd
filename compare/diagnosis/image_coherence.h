// Whether a fit's residuals depend on the place in the image: an unmodelled distortion moves the
// corners of different poses alike at the same place, noise and an axis that scatters do not.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

namespace etalon {

// Corners of one pose: their places in the image, px, and what is left of each, in units of its
// noise; x and y of each, stacked.
struct PoseResiduals {
    Eigen::VectorXd place_px, left;
};

struct ImageCoherence {
    // Of the sum of products of different poses' residuals in the same bin, in its standard
    // deviations; the largest of three sizes of bins.
    double deviations = 0.0;
    double share = 0.0;   // of the residuals' power that poses have in common there, 0 to 1
    double bin_px = 0.0;  // side of these bins
};

// Bins are squares of 1/24, 1/12 and 1/6 of the image's diagonal. The standard deviation is that
// under random signs of each pose's residuals: corners of a pose may be correlated. Milliseconds
// for 70 poses. Throws NumericalError where places and residuals do not agree.
ImageCoherence image_coherence(std::span<const PoseResiduals> poses, int width, int height);

// A PASS bears so many: 99.9 % over the three sizes.
inline constexpr double coherence_deviations = 3.4;

}  // namespace etalon
