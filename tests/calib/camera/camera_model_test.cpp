#include "calib/camera/camera_model.h"

#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

CameraModel webcam_with_lens(double focus_distance_mm) {
    CameraModel camera = test::webcam();
    camera.lens =
        Lens{.f_number = 2.5, .focus_distance_mm = focus_distance_mm, .wavelength_nm = 650};
    camera.sensor = Sensor{.pixel_pitch_um = 8.3};
    return camera;
}

TEST(ThinLens, SatisfiesTheLensEquation) {
    const ThinLens lens = thin_lens(webcam_with_lens(150));
    EXPECT_NEAR(lens.image_distance_mm, 538.55 * 0.0083, 1e-15);
    EXPECT_NEAR(1 / lens.focal_length_mm, 1 / 150.0 + 1 / lens.image_distance_mm, 1e-15);
    EXPECT_NEAR(lens.aperture_diameter_mm, lens.focal_length_mm / 2.5, 1e-15);
    EXPECT_NEAR(lens.working_f_number, lens.image_distance_mm / lens.aperture_diameter_mm, 1e-15);
    EXPECT_GT(lens.working_f_number, 2.5);  // bellows factor
}

TEST(ThinLens, FocusedAtInfinityHasItsSensorInTheFocalPlane) {
    const ThinLens lens = thin_lens(webcam_with_lens(std::numeric_limits<double>::infinity()));
    EXPECT_EQ(lens.inverse_focus_per_mm, 0.0);
    EXPECT_DOUBLE_EQ(lens.focal_length_mm, lens.image_distance_mm);
    EXPECT_DOUBLE_EQ(lens.working_f_number, 2.5);
}

// Similar triangles: a point at z is sharp at z' = 1 / (1/f - 1/z) behind the lens, and the cone
// from the aperture has the diameter d |z' - v| / z' where the sensor cuts it.
TEST(BlurRadius, IsTheConeFromTheApertureCutByTheSensor) {
    const CameraModel camera = webcam_with_lens(150);
    const ThinLens lens = thin_lens(camera);
    for (const double z : {90.0, 500.0, 1700.0}) {
        const double sharp = 1 / (1 / lens.focal_length_mm - 1 / z);
        const double diameter_mm =
            lens.aperture_diameter_mm * std::abs(sharp - lens.image_distance_mm) / sharp;
        EXPECT_NEAR(blur_radius_px(camera, z), diameter_mm / 2 / 0.0083, 1e-10);
    }
    EXPECT_NEAR(blur_radius_px(camera, 150), 0.0, 1e-12);
}

TEST(BlurRadius, IsZeroWithoutALensAndRefusedBehindIt) {
    EXPECT_EQ(blur_radius_px(test::webcam(), 500), 0.0);
    EXPECT_THROW(blur_radius_px(webcam_with_lens(150), 0.0), NumericalError);
    EXPECT_THROW(blur_radius_px(webcam_with_lens(150), std::nan("")), NumericalError);
}

TEST(ThinLens, RefusesLensesThatCannotExist) {
    EXPECT_THROW(thin_lens(test::webcam()), NumericalError);
    EXPECT_THROW(thin_lens(webcam_with_lens(0.0)), NumericalError);
    EXPECT_THROW(thin_lens(webcam_with_lens(std::nan(""))), NumericalError);
    CameraModel camera = webcam_with_lens(150);
    camera.lens->f_number = 0.0;
    EXPECT_THROW(thin_lens(camera), NumericalError);
}

}  // namespace
}  // namespace etalon
