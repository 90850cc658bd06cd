// Photographs with something wrong about them, made from the true scene: each fault as nature or a
// camera would make it, never as the test that looks for it thinks of it. For the tests of
// compare/match/photo_findings.h.
#pragma once

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "compare/match/photo_findings.h"
#include "compare/photometric/photometric_model.h"
#include "sim/render/motion_blur.h"
#include "sim/render/reference_integrator.h"
#include "tests/compare/rendered_tags.h"
#include "tests/image_of.h"

namespace etalon::test {

// A target before the true camera: 320 x 240 px, 8 bit, some distortion, a Gaussian lens of 0.7 px,
// noise of 1 to 2 gray.
struct TrueScene {
    Marker marker;
    Rigid camera_from_marker;
    CellGrid shown;  // what hangs there: the marker's own grid unless a fault changes it
    double white = 0.8, black = 0.03;  // radiance
};

// What a calibration says of the true camera: intrinsics and distortion, nothing of lens and
// sensor.
inline CameraModel calibrated_camera() {
    return camera_with(320, 240, {303.0, 301.0, 157.0, 122.0}, {.k1 = -0.2, .k2 = 0.05});
}

inline CameraModel true_camera() {
    CameraModel camera = calibrated_camera();
    camera.sensor =
        Sensor{.pixel_pitch_um = 6.0, .black_dn = 5.0, .gain_e_per_dn = 60.0, .read_noise_e = 40.0};
    camera.lens = Lens{8.0, 300.0, 550.0, {PointSpread::Kind::gaussian, 0.7}};
    return camera;
}

inline const Renderer& true_renderer() {
    static const Renderer renderer(true_camera());
    return renderer;
}

// The marker's middle at (x, y, z), turned.
inline TrueScene scene_at(const std::string& name, const Eigen::Vector3d& rotation,
                          const Eigen::Vector3d& middle) {
    TrueScene scene;
    scene.marker = parse_marker(name, "test");
    scene.shown = scene.marker.grid;
    scene.shown.cells = scene.marker.grid.cells.clone();
    scene.camera_from_marker = board_pose(scene.marker, rotation, middle);
    return scene;
}

// Tilts of 10 to 35 degrees about any axis, any small roll, somewhere around the image's middle.
inline TrueScene drawn_scene(const std::string& name, int pose, double distance_mm,
                             double room_mm) {
    RandomStream random(77, 3, static_cast<std::uint64_t>(pose));
    const auto between = [&](double low, double high) {
        return low + (high - low) * random.uniform();
    };
    const double axis = between(-3.1, 3.1), tilt = between(0.17, 0.61);
    return scene_at(
        name, {tilt * std::cos(axis), tilt * std::sin(axis), between(-0.4, 0.4)},
        {between(-room_mm, room_mm), between(-room_mm, room_mm), distance_mm * between(1.0, 1.1)});
}

// The tag "apriltag:36h11:5@50mm" of about 120 px, or the board "chessboard:9x6@25mm" of about
// 230 px. Poses 0 and 1 have tilts of 25 and 35 degrees about other axes; from 2 on they are drawn.
inline TrueScene tag_scene(int pose) {
    const std::string name = "apriltag:36h11:5@50mm";
    if (pose == 0)
        return scene_at(name, {0.35, -0.26, 0.15}, {7.0, -5.0, 125.0});
    if (pose == 1)
        return scene_at(name, {-0.25, 0.55, -0.3}, {-9.0, 6.0, 120.0});
    return drawn_scene(name, pose, 125.0, 10.0);
}

inline TrueScene board_scene(int pose) {
    const std::string name = "chessboard:9x6@25mm";
    if (pose == 0)
        return scene_at(name, {0.35, -0.26, 0.1}, {5.0, -4.0, 300.0});
    if (pose == 1)
        return scene_at(name, {-0.25, 0.55, -0.1}, {-6.0, 4.0, 310.0});
    return drawn_scene(name, pose, 320.0, 6.0);
}

// The board nearer, so that it fills the image's width: what shows a wrong distortion.
inline TrueScene wide_board_scene(int pose) {
    return scene_at("chessboard:9x6@25mm",
                    pose == 0 ? Eigen::Vector3d(0.12, -0.1, 0.03) : Eigen::Vector3d(-0.1, 0.14, 0),
                    {1.0, -3.0, 236.0});
}

inline Scene still(const TrueScene& scene, const Rigid& pose) {
    Scene result{{{scene.shown, pose}}, scene.white};
    result.markers[0].grid.cells =
        cv::Mat(scene.black + (scene.white - scene.black) * scene.shown.cells);
    return result;
}

// Of full scale, before the sensor.
inline Radiance radiance_of(const TrueScene& scene) {
    return true_renderer().render(still(scene, scene.camera_from_marker)).radiance;
}

// By the reference integrator, to some tenths of a gray; about 3 s of CPU time for a tag.
inline Radiance reference_radiance_of(const TrueScene& scene) {
    const CameraModel camera = true_camera();
    return integrate_reference(camera, still(scene, scene.camera_from_marker),
                               cv::Rect(0, 0, camera.width, camera.height),
                               {.samples_per_scramble = 128, .stop_at_gray = 0.3})
        .mean;
}

// Noise by the seed.
inline CodeImage exposed(const Radiance& radiance, int seed) {
    static const SensorModel sensor(true_camera());
    return sensor.expose(radiance, NoiseKey{static_cast<std::uint64_t>(seed), 0});
}

inline double depth(const TrueScene& scene) {
    return (scene.camera_from_marker * middle_of(scene.marker)).z();
}

// The marker's middle and its size in the true image.
inline Eigen::Vector2d middle_px(const TrueScene& scene) {
    return Projector(true_camera())
        .project(scene.camera_from_marker * middle_of(scene.marker))
        .value();
}

inline double cell_px(const TrueScene& scene) {
    return true_camera().intrinsics.fx * scene.marker.grid.cell_mm.x() / depth(scene);
}

// ---- faults before the sensor: positions and sizes are those of the marker in the image

// A turned square with soft edges, as of something just before the marker.
inline Radiance occluded(const TrueScene& scene, double side_px, double reflectance) {
    Radiance radiance = radiance_of(scene);
    const Eigen::Vector2d middle = middle_px(scene) + Eigen::Vector2d(5.3, -7.1);
    const cv::RotatedRect patch(
        cv::Point2f(static_cast<float>(middle.x()), static_cast<float>(middle.y())),
        cv::Size2f(static_cast<float>(side_px), static_cast<float>(side_px)), 25.0f);
    cv::Mat cover(radiance.size(), CV_32FC1, cv::Scalar(0));
    std::array<cv::Point2f, 4> corners;
    patch.points(corners.data());
    std::vector<cv::Point> fixed;
    constexpr int fraction_bits = 8;
    for (const cv::Point2f& corner : corners)
        fixed.emplace_back(cv::Point2f(corner * static_cast<float>(1 << fraction_bits)));
    cv::fillConvexPoly(cover, fixed, cv::Scalar(1), cv::LINE_8, fraction_bits);
    cv::GaussianBlur(cover, cover, {0, 0}, 0.8);
    return radiance.mul(1.0 - cover) + reflectance * cover;
}

inline Radiance with_glare(const TrueScene& scene, double sigma_px, double peak) {
    const Radiance radiance = radiance_of(scene);
    const Eigen::Vector2d middle = middle_px(scene) + Eigen::Vector2d(-6.2, 4.7);
    return radiance + image_of(radiance.size(), [&](int x, int y) {
               const double square = (Eigen::Vector2d(x, y) - middle).squaredNorm();
               return peak * std::exp(-square / (2.0 * sigma_px * sigma_px));
           });
}

// mm across the line of sight that move the marker's middle by 0.8 and 0.6 px a px of path.
inline Eigen::Vector3d sideways(const TrueScene& scene, double path_px) {
    const Intrinsics& k = true_camera().intrinsics;
    return path_px * depth(scene) * Eigen::Vector3d(0.8 / k.fx, 0.6 / k.fy, 0.0);
}

inline Radiance moved(const TrueScene& scene, double path_px) {
    MotionDuringExposure motion;
    motion.exposure_s = 0.01;
    motion.velocity.tail<3>() = sideways(scene, path_px) / motion.exposure_s;
    return render_moving(true_renderer(), still(scene, scene.camera_from_marker), motion,
                         {.tolerance_gray = 0.5})  // below the noise
        .image.radiance;
}

// Every band of eight rows sees the marker where it is then; in its middle at the true pose.
inline Radiance rolled(const TrueScene& scene, double path_px) {
    constexpr int band_rows = 8;
    const double rows = 6.0 * cell_px(scene);  // about the marker's height
    const CameraModel camera = true_camera();
    Radiance radiance(camera.height, camera.width, CV_32FC1, cv::Scalar(scene.white));
    for (int y = 0; y < camera.height; y += band_rows) {
        const double time = (y + 0.5 * (band_rows - 1) - middle_px(scene).y()) / rows;
        Rigid pose = scene.camera_from_marker;
        pose.translation += sideways(scene, time * path_px);
        RenderOptions options;
        options.region = {0, y, camera.width, std::min(band_rows, camera.height - y)};
        true_renderer()
            .render(still(scene, pose), options)
            .radiance(options.region)
            .copyTo(radiance(options.region));
    }
    return radiance;
}

// From one side of the image to the other, and a lamp's bright middle.
inline Radiance unevenly_lit(const TrueScene& scene, double least) {
    const Radiance radiance = radiance_of(scene);
    return radiance.mul(image_of(radiance.size(), [&](int x, int y) {
        const double u = 1.0 * x / radiance.cols, v = 1.0 * y / radiance.rows - 0.4;
        return (least + (1.0 - least) * u) * std::exp(-v * v / (2 * 0.6 * 0.6));
    }));
}

// ---- faults behind the sensor

inline CodeImage sharpened(const CodeImage& photo, double amount, double sigma_px) {
    cv::Mat values, blurred_values;
    photo.pixels.convertTo(values, CV_32F);
    cv::GaussianBlur(values, blurred_values, {0, 0}, sigma_px);
    CodeImage result{{}, photo.bits};
    cv::Mat(values + amount * (values - blurred_values))
        .convertTo(result.pixels, photo.pixels.type());
    return result;
}

inline CodeImage negative(const CodeImage& photo) {
    return {cv::Mat(photo.full_scale() - photo.pixels), photo.bits};
}

inline CodeImage compressed(const CodeImage& photo, int jpeg_quality) {
    std::vector<uchar> bytes;
    cv::imencode(".jpg", photo.pixels, bytes, {cv::IMWRITE_JPEG_QUALITY, jpeg_quality});
    return {cv::imdecode(bytes, cv::IMREAD_GRAYSCALE), photo.bits};
}

// The pose that corners would give, with this camera: each corner has an error of 0.05 px.
inline Rigid found_pose(const TrueScene& scene, const CameraModel& camera, int seed) {
    constexpr double error_px = 0.05;
    const Projector truth(true_camera());
    RandomStream random(91, 5, static_cast<std::uint64_t>(seed));
    std::vector<Eigen::Vector2d> pixels;
    for (const Eigen::Vector3d& point : scene.marker.points_mm) {
        const double x = random.normal(), y = random.normal();
        pixels.push_back(truth.project(scene.camera_from_marker * point).value() +
                         error_px * Eigen::Vector2d(x, y));
    }
    return estimate_pose(Projector(camera), scene.marker.points_mm, pixels)
        .value()
        .camera_from_marker;
}

// As `etalon compare` examines a photograph at a pose.
inline Findings examined(const CodeImage& photo, const TrueScene& scene, const Rigid& pose,
                         const std::shared_ptr<const PhotometricCamera>& camera) {
    const ComparedArea area = compared_area(scene.marker, {}, "test");
    const Findings before = examine_marker(photo, scene.marker, area, camera->projector(), pose);
    if (is_refused(before))
        return before;
    return examine_match(photo, scene.marker, area, *camera,
                         match_photo(photo, scene.marker.grid, area, camera, pose));
}

}  // namespace etalon::test
