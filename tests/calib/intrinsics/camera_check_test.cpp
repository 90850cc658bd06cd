#include "calib/intrinsics/camera_check.h"

#include "calib/intrinsics/camera_consistency.h"
#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

using enum CameraFinding::Weight;

std::vector<std::string> about(const CameraCheck& check, CameraFinding::Weight weight) {
    std::vector<std::string> words;
    for (const CameraFinding& finding : check.findings)
        if (finding.weight == weight)
            words.push_back(finding.about);
    return words;
}

// Fields of view of pinholes whose axis lies on the line that is measured, by hand.
TEST(CameraCheck, MeasuresTheFieldOfView) {
    constexpr double degree = std::numbers::pi / 180;
    const CameraCheck wide = check_camera(camera_with(640, 480, {500, 400, 299.5, 239.5}, {}));
    EXPECT_NEAR(wide.horizontal_deg, (std::atan(300 / 500.0) + std::atan(340 / 500.0)) / degree,
                1e-9);
    const CameraCheck high = check_camera(camera_with(640, 480, {500, 400, 319.5, 259.5}, {}));
    EXPECT_NEAR(high.vertical_deg, (std::atan(260 / 400.0) + std::atan(220 / 400.0)) / degree,
                1e-9);
    EXPECT_GT(high.diagonal_deg, high.horizontal_deg);
    EXPECT_EQ(high.image_without_ray, 0.0);
    EXPECT_TRUE(std::isinf(high.margin));
    EXPECT_FALSE(high.has_fault());
}

// r (1 - r^2) has its fold at r = 1 / sqrt(3), where it is 0.3849: in the first camera the
// middle of the image is inside, its corners are not.
TEST(CameraCheck, FindsAFoldInsideTheImage) {
    CameraModel camera = camera_with(641, 401, {700, 700, 320, 200}, {.k1 = -1.0});
    const CameraCheck folded = check_camera(camera);
    EXPECT_TRUE(folded.has_fault());
    EXPECT_GT(folded.image_without_ray, 0.0);
    EXPECT_LT(folded.image_without_ray, 0.5);
    EXPECT_THAT(about(folded, fault), ElementsAre("valid region"));
    camera.intrinsics.fx = camera.intrinsics.fy = 1400;
    EXPECT_FALSE(check_camera(camera).has_fault());
    // The corner, 377.9 px from the centre, at 0.98 of the fold's distorted radius.
    camera.intrinsics.fx = camera.intrinsics.fy = 377.9 / (0.98 * 0.3849);
    const CameraCheck near = check_camera(camera);
    EXPECT_FALSE(near.has_fault());
    EXPECT_GT(near.margin, 1.0);
    EXPECT_THAT(about(near, warning), Not(Contains("principal point")));
}

// 95 degrees to each side, along x; the corners lie beyond 180 degrees.
TEST(CameraCheck, LooksAtAFisheyeLensToo) {
    constexpr double degree = std::numbers::pi / 180;
    CameraModel camera =
        camera_with(1000, 1000, {500.0 / (95 * degree), 500.0 / (95 * degree), 499.5, 499.5}, {});
    camera.projection.kind = Projection::equidistant;
    const CameraCheck check = check_camera(camera);
    EXPECT_NEAR(check.horizontal_deg, 190.0, 1e-9);
    EXPECT_NEAR(check.diagonal_deg, 190.0 * std::sqrt(2.0), 1e-9);
    EXPECT_FALSE(check.has_fault());
    camera.intrinsics.fx = camera.intrinsics.fy = 500.0 / (175 * degree);
    const CameraCheck circle = check_camera(camera);
    EXPECT_FALSE(circle.has_fault());
    EXPECT_THAT(about(circle, note), Contains("valid region"));
    EXPECT_TRUE(std::isnan(circle.diagonal_deg));
    camera.distortion.k1 = -0.2;  // theta (1 - 0.2 theta^2) folds at 1.29 rad
    EXPECT_TRUE(check_camera(camera).has_fault());
}

TEST(CameraCheck, TheMarginIsTheRatioOfRadii) {
    // The corner is 400 px from the centre: r (1 - 0.1 r^2) = 0.5 there. The fold: sqrt(10 / 3).
    const CameraModel camera = camera_with(640, 480, {800, 800, 319.5, 239.5}, {.k1 = -0.1});
    double r = 0.5;
    for (int i = 0; i < 50; ++i)
        r = 0.5 + 0.1 * r * r * r;
    EXPECT_NEAR(check_camera(camera).margin, std::sqrt(10.0 / 3.0) / r, 1e-6);
}

CameraModel webcam_with(const Sensor& sensor, const Lens& lens) {
    CameraModel camera = webcam();
    camera.sensor = sensor;
    camera.lens = lens;
    return camera;
}

TEST(CameraCheck, WarnsOfWhatIsUnusual) {
    const CameraCheck check = check_camera(camera_with(640, 480, {500, 520, 400, 239.5}, {}));
    EXPECT_THAT(about(check, warning), ElementsAre("principal point", "intrinsics"));
    const CameraModel camera =
        webcam_with(Sensor{.pixel_pitch_um = 8300}, Lens{2.8, 15000, 650, {}});
    EXPECT_THAT(about(check_camera(camera), warning), ElementsAre("lens", "sensor"));
}

