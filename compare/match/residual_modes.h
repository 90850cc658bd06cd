// What is left between a photograph and its rendering at the best pose, taken apart into named
// modes: Rao's score test of groups of parameters that the fit did not have.
//
// A mode is how all pixels would change together. It counts as far as what the fit had (levels,
// tone, blur, pose) cannot imitate it. The chi-square of a group is the smaller of two: the formal
// one, of independent pixels, and that of a sandwich covariance over JPEG's blocks of 8 x 8 px
// (White, Econometrica 48, 1980). From 500 000 pixels on some of the blocks are left out. Pixels
// beyond 3 deviations are limited as in the fit (Huber).
#pragma once

#include <Eigen/Core>

#include "compare/photometric/photo_match.h"

namespace etalon {

enum class ResidualMode {
    rows,         // displaced by (a, b) px times the row, -1 .. 1 from the marker's top to bottom
    calibration,  // f (both), cx, cy, k1, k2: in their units
    blur_along,   // variance (vxx - vyy) / 2 and vxy, px^2
    sharpening,   // parts of (image - image blurred by sharpening_sigma_px)
    blur,         // variance, px^2: only where the camera's lens section gave the blur
};
inline constexpr int residual_mode_count = 5;
inline constexpr double sharpening_sigma_px = 1.5;

struct ModeFit {
    ResidualMode mode{};
    Eigen::VectorXd values;  // one Gauss-Newton step from the fit: exact for small ones
    double chi_square = 0.0;
    int freedom = 0;
    // RMS displacement along the normals of all edges that the mode explains, noise taken out; of a
    // blur or sharpening one that changes as many gray values.
    double size_px = 0.0;
    bool is_significant() const;  // over (5 + sqrt(freedom - 1))^2: a chance below 3e-7
};

// The normal equations of one photograph for all modes.
class ResidualModes {
public:
    // Of the pixels where `counted` (CV_8UC1) is not 0. Pose and noise scale are those of the fit.
    // The modes are derived from its prediction, by differences on the pixel grid: right to some 10
    // %. Throws NumericalError for sizes that differ, fewer than 128 pixels and what is not finite.
    ResidualModes(const PhotoFit& fit, const cv::Mat& counted, const PhotometricCamera& camera,
                  const Rigid& camera_from_marker, double noise_scale);

    // A mode in addition to what the fit had and the modes in `known`.
    ModeFit fit(ResidualMode mode, const std::vector<ResidualMode>& known) const;

    // The modes that stand out, the largest first, each in addition to those before it.
    std::vector<ModeFit> significant() const;

private:
    struct Images;
    using Columns = std::vector<int>;
    struct Block {
        Eigen::MatrixXd information;
        Eigen::VectorXd score;
    };

    Columns columns_of(ResidualMode mode) const;
    // Of the blocks' scores of the columns `own`, of which a fit of all has taken out its part.
    Eigen::MatrixXd block_scatter(const Columns& own, const Columns& others,
                                  const Eigen::MatrixXd& imitation, const Eigen::VectorXd& scale,
                                  const Eigen::VectorXd& unscaled) const;

    bool has_lens_ = false;
    std::vector<Block> blocks_;
    Eigen::MatrixXd information_;
    Eigen::VectorXd score_;
    double squares_ = 0.0, per_px2_ = 0.0;
    int pixels_ = 0;
};

}  // namespace etalon
