// Truth: tags rendered exactly at known poses; vertices where the projector puts them. The same at
// full size: tests/evidence/topotag.cpp.

#include "core/statistics/distributions.h"
#include "tests/compare/rendered_tags.h"
#include "tests/evidence/topotag_study.h"
#include "tests/test.h"

namespace etalon {
namespace {

using test::sharp_camera;

TEST(TopotagDetector, FindsTheVerticesRowByRowInEveryFamily) {
    for (const char* name : {"3x3:70", "4x4:9283", "5x5:7654321", "6x6:1122334455", "3x3-circle:93",
                             "4x4-circle:16383", "5x5-circle:0", "6x6-circle:7"}) {
        const Marker tag = parse_marker(fmt::format("topotag:{}@70mm", name), "test");
        const auto photo = test::render_tag(sharp_camera(), tag, {0.3, -0.2, 2.1, 10, -7, 350});
        EXPECT_LT(test::detection_error_px(tag, photo.image, photo.corners), 0.05) << name;
    }
}

struct Tally {
    int found = 0;
    std::vector<double> errors;
};

Tally study(const CameraModel& camera, const std::string& family, int count, double near_mm,
            double far_mm, double tilt_deg) {
    const Renderer renderer(camera);
    const SensorModel sensor(camera);
    const Projector projector(camera);
    Tally tally;
    for (int i = 0; i < count; ++i) {
        test::Draw draw(1, static_cast<std::uint64_t>(i));
        const Marker tag = test::Distraction::random_tag(draw, family, 50.0);
        const test::SeenTag seen =
            test::study_pose(projector, tag, draw, near_mm, far_mm, tilt_deg);
        const Scene scene{{{tag.grid, seen.camera_from_marker}}, 1.0};
        const CodeImage image = sensor.expose(renderer.render(scene).radiance,
                                              NoiseKey{1, static_cast<std::uint32_t>(i)});
        const auto found = make_detector("auto", tag, "test")->detect(image).corners;
        if (!found)
            continue;
        ++tally.found;
        for (std::size_t v = 0; v < found->pixels.size(); ++v)
            tally.errors.push_back((found->pixels[v] - seen.vertices[v]).norm());
    }
    return tally;
}

// The original finds 57.65 % of the published comparison's poses (FMAC, arXiv 2601.07723). Of 50
// poses that would be 29; 40 are asked for, 45 and more are found (93 % of thousands).
TEST(TopotagDetector, FindsMoreOfThePublishedPosesThanTheOriginal) {
    const Tally tally = study(test::study_camera(), "4x4", 50, 500, 1500, 45);
    EXPECT_GE(tally.found, 40);
    EXPECT_LT(median(tally.errors), 0.05);
}

// 60 px are 50 mm at 685 mm. Defocus, noise and distortion are the camera's; with a tone curve,
// too.
TEST(TopotagDetector, PlacesVerticesToAHundredthOfAPixel) {
    for (const CameraModel& camera :
         {test::study_camera(), test::with_tone_curve(test::study_camera())}) {
        const Tally tally = study(camera, "4x4", 16, 300, 600, 50);
        EXPECT_GE(tally.found, 13);
        EXPECT_LT(median(tally.errors), 0.02);
    }
}

// The tone curve makes white grow. The baseline has an edge on its left and two dots: each must
// stay where it is.
TEST(TopotagDetector, IsNotMovedByAToneCurve) {
    CameraModel camera = test::with_tone_curve(test::study_camera());
    camera.sensor->gain_e_per_dn = camera.sensor->read_noise_e = 0.0;
    camera.distortion = {};
    const Marker tag = parse_marker("topotag:4x4:9283@50mm", "test");
    const auto photo = test::render_tag(camera, tag, {0.2, -0.1, 0.05, 3, 5, 500});
    EXPECT_LT(test::detection_error_px(tag, photo.image, photo.corners), 0.03)
        << "0.1 px if white did not grow";
}

// Twice as much light on one side of the tag as on the other.
TEST(TopotagDetector, IsNotMovedByUnevenLight) {
    const Marker tag = parse_marker("topotag:4x4:9283@50mm", "test");
    const auto photo = test::render_tag(sharp_camera(), tag, {0.2, -0.3, 0.4, 3, 5, 400});
    const auto [left, right] =
        std::ranges::minmax_element(photo.corners, {}, [](const auto& pixel) { return pixel.x(); });
    CodeImage lit{photo.image.pixels.clone(), 8};
    for (int x = 0; x < lit.pixels.cols; ++x) {
        const double share = std::clamp((x - left->x()) / (right->x() - left->x()), -0.3, 1.3);
        lit.pixels.col(x) *= 0.4 + 0.4 * share;
    }
    EXPECT_LT(test::detection_error_px(tag, lit, photo.corners), 0.05);
}

// A small share of the 100 000 images of the evidence program.
TEST(TopotagDetector, FindsNothingThatIsNotThere) {
    const CameraModel camera = test::cropped(test::study_camera(), 320, 240);
    const Renderer renderer(camera);
    const SensorModel sensor(camera);
    const test::Distraction distraction(renderer, sensor);
    for (int kind = 0; kind < test::Distraction::kinds; ++kind)
        for (std::uint64_t n = 0; n < 8; ++n) {
            const std::string& family = topotag_families()[n];
            EXPECT_TRUE(test::find_in(distraction.picture(kind, n, family), family).empty())
                << test::Distraction::names[kind] << ", " << n << ", " << family;
        }
}

}  // namespace
}  // namespace etalon
