// What one photograph makes of a rendering: levels of black and white, further blur, saturation.
//
//     gray = S(black + (white - black) * C(T(Gaussian * radiance)))     at each pixel
//
// Gray = code value / full scale * 255. Black and white are surfaces over the image, of second
// order at most. The Gaussian (*: convolution) is the blur that the camera's lens section leaves
// out. Its variances along x and y may differ (mosaic, fields of a video signal). T is what the
// camera's transfer curve makes of light between black and white (LightCurve), not fitted. C(s) = s
// + tone s (1 - s) is an unknown rest of that curve. S is saturation (Saturation).
#pragma once

#include <opencv2/core.hpp>

#include <optional>
#include <vector>

#include "calib/camera/camera_model.h"
#include "core/geometry/rigid.h"

namespace etalon {

// White that clips, and the shoulder below: the expectation of min(gray + n, level) with n normal
// of standard deviation `knee`. That is the pixels' noise where a sensor clips hard, and some 20
// gray where a camera compresses its highlights.
struct Saturation {
    double level_gray = 255.0;  // 225 .. 265
    double knee_gray = 15.0;    // 0.5 .. 60

    struct Point {
        double gray, slope, by_level, by_knee;  // the value, and its derivatives
    };
    Point at(double gray) const;
};

struct PhotometricModel {
    Vector6d black = Vector6d::Zero(), white = black;  // gray, by level_terms()
    // Square root of the Gaussian's mean variance along x and y, and half of their difference
    // (positive: wider along x; at most the mean).
    double psf_sigma_px = 0.0;  // 0 .. 3
    double psf_anisotropy_px2 = 0.0;
    double tone = 0.0;                     // -1 .. 1, where C still rises everywhere
    std::optional<Saturation> saturation;  // nothing: S(gray) = gray
    int pixels = 0;                        // that were fitted

    Eigen::Vector2d psf_sigmas_px() const;  // along x and y

    // At a pixel with these level_terms(), of what the camera's curve makes of the blurred
    // radiance: gray, and the derivative by it.
    struct Point {
        double gray, by_seen;
    };
    Point at(const Vector6d& level_terms, double seen) const;
    Point between(double black, double white, double seen) const;  // of levels that are at hand
};

inline constexpr double max_psf_sigma_px = 3.0;
inline constexpr double min_saturation_gray = 225.0, max_saturation_gray = 265.0;
inline constexpr double min_knee_gray = 0.5, max_knee_gray = 60.0;

// 1, x, y, x^2, x y, y^2 of a pixel with x and y from -0.5 to 0.5 over the image.
Vector6d level_terms(double x, double y, cv::Size size);

// The model's levels along a row of pixels.
class LevelRow {
public:
    LevelRow(const PhotometricModel& model, int y, cv::Size size);

    double black(int x) const { return at(black_, x); }
    double white(int x) const { return at(white_, x); }

private:
    double at(const Eigen::Vector3d& c, int x) const {
        const double u = (x - middle_) * per_px_;
        return c[0] + u * (c[1] + u * c[2]);
    }

    double middle_, per_px_;
    Eigen::Vector3d black_, white_;
};

// CV_32FC1: code values / full scale * 255.
cv::Mat gray_of(const CodeImage& image);

// What a sensor's curve makes of radiance between a photograph's black (0, stays 0) and white (1,
// stays 1), at the levels of the image's centre.
class LightCurve {
public:
    LightCurve() = default;  // of a linear sensor
    LightCurve(const std::optional<Sensor>& sensor, const PhotometricModel& model);

    struct Point {
        double value, slope;
    };
    Point at(double radiance) const;
    double value(double radiance) const;

private:
    Transfer transfer_;
    double dark_ = 0.0, light_ = 1.0;  // of full scale
    double low_ = 0.0, range_ = 1.0;   // of the curve between them
};

// The photograph that the model expects, CV_32FC1, gray, the radiance's size.
cv::Mat predicted_gray(const PhotometricModel& model, const Radiance& radiance,
                       const LightCurve& curve);

// Convolution with a discrete Gaussian: the solution of the diffusion equation with the second
// difference of fourth order, (-1 16 -30 16 -1) / 12. Its variance is sigma^2 and its fourth moment
// 3 sigma^4 for the smallest sigma too. Edges are replicated.
cv::Mat blurred(const cv::Mat& image, double sigma_px);
cv::Mat blurred(const cv::Mat& image, const Eigen::Vector2d& sigmas_px);

// The mean of a sensor's code values. Where the noise is below a code it is not the light's own
// value: light at 16.3 codes with a noise of 0.17 codes is nearly always code 16. A code is at
// least k where the noisy linear signal s (sim/sensor/sensor_model.h) passes the threshold t_k at
// which the transfer curve reaches k - 1/2:
//     mean code = sum over k = 1 .. F of Phi((s - t_k) / sigma(s))
// Source: Widrow and Kollar, "Quantization Noise", Cambridge 2008, chapter 5. Made in some 5 ms for
// 8 bits. Safe from every thread.
class MeanCode {
public:
    // The codes of light itself: of a sensor whose noise is not stated, and beyond 10 bits.
    MeanCode() = default;
    explicit MeanCode(const Sensor& sensor);

    struct Point {
        double gray = 0.0, slope = 1.0;
        double by_log_noise = 0.0;  // gray that a noise larger by the factor e adds, first order
    };
    // At the light's gray without noise and rounding. Noise counts as 0.1 codes at least.
    Point at(double gray) const;

private:
    double codes_per_gray_ = 1.0;
    std::vector<double> mean_, by_log_noise_;  // in codes, from one code below 0 to one above F
};

}  // namespace etalon
