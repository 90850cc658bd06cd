// One photograph against its rendering, linearised: normal equations for the camera's parameters,
// the marker's pose and the photometric model together.
//
// A pixel's residual is (photograph - prediction) / (standard deviation of its noise). That is the
// sensor's where the camera's file has it, else 1 gray, times a scale found from the residuals.
// Huber's loss limits residuals beyond 3.
#pragma once

#include "calib/camera/projector.h"
#include "calib/intrinsics/calibration_model.h"
#include "compare/photometric/photometric_model.h"
#include "core/optimize/least_squares.h"
#include "sim/render/renderer.h"

namespace etalon {

// A marker's pose and the camera's parameters displace what each pixel sees. With q' the derivative
// of the displacement by a parameter, px,
//     d radiance / d parameter = -(gradient of the rendering) . q'.
// The gradient comes from renderings with the marker displaced in its own plane by +- 0.1 px: error
// 0.3 % RMS behind a Gaussian of 0.5 px, where filters on the pixel grid have 11 %. The blur's
// change with depth is neglected: 2 % RMS of the derivatives by depth and tilt for a marker of
// 70 px, 8 % of that by k3. It is even across an edge, so steps and covariance hardly see it.

// q' by a small left perturbation of the marker's pose (rx ry rz tx ty tz: px per rad and px per
// mm) and by the camera's parameters. Evaluated every 4 px and interpolated linearly: right to 1e-3
// of the largest displacement. About 0.3 us a node.
class ImageMotion {
public:
    // `parameters` may be empty, `region` may not. Throws NumericalError for a telecentric camera.
    ImageMotion(const Projector& projector, const Rigid& camera_from_marker,
                const CalibrationModel& parameters, const cv::Rect& region);

    int columns() const { return columns_; }  // parameters first, then the pose's six
    const cv::Rect& region() const { return region_; }

    // One column each, px per unit of the parameter; false (and nothing written) where a ray is
    // missing nearby, or does not meet the marker's plane in front of the camera.
    bool at(int x, int y, Eigen::Ref<Eigen::Matrix2Xd> motion) const;

private:
    static constexpr int spacing_px_ = 4;

    cv::Rect region_;
    int columns_, nodes_per_row_;
    std::vector<Eigen::Matrix2Xd> nodes_;  // row by row; no columns where there is no motion
};

// CV_32FC1 of the region's size.
struct RenderedGradient {
    Radiance radiance;
    cv::Mat by_x, by_y;  // d radiance / d position, per px
};

// The marker displaced by 0.1 px to both sides (five renderings), or to one side (three): the
// gradient 0.05 px away, enough for a search.
enum class Differences { central, forward };

// A camera as photographs are compared with it. Making it takes some 20 ms of CPU time for VGA, and
// its first rendering as much with a lens section. Safe from every thread.
class PhotometricCamera {
public:
    // The light's own gray, or the mean of the sensor's codes, which matters to a lens' blur.
    enum class Predicts { light, mean_codes };
    explicit PhotometricCamera(const CameraModel& camera, Predicts predicts = Predicts::light);

    const CameraModel& model() const { return projector_.camera(); }
    const Projector& projector() const { return projector_; }
    const Renderer& renderer() const { return renderer_; }
    LightCurve curve(const PhotometricModel& photometry) const {
        return {model().sensor, photometry};
    }
    bool knows_noise() const { return !noise_.empty(); }
    const MeanCode& mean_code() const { return mean_code_; }

    // Standard deviation of a pixel's noise at a predicted gray; 1 where it is not known.
    double noise_gray(double gray) const;

    // Rough ones find the way, fine ones the result.
    static constexpr double rough_tolerance_gray = 0.5, fine_tolerance_gray = 0.1;

    // What arrives at the sensor's pixels within the region, CV_32FC1 of its size.
    Radiance at_sensor(const Scene& scene, const cv::Rect& region,
                       double tolerance_gray = fine_tolerance_gray) const;

    // And its derivatives in the region of `motion`, which is of this marker's pose; 0 where there
    // is no motion. Throws NumericalError when the region's middle sees nothing of the marker's
    // plane, and what the renderer throws.
    RenderedGradient gradient_at_sensor(const PlacedMarker& marker, double background,
                                        const ImageMotion& motion,
                                        Differences differences = Differences::central,
                                        double tolerance_gray = fine_tolerance_gray) const;

private:
    Projector projector_;
    Renderer renderer_;
    cv::Mat response_;           // relative, by pixel; empty: 1
    std::vector<double> noise_;  // of gray 0, 1, ... 255
    MeanCode mean_code_;
};

// Which of a photograph's own unknowns are free; the others keep their values.
struct PhotometricTerms {
    int level_terms = 3;  // of each of black and white: 1 constant, 3 plane, 6 quadratic surface
    bool psf = true;      // the Gaussian's width
    bool tone = false;
    bool pose = true;  // the marker's; the equations have its place in either case
    bool psf_anisotropy = false;
    bool saturation = false;  // its level and knee
    // The logarithm of the stated noise, by which mean codes change. No step follows it.
    bool noise = false;

