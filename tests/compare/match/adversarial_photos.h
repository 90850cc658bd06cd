// Photographs with something wrong about them, made from the true scene: each fault as nature or a
// camera would make it, never as the test that looks for it thinks of it. For the tests of
// compare/match/photo_findings.h.
#pragma once

#include "compare/match/photo_findings.h"
#include "sim/render/renderer.h"

namespace etalon::test {

// A target before the true camera: 320 x 240 px, 8 bit, some distortion, a Gaussian lens of 0.7 px,
// noise of 1 to 2 gray.
struct TrueScene {
    Marker marker;
    Rigid camera_from_marker;
    CellGrid shown;  // what hangs there: the marker's own grid unless a fault changes it
    double white = 0.8, black = 0.03;  // radiance
};

CameraModel true_camera();
// What a calibration says of it: intrinsics and distortion, nothing of lens and sensor.
CameraModel calibrated_camera();

// The tag "apriltag:36h11:5@50mm" of about 120 px, or the board "chessboard:9x6@25mm" of about
// 230 px. Poses 0 and 1 have tilts of 25 and 35 degrees about other axes; from 2 on they are drawn.
TrueScene tag_scene(int pose);
TrueScene board_scene(int pose);
// The board nearer, so that it fills the image's width: what shows a wrong distortion.
TrueScene wide_board_scene(int pose);

// Of full scale, before the sensor. The second by the reference integrator, to some tenths of a
// gray; about 3 s of CPU time for a tag.
Radiance radiance_of(const TrueScene& scene);
Radiance reference_radiance_of(const TrueScene& scene);

// Noise by the seed.
CodeImage exposed(const Radiance& radiance, int seed);

// Faults before the sensor. Positions and sizes are those of the marker in the image.
Radiance occluded(const TrueScene& scene, double side_px, double reflectance);
Radiance with_glare(const TrueScene& scene, double sigma_px, double peak);
Radiance moved(const TrueScene& scene, double path_px);
Radiance rolled(const TrueScene& scene, double path_px);  // while the marker's rows are read
Radiance unevenly_lit(const TrueScene& scene, double least);

// Faults behind the sensor.
CodeImage sharpened(const CodeImage& photo, double amount, double sigma_px);
CodeImage negative(const CodeImage& photo);
CodeImage compressed(const CodeImage& photo, int jpeg_quality);

// The pose that corners would give, with this camera: each corner has an error of 0.05 px.
Rigid found_pose(const TrueScene& scene, const CameraModel& camera, int seed);

// As `etalon compare` examines a photograph at a pose.
Findings examined(const CodeImage& photo, const TrueScene& scene, const Rigid& pose,
                  const std::shared_ptr<const PhotometricCamera>& camera);

// The marker's middle and its size in the true image.
Eigen::Vector2d middle_px(const TrueScene& scene);
double cell_px(const TrueScene& scene);

}  // namespace etalon::test
