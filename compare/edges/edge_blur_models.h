// The lens blurs that are fitted to edges (compare/edges/edge_fit.h).
#pragma once

#include <memory>
#include <vector>

#include "calib/camera/camera_model.h"
#include "compare/edges/edge_fit.h"
#include "sim/scene/marker_view.h"

namespace etalon {

// Radius of the blur disk along an edge's normal, px: what the aperture makes of the edge's depth
// (root mean square over its length).
double defocus_radius_px(const StraightEdge& edge, const Aperture& aperture);

// One parameter: the variance of a Gaussian that stands for the whole blur, px^2 along the normal.
BlurModel gaussian_width();

// One parameter, sigma^2 in px^2 (of the pitch along x), beside the known blur disk and, when
// lambda_n_px is over 0, beside the Airy pattern.
BlurModel gaussian_blur(const Aperture& aperture, double lambda_n_px);

// Round patterns whose density does not rise outwards: parts of unit energy, flat to one of the
// radii (0, r1, ...) and falling linearly to zero at the next.
class SlopingDisks {
public:
    explicit SlopingDisks(std::vector<double> radii_px);  // rising from above 0, two or more

    // With the parts as parameters.
    BlurModel model() const;

    // Density at 0 and at the radii by part: (radii + 1) x radii.
    Eigen::MatrixXd density_by_part() const;

    // Transfer of part k at a frequency, cycles per px; and of all.
    double transfer(std::size_t k, double frequency) const;

    const std::vector<double>& radii_px() const { return radii_; }

private:
    double inner(std::size_t k) const { return k == 0 ? 0.0 : radii_[k - 1]; }

    std::vector<double> radii_;
};

}  // namespace etalon