    // Photometric parameters.
    int count() const {
        return 2 * level_terms + (psf ? 1 : 0) + (psf_anisotropy ? 1 : 0) + (tone ? 1 : 0) +
               (saturation ? 2 : 0) + (noise ? 1 : 0);
    }
};

struct PhotoOfMarker {
    cv::Mat gray;  // CV_32FC1
    CellGrid grid;
    cv::Mat use;              // CV_8UC1 of PixelUse, the photograph's size
    uchar fitted;             // which of them count
    double background = 1.0;  // radiance around the marker
    int stands_for = 1;       // of flat places `use` holds one pixel in so many
};

// From 100 000 fitted pixels on: of those over 8 px from every edge of the rendering at this pose
// only every seventh in x and y is kept, as JPEG's blocks are of 8.
PhotoOfMarker with_few_flats(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                             const Rigid& camera_from_marker);

// Where more than twice as many pixels are fitted, about that many of them, on a lattice that meets
// every row and every column.
PhotoOfMarker with_few_pixels(const PhotoOfMarker& photo, int enough_pixels);

struct PhotoState {
    Rigid camera_from_marker;
    PhotometricModel photometry;
};

// At a state, in the order: camera parameters, pose (left perturbation), photometric parameters
// (black levels, white levels, mean variance and anisotropy of the Gaussian in px^2, tone,
// saturation's level and knee, logarithm of the noise). A held pose, and a width or tone that would
// leave its range, has no score and an information of 1. A free saturation has a prior: level 255
// +- 10 gray, knee 15 +- 15.
struct PhotoEquations {
    PhotoState state;
    double noise_scale = 1.0;      // multiplies the noise
    Eigen::MatrixXd information;   // J^T J of the pixels within Huber's threshold
    Eigen::VectorXd score;         // J^T r, r limited to the threshold
    Eigen::MatrixXd block_scores;  // the score in parts, a column for each of at most 10 x 10
                                   // blocks of the region, none below 5 px
    double huber_sum = 0.0;        // of Huber's function
    double squares = 0.0;          // sum of the squares of the limited r
    double median_size = 0.0;      // of |r|, of the pixels that do not clip
    int pixels = 0;

    double loss() const { return huber_sum; }
};

// Throws NumericalError for sizes that differ, fewer than 50 pixels and what the renderer refuses.
PhotoEquations photo_equations(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                               const PhotoState& state, const PhotometricTerms& terms,
                               const CalibrationModel& parameters, double noise_scale);

// The same from a rendering of the region of `motion`. Its derivatives may be those of a pose
// nearby; without them they are central differences on the pixel grid, right to some 10 %.
// `changes`: derivatives of the rendering by further parameters, CV_32FC1 of the region's size;
// their columns come first.
PhotoEquations photo_equations(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                               const PhotoState& state, const PhotometricTerms& terms,
                               const RenderedGradient& rendered, const ImageMotion& motion,
                               double noise_scale, std::vector<cv::Mat> changes = {});

// Throws NumericalError unless photograph and mask have the camera's size and their types.
void require_fitting(const PhotoOfMarker& photo, const PhotometricCamera& camera);

// Reach of the photometric model's Gaussian: five times its largest width, and one.
inline constexpr int gaussian_reach_px = 16;

// The part of the image with the fitted pixels and some room around them. Throws NumericalError for
// sizes that differ and fewer than 50 pixels.
cv::Rect fitted_region(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                       int room_px = gaussian_reach_px);

// CV_32FC1, gray: what the photograph should be. Right on the marker (photo.use not 0).
cv::Mat predicted_at(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                     const PhotoState& state);

// The state after a step in pose and photometric parameters (the tail of the equations' order);
// the Gaussian's widths, tone, level and knee stay in their ranges.
PhotoState stepped(const PhotoState& state, const PhotometricTerms& terms,
                   const Eigen::VectorXd& step);

// A start: constant levels from the straight line of gray against the rendering at this pose.
// Throws NumericalError when that rendering has no contrast.
PhotoState starting_state(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                          const Rigid& camera_from_marker, const PhotometricTerms& terms);

// Steps of one photograph's pose and photometric model towards the least Huber loss: Gauss and
// Newton's, damped where they lead uphill (Levenberg, Marquardt). Each takes one rendering, unless
// only noise scale or photometric model change. The gradient is of central differences until
// render_gradient(), which is kept. Photograph and camera must outlive it. One thread.
class PhotometricSteps {
public:
    // `near` is about where the steps will be: within some px. Throws as photo_equations() does.
    PhotometricSteps(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                     const PhotometricTerms& terms, const PhotoState& near);

    // From now on with the pixels of this one, the same photograph. It must outlive this.
    void look_at(const PhotoOfMarker& photo) { photo_ = &photo; }

    PhotoEquations at(const PhotoState& state, double noise_scale);

    // From now on all equations have the gradient of this state: three renderings.
    void render_gradient(const PhotoState& state);

    // Moves the place; whether it converged. At most 25 tries, and damping to 1000 where the rule
    // allows more. Throws NumericalError where the pixels do not determine the unknowns.
    bool descend(PhotoEquations& place, DescentRule rule);

    // To the root of J^T r, from where the gradient was rendered: full steps while each promises
    // less than half of the one before. Whether the last one promises no more than `enough_gain`.
    bool settle(PhotoEquations& place, double enough_gain);

    int renderings() const { return renderings_; }

private:
    void render(const Rigid& camera_from_marker);
    std::optional<PhotoEquations> after(const PhotoEquations& place, const Eigen::VectorXd& step);

    const PhotoOfMarker* photo_;
    const PhotometricCamera* camera_;
    PhotometricTerms terms_;
    ImageMotion motion_;
    RenderedGradient gradient_;      // without slopes: central differences
    std::optional<Rigid> rendered_;  // where gradient_.radiance is
    int renderings_ = 0;
};

// By how much a step from there should lower the loss.
double promised_gain(const PhotoEquations& equations);

// 1.4826 times the median size of the residuals. Where the camera knows its noise, 1 unless that is
// larger by three of its own standard errors; else not below 0.2 gray.
double noise_scale_of(const PhotoEquations& place, bool knows_noise);

// Least squares on all pixels from a start whose residuals may be far above the noise, until the
// steps are small against what is left.
PhotoEquations approached(PhotometricSteps& steps, const PhotoState& start);

}  // namespace etalon
