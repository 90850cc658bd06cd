// What happens to a marker's exact image besides the camera's own model: axes of a study along
// which detectors are compared. Order, from the scene to the file:
//   1. contrast      a faded print: every radiance pulled to mid gray, 0.5 + contrast (L - 0.5)
//   2. motion        the scene moves along a straight line in the image while the shutter is open,
//                    all of the image alike (line_blurred() below; exactly: motion_blur.h)
//   3. occlusion     a card of mid gray at rest before the moving scene. Its straight edge lies in
//                    the marker's plane; it covers the image from the edge on. The edge is
//                    antialiased by the share of the pixel that it covers, without the lens' blur
//   4. light         exposure times its fall across the image: 1 at the corner that lies farthest
//                    in one direction, 1 - uneven at the opposite one, linear between them
//   5. noise         normal, of one standard deviation everywhere, added to what the sensor's
//                    photon and read noise make, before the curve (sim/sensor/sensor_model.h)
//   then SensorModel::expose(), then
//   6. JPEG          compressed()
//
// Directions and noise are a pure function of the key, independent of the sensor's noise under the
// same key and of each other: RandomStream(seed, frame, index) of core/statistics/random.h, with 1
// or 2 in the index's upper half.
#pragma once

#include "sim/sensor/sensor_model.h"
#include "sim/tiles/undistortion_map.h"

namespace etalon {

struct Disturbances {
    double exposure = 1.0;      // factor of the light
    double contrast = 1.0;      // of the scene around mid gray
    double uneven = 0.0;        // the light's fall from corner to corner, relative
    double occlusion = 0.0;     // share of the marker's grid (its margins, too) that is hidden
    double motion_px = 0.0;     // length of the way in the image during the exposure
    double noise_dn = 0.0;      // standard deviation, code values of the linear signal
    double jpeg_quality = 0.0;  // libjpeg's, rounded to a whole number; 0: not compressed
};

// One of them as a study's file and report see it.
struct DisturbanceAxis {
    const char* name;
    const char* unit;  // "" for a factor or share
    double Disturbances::*value;
    double least, most;  // valid range, both included

    // Changes nothing; valid even where it is out of the range (jpeg).
    constexpr double neutral() const { return Disturbances{}.*value; }
    bool is_valid(double of_axis) const {  // false for NaN
        return of_axis == neutral() || (of_axis >= least && of_axis <= most);
    }
};

inline constexpr std::array<DisturbanceAxis, 7> disturbance_axes{{
    {"exposure", "", &Disturbances::exposure, 0.0, 100.0},
    {"contrast", "", &Disturbances::contrast, 0.0, 1.0},
    {"uneven", "", &Disturbances::uneven, 0.0, 1.0},
    {"occlusion", "", &Disturbances::occlusion, 0.0, 1.0},
    {"motion-px", "px", &Disturbances::motion_px, 0.0, 100.0},
    {"noise-dn", "DN", &Disturbances::noise_dn, 0.0, 65535.0},
    {"jpeg", "quality", &Disturbances::jpeg_quality, 1.0, 100.0},
}};

// Unit vectors, uniform in direction and independent of each other.
struct DisturbanceDirections {
    Eigen::Vector2d fall;    // in the image: to where the light falls
    Eigen::Vector2d card;    // in the marker's plane: from where the card comes
    Eigen::Vector2d motion;  // in the image
};
DisturbanceDirections disturbance_directions(const NoiseKey& key);

// One per camera: knows where its pixels look. Immutable, safe from every thread; works on the
// caller's alone (a study has a pose per thread).
class Disturber {
public:
    // `sensor` is that of the camera. CPU time about 1 us for 16 px. Throws as Projector does.
    Disturber(const CameraModel& camera, const SensorModel& sensor);

    // Steps 1 to 5 on a rendering of the marker (of several, of that which the card hides),
    // CV_32FC1 of the camera's size. Without any the same pixels, not a copy. One thread; CPU time
    // of a pixel about 1 ns for the contrast, 1.5 for light or card, 15 for noise.
    // Throws NumericalError for a value out of its axis' range, an image of another size or type, a
    // marker that the card cannot hide (MarkerView), and a result that is not finite.
    Radiance disturbed(const Radiance& radiance, const PlacedMarker& marker,
                       const Disturbances& disturbances, const NoiseKey& key) const;

private:
    void hide(const PlacedMarker& marker, double share, const Eigen::Vector2d& from,
              Radiance& radiance) const;
    void add_noise(double noise_dn, const NoiseKey& key, Radiance& radiance) const;

    Projector projector_;
    std::optional<UndistortionMap> map_;  // of a flat projection
    Aperture aperture_;
    cv::Mat response_;  // the sensor's, by pixel; empty: 1
    double range_dn_;
};

// After JPEG of this quality (baseline, OpenCV's encoder); 0: the same pixels, no copy. 1 ms for
// VGA, noisy 3. Throws NumericalError for a quality out of range and an image not of 8 bits.
CodeImage compressed(const CodeImage& image, double quality);

// The image moved along a straight line from -motion/2 to +motion/2 (px, x right, y down) while the
// shutter is open: the mean of the image interpolated by cubic convolution (Keys, IEEE Trans. ASSP
// 29, 1981, a = -1/2), integrated exactly. The border continues outwards. Even regions stay to the
// last bit; motion 0 is no copy.
//
// render_moving() (sim/render/motion_blur.h) is exact, for tens of renders. Largest difference and
// RMS around edges, of their contrast: 0.01 and 0.001 with f/8 on pixels of 2.8 um, 0.07 and 0.008
// where only pixels blur. Needs CV_32FC1 and a finite motion. One thread; an uneven pixel costs 4
// ns for 1 px, 14 for 20, 65 for 100.
Radiance line_blurred(const Radiance& radiance, const Eigen::Vector2d& motion_px);

}  // namespace etalon
