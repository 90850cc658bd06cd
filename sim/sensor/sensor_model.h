// The sensor behind the lens: code values from linear radiance, and back for the comparison.
//
// Order of operations, for a pixel of radiance L (1 = full scale F = 2^bits - 1):
//   1. relative response       L q: q the relative illumination (cos^4 of the field angle, or the
//                              measured polynomial) times the response of the pixel's channel
//   2. linear signal           s = (F - black) L q, in linear code values (DN) above black
//   3. noise, only with a key  s + n, var n = max(s, 0) / gain + (read_noise / gain)^2   [DN^2]
//   4. transfer curve          T((s + n) / (F - black))
//   5. black level             c = black + (F - black) T, so that no light gives exactly `black`
//   6. quantisation            round half up, limited to 0..F (the saturation of a real sensor)
// The terms are those of EMVA 1288's linear camera model. Photon and read noise together are one
// normal deviate: mean and variance are right at every level, the Poisson distribution's skewness
// (1/5 at 25 electrons) is not drawn.
//
// A longer exposure is expose(radiance * factor). A mosaic's image is the raw one: one value a
// pixel, of the channel that channel_of_pixel() gives, with that channel's signal and noise.
#pragma once

#include "calib/camera/camera_model.h"
#include "sim/sensor/sensor_steps.h"
#include "sim/tiles/render_plan.h"

namespace etalon {

// Fraction of full scale from fraction of full scale. `encode` applies the curve, `decode` inverts
// it. Both continue straight on with the first slope below 0 (noise around black stays unbiased);
// above the curve's end they stay at its last value. Rec. 709 is ITU-R BT.709-6, item 1.2; its two
// branches leave a gap of 0.00025, which decodes to 0.018. A table is interpolated linearly.
double encode(const Transfer& transfer, double radiance);
double decode(const Transfer& transfer, double code);

// The colour filter on the pixel (x, y), x and y >= 0; green without a mosaic.
enum class Channel { red, green, blue };
Channel channel_of_pixel(Mosaic mosaic, int x, int y);

// One per camera. A camera without a sensor section is 8 bit, linear, without noise. Safe from
// every thread once built; results do not depend on the number of threads.
class SensorModel {
public:
    // Throws ConfigError when the sensor section contradicts itself: bits outside 1..16, black not
    // in [0, full scale), negative gain or noise, noise without gain, a table not strictly rising
    // from 0 to 1 with codes in [0, 1], an illumination not positive everywhere, cos^4 of a
    // telecentric camera, or a channel without response. cos^4 unprojects every pixel once (0.2 us
    // each). Steps of 16 bits take 15 ms and 5 MB (sim/sensor/sensor_steps.h).
    explicit SensorModel(const CameraModel& camera);

    // Code values of a radiance image of the camera's size. CPU time: docs/performance.md. Throws
    // NumericalError for another size or type and for a pixel that is not finite.
    CodeImage expose(const Radiance& radiance, std::optional<NoiseKey> noise = {}) const;

    // The same codes from a rendering's part. Without noise, illumination and mosaic all of the
    // background has one code, and costs nothing but memory.
    CodeImage expose(const RenderedPart& part, std::optional<NoiseKey> noise = {}) const;

    // The codes of the part's region alone: an image of its size, with the noise that the whole
    // image would have there.
    CodeImage expose_region(const RenderedPart& part, std::optional<NoiseKey> noise = {}) const;

    // Steps 6 to 2 undone: radiance at the sensor (relative response stays in). Codes below black
    // are negative, a saturated code is 1, a lower bound. Any size; NumericalError for another bit
    // depth.
    Radiance linear_radiance(const CodeImage& image) const;

    // q by pixel, CV_32FC1; empty when it is 1 everywhere. Where the distortion model has no ray
    // (the renderer's mask says where) cos^4 is taken as 1.
    const cv::Mat& relative_response() const { return response_; }

    int bits() const { return sensor_.bits; }
    // F - black: the linear signal of radiance 1, DN.
    double range_dn() const { return range_; }

private:
    double code_of(double radiance) const;
    const NoiseKey* used(const std::optional<NoiseKey>& noise) const;
    // False where a pixel's radiance, or what its response and noise make of it, is not finite.
    template <class Code>
    bool expose_row(const float* radiance, const cv::Point& first, int count, const NoiseKey* noise,
                    Code* codes) const;

    Sensor sensor_;
    cv::Size size_;
    double full_scale_, range_;  // F and F - black, DN
    cv::Mat response_;
    std::optional<QuantizationThresholds> steps_;  // set once the section is checked
};

}  // namespace etalon
