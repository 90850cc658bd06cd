#include "mocks/twin/twin_file.h"

#include "tests/mocks/twin/twin_folder.h"

namespace etalon {
namespace {

TEST(TwinFile, IsReadWithItsUnitsConverted) {
    const TwinFolder folder;
    folder.write("twin.yaml", TwinFolder::twin_yaml());
    const TwinFile twin = read_twin_file(folder.file("twin.yaml"));
    EXPECT_EQ(twin.seed, 7u);
    EXPECT_EQ(twin.stage.port, 0);
    ASSERT_EQ(twin.stage.options.errors.size(), 2u);
    EXPECT_NEAR(twin.stage.options.errors[0].scale, 0.002, 1e-15);
    EXPECT_NEAR(twin.stage.options.errors[0].backlash, 0.05, 1e-15);
    EXPECT_EQ(twin.nominal_exposure, std::chrono::microseconds(5000));
    EXPECT_EQ(twin.method, RenderMethod::automatic);
    EXPECT_EQ(twin.packet_loss, 0.0);
    EXPECT_NEAR(twin.true_camera.intrinsics.fx, 190 * 1.005, 1e-12);
    EXPECT_EQ(twin.true_camera.serial, "TWIN-7");
    EXPECT_EQ(twin.scene.background, 0.6);
    EXPECT_EQ(twin.scene.camera_from_base.translation, Eigen::Vector3d(2, -3, 300));
    const Eigen::Vector3d turn =
        rotation_vector(twin.scene.carriage_from_marker.rotation) / rad_per_deg;
    EXPECT_LT((turn - Eigen::Vector3d(9, -14, 1.5)).norm(), 1e-12);
}

TEST(TwinFile, TakesTheReferenceIntegratorWhenAsked) {
    const TwinFolder folder;
    folder.write("twin.yaml", twin_yaml_with("nominal_exposure_us: 5000",
                                             "nominal_exposure_us: 5000\n  method: reference\n"
                                             "  packet_loss: 0.25"));
    const TwinFile twin = read_twin_file(folder.file("twin.yaml"));
    EXPECT_EQ(twin.method, RenderMethod::reference);
    EXPECT_EQ(twin.packet_loss, 0.25);
}

TEST(TwinFile, TakesAWideLens) {
    const TwinFolder folder;
    folder.write("camera.yml", R"(etalon: camera/1
image: {width: 160, height: 120}
projection: equidistant
intrinsics: {fx: 46, fy: 45, cx: 81.5, cy: 57.25}
distortion: {k1: 0.03, k7: -0.0002}
)");
    folder.write("twin.yaml", twin_yaml_with("focal_length_percent: 0.5", "k1_percent: 10"));
    const CameraModel camera = read_twin_file(folder.file("twin.yaml")).true_camera;
    EXPECT_EQ(camera.projection.kind, Projection::equidistant);
    EXPECT_NEAR(camera.distortion.k1, 0.033, 1e-15);
    EXPECT_EQ(camera.distortion.k7, -0.0002);
}

// Each case: a part of the file, what stands there instead, and the key that the error must name.
TEST(TwinFile, NamesTheKeyOfEveryMistake) {
    struct Case {
        std::string part, instead, key;
    };
    const std::vector<Case> cases{
        {"etalon: twin/1", "etalon: station/1", "etalon"},
        {"seed: 7", "seed: -7", "seed"},
        {"seed: 7", "", "seed"},
        {"port: 0", "port: 70000", "stage.port"},
        {"x: {scale_ppm: 2000", "y: {scale_ppm: 2000", "stage.errors.y"},
        {"backlash_um: 50", "backlash_deg: 50", "stage.errors.x.backlash_deg"},
        {"backlash_um: 50", "repeatability_um: -1", "stage.errors.x.repeatability_um"},
        {"calibration: camera.yml", "calibration: missing.yml", "missing.yml"},
        {"focal_length_percent: 0.5", "focal_percent: 0.5", "camera.errors.focal_percent"},
        {"focal_length_percent: 0.5", "focal_length_percent: .nan", "focal_length_percent"},
        {"focal_length_percent: 0.5", "principal_point_px: [1]", "principal_point_px"},
        {"nominal_exposure_us: 5000", "nominal_exposure_us: 0", "camera.nominal_exposure_us"},
        {"nominal_exposure_us: 5000", "nominal_exposure_us: 5000\n  method: E", "camera.method"},
        {"nominal_exposure_us: 5000", "nominal_exposure_us: 5000\n  packet_loss: 2",
         "camera.packet_loss"},
        {"36h11", "36h12", "scene.marker"},
        {"background: 0.6", "background: 60", "scene.background"},
        {"[2, -3, 300]", "[2, -3]", "scene.camera_from_base.translation_mm"},
        {"background: 0.6", "background: 0.6\n  background: 0.6", "scene.background"}};
    const TwinFolder folder;
    for (const Case& wrong : cases) {
        folder.write("twin.yaml", twin_yaml_with(wrong.part, wrong.instead));
        EXPECT_THAT(config_error_of([&] { read_twin_file(folder.file("twin.yaml")); }),
                    HasSubstr(wrong.key))
            << wrong.instead;
    }
}

TEST(TwinFile, RefusesAnErrorOfK1ThatWouldDoNothing) {
    const TwinFolder folder;
    folder.write("camera.yml",
                 "etalon: camera/1\nimage: {width: 160, height: 120}\n"
                 "intrinsics: {fx: 190, fy: 187, cx: 81.5, cy: 57.25}\n");
    folder.write("twin.yaml", twin_yaml_with("focal_length_percent: 0.5", "k1_percent: 10"));
    EXPECT_THROW(read_twin_file(folder.file("twin.yaml")), ConfigError);
}

}  // namespace
}  // namespace etalon
