// Photographs of a tag by a camera that differs from its calibration, with its sensor's noise, and
// what their pixels tell: shared by photo_findings_statistics_test.cpp and
// tests/evidence/causes.cpp.
#pragma once

#include <numeric>

#include "compare/diagnosis/image_agreement.h"
#include "compare/match/pixel_measurement.h"
#include "compare/photometric/photometric_model.h"
#include "sim/render/renderer.h"
#include "tests/calib/cameras.h"

namespace etalon::test {

inline constexpr double stated_background = 0.55;

inline CameraModel photographed_calibration() {
    return camera_with(
        320, 240, {430.0, 432.0, 157.2, 121.7}, {.k1 = -0.11},
        Sensor{.pixel_pitch_um = 5.0, .black_dn = 9.0, .gain_e_per_dn = 40.0, .read_noise_e = 8.0},
        Lens{1.6, 1100.0, 550.0, {}});
}

inline const Marker& photographed_tag() {
    static const Marker marker = parse_marker("apriltag:36h11:7@60mm", "test");
    return marker;
}

// 14 depths from 250 to 510 mm, tilted and turned.
inline Rigid photographed_pose(std::size_t i) {
    const double angle = 2.4 * static_cast<double>(i);
    const Eigen::Quaterniond turned =
        rotation_from_vector({0.35 * std::cos(angle), 0.35 * std::sin(angle), 0.0}) *
        rotation_from_vector({0.0, 0.0, 0.7 * static_cast<double>(i)});
    const Eigen::Vector3d middle{9.0 * std::sin(angle), 7.0 * std::cos(angle),
                                 250.0 + 20.0 * static_cast<double>(i)};
    const CellGrid& grid = photographed_tag().grid;
    return {turned, middle - turned * grid.point_mm(0.5 * grid.columns(), 0.5 * grid.rows())};
}

// What is truly before the station, whose calibration is photographed_calibration().
struct PhotographedTruth {
    CameraModel camera = photographed_calibration();
    double background = stated_background;
    double blur_px2 = 0.0;  // variance of a further blur
};

// Of 14 photographs. Some 0.5 s of CPU, 2 s where a tone curve or a focus has to be found.
inline ImageAgreement photographed(const PhotographedTruth& truth, std::uint64_t seed,
                                   RenderMethod method = RenderMethod::automatic) {
    constexpr double white_level = 0.8;
    constexpr std::size_t photos = 14;
    constexpr int reference_samples = 256;
    const CameraModel camera = photographed_calibration();
    const PhotometricDetector detector(camera, photographed_tag(), "test", stated_background);
    const Renderer renderer(truth.camera);
    const SensorModel sensor(truth.camera);
    std::vector<PhotoOfMarker> seen;
    for (std::size_t i = 0; i < photos; ++i) {
        CellGrid grid = photographed_tag().grid;
        grid.cells = cv::Mat(grid.cells * white_level);
        RenderedImage image = renderer.render(
            {{{grid, photographed_pose(i)}}, truth.background * white_level},
            {.method = method, .tolerance_gray = 0.05, .reference_samples = reference_samples});
        image.radiance = blurred(image.radiance, std::sqrt(truth.blur_px2));
        const CodeImage photo =
            sensor.expose(image.radiance, NoiseKey{seed, static_cast<std::uint32_t>(i)});
        seen.push_back(detector.photo_at(gray_of(photo), photographed_pose(i)));
    }
    const ComparedArea whole = compared_area(photographed_tag(), {}, "test");
    const auto measure = [&](const PixelDeviation& deviating, std::span<const std::size_t> which,
                             std::optional<double> noise_scale) {
        const DeviatingCamera there(camera, deviating);
        std::vector<PhotoEvidence> all;
        for (const std::size_t i : which)
            all.push_back(there.measure(seen[i], photographed_pose(i), whole, noise_scale));
        return all;
    };
    std::vector<std::size_t> every(photos);
    std::iota(every.begin(), every.end(), std::size_t{0});
    RunEvidence pixels =
        settled_pixels(camera, measure(PixelDeviation::Zero(), every, std::nullopt), measure);
    pixels.findings.resize(photos);
    return match_pixels(pixels, camera);
}

}  // namespace etalon::test