// Each camera says one thing that no other part of it can agree with.
TEST(CameraCheck, WarnsOfALensAndASensorThatDoNotAgree) {
    const Sensor sensor{.pixel_pitch_um = 8.3, .gain_e_per_dn = 80.0, .read_noise_e = 12.0};
    const Lens lens{.f_number = 2.8, .focus_distance_mm = 150, .wavelength_nm = 650};
    const auto warnings = [](const CameraModel& camera) {
        return about(check_camera(camera), warning);
    };
    EXPECT_THAT(warnings(webcam_with(sensor, lens)), IsEmpty());
    const auto with_lens = [&](auto change) {
        Lens changed = lens;
        change(changed);
        return warnings(webcam_with(sensor, changed));
    };
    const auto with_sensor = [&](auto change) {
        Sensor changed = sensor;
        change(changed);
        return warnings(webcam_with(changed, lens));
    };
    // 1.22 * 0.65 um * 128 = 101 um, 12 pixels.
    EXPECT_THAT(with_lens([](Lens& l) { l.f_number = 128; }), ElementsAre("lens"));
    EXPECT_THAT(with_lens([](Lens& l) { l.f_number = 0.4; }), ElementsAre("lens"));
    // fx * pitch is 4.5 mm here: in focus at 0.5 mm it magnifies 9 times.
    EXPECT_THAT(with_lens([](Lens& l) { l.focus_distance_mm = 0.5; }), Contains("lens"));
    EXPECT_THAT(with_sensor([](Sensor& s) { s.black_dn = 70; }), ElementsAre("sensor"));
    EXPECT_THAT(with_sensor([](Sensor& s) { s.gain_e_per_dn = 80'000; }), ElementsAre("sensor"));
    EXPECT_THAT(with_sensor([](Sensor& s) { s.gain_e_per_dn = 0.08; }),
                ElementsAre("sensor", "sensor"));  // and the read noise is 60 % of 20 electrons
    EXPECT_THAT(with_sensor([](Sensor& s) { s.read_noise_e = 2000; }), ElementsAre("sensor"));
    EXPECT_THAT(with_sensor([](Sensor& s) {
                    s.illumination = {Illumination::Kind::polynomial, {-0.95, 0, 0}};
                }),
                ElementsAre("illumination"));
}

TEST(CameraCheck, LooksAtATelecentricLensToo) {
    CameraModel camera = camera_with(640, 480, {20, 20, 319.5, 239.5}, {});
    camera.projection.kind = Projection::telecentric;
    camera.sensor = Sensor{.pixel_pitch_um = 5};
    camera.lens = Lens{.focus_distance_mm = 100, .wavelength_nm = 520, .object_na = 0.005};
    // Magnification 20 px/mm * 5 um = 0.1, working f-number 0.1 / 0.01 = 10.
    const CameraCheck check = check_camera(camera);
    EXPECT_THAT(about(check, warning), IsEmpty());
    EXPECT_NEAR(check.horizontal_mm, 32.0, 1e-12);  // 640 / 20
    EXPECT_NEAR(check.vertical_mm, 24.0, 1e-12);
    EXPECT_NEAR(check.diagonal_mm, 40.0, 1e-12);
    EXPECT_EQ(check.horizontal_deg, 0.0);
    EXPECT_THAT(check.findings.front().message,
                HasSubstr("magnification 0.1000, working f-number 10.000"));
    camera.lens->object_na = 0.2;  // f/0.25
    EXPECT_THAT(about(check_camera(camera), warning), ElementsAre("lens"));
}

TEST(CameraCheck, SaysWhatTheRendererWillMiss) {
    EXPECT_THAT(about(check_camera(webcam()), note),
                ElementsAre("renderer", "renderer", "renderer"));
    EXPECT_FALSE(check_camera(webcam()).has_fault());
}

// ---- camera consistency

// Sets of views of which some were taken with another zoom, focus or camera; from points projected
// here, 0.1 px of noise each.

TEST(MixedViews, OfAnotherCameraWithTheSameFocalLengthAreFoundByItsCentre) {
    CameraModel other = calibration_truth();
    other.intrinsics.cx += 18.0;
    other.intrinsics.cy -= 11.0;
    const auto groups = camera_groups(mixed({1, 4, 6, 9}, other), image_size);
    ASSERT_EQ(groups.size(), 2u);
    EXPECT_THAT(groups[1].views, ElementsAre(1u, 4u, 6u, 9u));
}

// A board that was found in the wrong order, or corners of dirt, are no other camera: the rules for
// outliers say so.
TEST(MixedViews, AreNotThoseWithWrongCorners) {
    auto views = mixed({}, calibration_truth());
    std::swap_ranges(views[3].pixels.begin(), views[3].pixels.begin() + 9,
                     views[3].pixels.begin() + 18);
    for (const int i : {7, 20, 33})
        views[8].pixels[std::size_t(i)].x() += 9.0;
    EXPECT_EQ(camera_groups(views, image_size).size(), 1u);
}

// A board that is seen in part determines little of a camera of its own.
TEST(MixedViews, OfFewPointsAreNotToldApart) {
    auto views = mixed({}, calibration_truth());
    for (const std::size_t i : {2u, 7u}) {
        views[i].points_mm = {views[i].points_mm[0], views[i].points_mm[4], views[i].points_mm[30],
                              views[i].points_mm[50]};
        views[i].pixels = {views[i].pixels[0], views[i].pixels[4], views[i].pixels[30],
                           views[i].pixels[50]};
    }
    EXPECT_EQ(camera_groups(views, image_size).size(), 1u);
}

// Without noise there is nothing to tell a difference by.
TEST(MixedViews, ExactViewsOfOneCameraAreOneGroup) {
    EXPECT_EQ(camera_groups(synthetic_views(calibration_truth(), 8, 0.0, 1), image_size).size(),
              1u);
}

}  // namespace
}  // namespace etalon
