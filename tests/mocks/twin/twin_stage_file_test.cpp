#include "mocks/twin/twin_file.h"
#include "sim/marker/marker.h"
#include "sim/twin/twin_physics.h"
#include "tests/calib/cameras.h"
#include "tests/mocks/twin/twin_folder.h"

namespace etalon {
namespace {

const std::string axes = R"(etalon: twin/1
port: 1507
axes:
  - {name: x, kind: linear, direction: [1, 0, 0], travel: [-30, 30], speed: 400}
  - {name: y, kind: linear, direction: [0, 1, 0], travel: [-30, 30], speed: 400}
  - {name: rz, kind: rotary, direction: [0, 0, 1], point_mm: [0, 0, 0],
     travel_deg: [-20, 20], speed_deg: 200}
)";

TwinStage read(const std::string& rest) {
    const StrictFile file = StrictFile::from_text(axes + rest, "twin.yaml", "twin/1");
    TwinStage stage = read_twin_stage(file, file.root());
    file.finish();
    return stage;
}

TEST(TwinStageFile, WithoutMoreItIsAStageWithoutErrors) {
    const TwinStage stage = read("");
    EXPECT_EQ(stage.port, 1507);
    EXPECT_EQ(stage.profile.name, "generic");
    ASSERT_EQ(stage.axes.size(), 3U);
    EXPECT_EQ(stage.options.ramp, std::chrono::milliseconds(50));
    EXPECT_EQ(stage.options.jerk.count(), 0);
    EXPECT_FALSE(stage.options.servos[1]);
    EXPECT_EQ(stage.options.errors[2].scale, 0.0);
    EXPECT_TRUE(stage.options.faults.empty() && stage.link_faults.empty());
}

TEST(TwinStageFile, ErrorsAreReadWithTheirUnitsConverted) {
    const TwinStage stage = read(R"(ramp_ms: 70
jerk_ms: 20
homing_ms: 900
temperature: {change_k: -2.5, time_constant_s: 1800}
errors:
  x: {scale_ppm: -30, repeatability_um: 3, backlash_um: 50, encoder_noise_um: 0.7,
      periodic_um: 0.8, period_mm: 2.5, phase_deg: 90, drift_um_per_k: -1.5,
      expansion_ppm_per_k: 11, lean_urad: {y: -150}}
  rz: {repeatability_deg: 0.01, periodic_deg: 0.02, period_deg: 5, encoder_noise_deg: 0.03,
       drift_deg_per_k: 0.04}
)");
    EXPECT_EQ(stage.options.ramp, std::chrono::milliseconds(70));
    EXPECT_EQ(stage.options.jerk, std::chrono::milliseconds(20));
    EXPECT_EQ(stage.options.homing, std::chrono::milliseconds(900));
    EXPECT_EQ(stage.options.temperature.change, -2.5);
    EXPECT_EQ(stage.options.temperature.time_constant, 1800.0);
    const AxisErrors& x = stage.options.errors[0];
    EXPECT_NEAR(x.scale, -30e-6, 1e-18);
    EXPECT_NEAR(x.repeatability, 0.003, 1e-15);
    EXPECT_NEAR(x.backlash, 0.05, 1e-15);
    EXPECT_NEAR(x.encoder_noise, 0.0007, 1e-15);
    EXPECT_NEAR(x.periodic, 0.0008, 1e-15);
    EXPECT_NEAR(x.period, 2.5, 1e-15);
    EXPECT_NEAR(x.phase, 90 * rad_per_deg, 1e-15);
    EXPECT_NEAR(x.drift, -0.0015, 1e-15);
    EXPECT_NEAR(x.expansion, 11e-6, 1e-18);
    ASSERT_EQ(x.lean.size(), 3U);
    EXPECT_NEAR(x.lean[1], -150e-6, 1e-18);
    EXPECT_TRUE(stage.options.errors[1].lean.empty());
    const AxisErrors& rz = stage.options.errors[2];
    EXPECT_NEAR(rz.repeatability, 0.01 * rad_per_deg, 1e-15);
    EXPECT_NEAR(rz.periodic, 0.02 * rad_per_deg, 1e-15);
    EXPECT_NEAR(rz.period, 5 * rad_per_deg, 1e-15);
    EXPECT_NEAR(rz.encoder_noise, 0.03 * rad_per_deg, 1e-15);
    EXPECT_NEAR(rz.drift, 0.04 * rad_per_deg, 1e-15);
}

TEST(TwinStageFile, AnErrorMapIsTrueAndNotAppliedTwice) {
    std::string text = axes;
    text.replace(text.find("speed: 400}"), 11,
                 "speed: 400, error_map: [[-30, 1, 0.1], [30, 7, 0.1]]}");
    const StrictFile file = StrictFile::from_text(text, "twin.yaml", "twin/1");
    const TwinStage stage = read_twin_stage(file, file.root());
    ASSERT_TRUE(stage.options.errors[0].map);
    EXPECT_NEAR(error_at(stage.options.errors[0], 15.0, 0.0), 0.0055, 1e-12);
    EXPECT_FALSE(stage.axes[0].errors || stage.options.errors[1].map);
}

// Both paths are relative to the file.
TEST(TwinStageFile, MayBeASerialLineAndOfAProfileOfItsOwn) {
    const TemporaryFolder folder;
    write_text(folder / "mine.yaml", "etalon: stage-profile/1\nname: mine\nextends: generic\n");
    std::string text = axes + "profile: mine.yaml\n";
    text.replace(text.find("port: 1507"), 10, "serial: line/stage");
    write_text(folder / "twin.yaml", text);
    const StrictFile file(folder / "twin.yaml", "twin/1");
    const TwinStage stage = read_twin_stage(file, file.root());
    EXPECT_EQ(stage.serial, folder / "line/stage");
    EXPECT_EQ(stage.profile.name, "mine");
    EXPECT_TRUE(stage.profile.watchdog);
}

TEST(TwinStageFile, ServosAreReadByAxis) {
    const TwinStage stage = read(R"(servo:
  y: {bandwidth_hz: 30, damping: 0.6, window_um: 5}
  rz: {bandwidth_hz: 20, damping: 0.7, window_deg: 0.01, drive_lag_us: 300, resonance_hz: 41,
       resonance_damping: 0.03}
)");
    EXPECT_FALSE(stage.options.servos[0]);
    const AxisServo& y = stage.options.servos[1].value();
    EXPECT_EQ(y.parameters.bandwidth_hz, 30.0);
    EXPECT_EQ(y.parameters.damping, 0.6);
    EXPECT_EQ(y.parameters.resonance_hz, 0.0);
    EXPECT_NEAR(y.window, 0.005, 1e-15);
    const AxisServo& rz = stage.options.servos[2].value();
    EXPECT_NEAR(rz.parameters.drive_lag, 300e-6, 1e-15);
    EXPECT_EQ(rz.parameters.resonance_hz, 41.0);
    EXPECT_EQ(rz.parameters.resonance_damping, 0.03);
    EXPECT_NEAR(rz.window, 0.01 * rad_per_deg, 1e-15);
}

TEST(TwinStageFile, EveryFaultHasItsName) {
    const TwinStage stage = read(R"(faults:
  - {fault: stuck_axis, axis: y, at: {move: 7}}
  - {fault: false_in_position, axis: x, at: {time_ms: 2500}}
  - {fault: encoder_jump, axis: x, at: {request: 120}, size_um: -20}
  - {fault: encoder_jump, axis: rz, at: {register: 200}, size_deg: 0.5}
  - {fault: limit_hit, axis: rz, at: {move: 8}}
  - {fault: alarm, axis: x, at: {move: 9}, code: 21}
  - {fault: emergency_stop, at: {move: 11}}
  - {fault: late_reply, at: {request: 13}, delay_ms: 400, requests: 3}
  - {fault: silence, at: {move: 3}}
  - {fault: exception, at: {register: 100}, code: 4}
  - {fault: garbage, at: {time_ms: 700}, carried_out: false}
  - {fault: wrong_id, at: {request: 17}}
  - {fault: half_open, at: {request: 19}}
  - {fault: slow_bytes, at: {request: 23}, delay_ms: 50}
  - {fault: reset, at: {request: 29}}
)");
    using When = FaultTrigger::When;
    const auto& faults = stage.options.faults;
    using enum StageFault::Kind;
    const StageFault::Kind fault_kinds[] = {stuck_axis,    false_in_position, encoder_jump,
                                            encoder_jump,  limit_hit,         alarm,
                                            emergency_stop};
    ASSERT_EQ(faults.size(), 7U);
    for (std::size_t i = 0; i < 7; ++i)
        EXPECT_EQ(faults[i].kind, fault_kinds[i]) << i;
    EXPECT_EQ(faults[0].axis, 1U);
    EXPECT_EQ(faults[0].at.when, When::move);
    EXPECT_EQ(faults[0].at.value, 7);
    EXPECT_EQ(faults[1].at.when, When::time_ms);
    EXPECT_EQ(faults[1].at.value, 2500);
    EXPECT_EQ(faults[2].at.when, When::request);
    EXPECT_NEAR(faults[2].size, -0.02, 1e-15);
    EXPECT_EQ(faults[3].at.when, When::write_to);
    EXPECT_EQ(faults[3].at.value, 200);
    EXPECT_NEAR(faults[3].size, 0.5 * rad_per_deg, 1e-15);
    EXPECT_EQ(faults[5].code, 21);

    using Kind = ModbusFault::Kind;
    ASSERT_EQ(stage.link_faults.size(), 8U);
    const Kind kinds[] = {Kind::late_reply, Kind::silence,   Kind::exception,  Kind::garbage,
                          Kind::wrong_id,   Kind::half_open, Kind::slow_bytes, Kind::reset};
    for (std::size_t i = 0; i < 8; ++i)
        EXPECT_EQ(stage.link_faults[i].kind, kinds[i]) << i;
    EXPECT_EQ(stage.link_faults[0].delay, std::chrono::milliseconds(400));
    EXPECT_EQ(stage.link_faults[0].requests, 3);
    EXPECT_EQ(stage.link_faults[1].requests, 1);
    EXPECT_EQ(stage.link_faults[2].code, 4);
    EXPECT_TRUE(stage.link_faults[1].carried_out);
    EXPECT_FALSE(stage.link_faults[3].carried_out);
    EXPECT_EQ(stage.link_faults[6].delay, std::chrono::milliseconds(50));
    EXPECT_EQ(stage.link_faults[7].at.value, 29);
}

// Each case: what stands in the file, and what the error must name.
TEST(TwinStageFile, NamesTheKeyOfEveryMistake) {
    const std::pair<std::string, std::string> cases[] = {
        {"profile: nobody", "profile"},
        {"serial: line", "serial"},  // beside a port
        {"ramp_ms: 0", "ramp_ms"},
        {"jerk_ms: -1", "jerk_ms"},
        {"temperature: {change_k: 2}", "temperature.time_constant_s"},
        {"temperature: {change_k: 2, time_constant_s: 0}", "temperature.time_constant_s"},
        {"errors: {z: {scale_ppm: 1}}", "errors.z"},
        {"errors: {x: {backlash_um: -1}}", "errors.x.backlash_um"},
        {"errors: {x: {backlash_deg: 1}}", "errors.x.backlash_deg"},
        {"errors: {x: {periodic_um: 1}}", "errors.x.period_mm"},
        {"errors: {x: {period_mm: 1}}", "errors.x.period_mm"},
        {"errors: {x: {lean_urad: {x: 1}}}", "errors.x.lean_urad.x"},
        {"errors: {x: {lean_urad: {rz: 1}}}", "errors.x.lean_urad.rz"},
        {"errors: {x: {lean_urad: {z: 1}}}", "errors.x.lean_urad.z"},
        {"servo: {x: {bandwidth_hz: 30, damping: 0.7}}", "servo.x.window_um"},
        {"servo: {x: {bandwidth_hz: 30, damping: 0, window_um: 5}}", "servo.x.damping"},
        {"servo: {x: {bandwidth_hz: 30, damping: 1, window_um: 5, resonance_hz: 9}}",
         "servo.x.resonance_damping"},
        {"servo: {z: {bandwidth_hz: 30, damping: 0.7, window_um: 5}}", "servo.z"},
        {"faults: [{fault: stuck, axis: x, at: {move: 7}}]", "faults[0].fault"},
        {"faults: [{fault: stuck_axis, axis: z, at: {move: 7}}]", "faults[0].axis"},
        {"faults: [{fault: stuck_axis, at: {move: 7}}]", "faults[0].axis"},
        {"faults: [{fault: stuck_axis, axis: x}]", "faults[0].at"},
        {"faults: [{fault: stuck_axis, axis: x, at: {move: 0}}]", "faults[0].at.move"},
        {"faults: [{fault: stuck_axis, axis: x, at: {}}]", "faults[0].at"},
        {"faults: [{fault: stuck_axis, axis: x, at: {move: 7, request: 5}}]",
         "faults[0].at.request"},
        {"faults: [{fault: reset, axis: x, at: {move: 7}}]", "faults[0].axis"},
        {"faults: [{fault: reset, at: {register: 65536}}]", "faults[0].at.register"},
        {"faults: [{fault: encoder_jump, axis: x, at: {move: 7}, size_deg: 5}]",
         "faults[0].size_um"},
        {"faults: [{fault: late_reply, at: {move: 7}}]", "faults[0].delay_ms"},
        {"faults: [{fault: exception, at: {move: 7}, code: 4, carried_out: true}]",
         "faults[0].carried_out"},
        {"faults: [{fault: exception, at: {move: 7}, code: 256}]", "faults[0].code"}};
    for (const auto& [rest, key] : cases) {
        EXPECT_THAT(config_error_of([&, rest = rest] { read(rest + "\n"); }), HasSubstr(key)) << rest;
    }
}

// ---- twin file

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

// ---- twin physics

CameraModel camera_with_noise() {
    return camera_with(64, 48, {75.0, 73.0, 30.0, 25.0}, {.k1 = -0.2, .k2 = 0.05},
                       Sensor{.pixel_pitch_um = 8.3, .gain_e_per_dn = 40.0, .read_noise_e = 20.0});
}

TwinScene scene() {
    TwinScene scene;
    scene.marker = parse_marker("apriltag:36h11:5@50mm", "test").grid;
    scene.background = 0.6;
    scene.camera_from_base.translation = {7.0, -5.0, 300.0};
    return scene;
}

Rigid moved(double x, double y, double z) {
    return {Eigen::Quaterniond::Identity(), {x, y, z}};
}

TEST(TwinPhysics, PutsErrorsIntoTheParametersTheyName) {
    const CameraModel camera = with_errors(
        camera_with_noise(),
        {.focal_length_percent = 0.5, .k1_percent = 10.0, .principal_point_px = {0.7, -0.3}});
    EXPECT_NEAR(camera.intrinsics.fx, 75.375, 1e-12);
    EXPECT_NEAR(camera.intrinsics.fy, 73.365, 1e-12);
    EXPECT_NEAR(camera.intrinsics.cx, 30.7, 1e-12);
    EXPECT_NEAR(camera.intrinsics.cy, 24.7, 1e-12);
    EXPECT_NEAR(camera.distortion.k1, -0.22, 1e-12);
    EXPECT_EQ(camera.distortion.k2, 0.05);
}

TEST(TwinPhysics, ChainsCameraBaseCarriageAndMarker) {
    const TwinPhysics physics(camera_with_noise(), scene(), RenderMethod::automatic, 7);
    Scene expected{{{scene().marker, moved(7.0 - 12.0, -5.0 + 4.0, 330.0)}}, 0.6};
    const Radiance rendered = Renderer(camera_with_noise()).render(expected).radiance;
    const Radiance shown = physics.radiance(moved(-12.0, 4.0, 30.0));
    EXPECT_LT(cv::norm(shown, rendered, cv::NORM_INF), 1e-6);
    EXPECT_GT(cv::norm(shown, physics.radiance(moved(0, 0, 0)), cv::NORM_INF), 0.3);
}

TEST(TwinPhysics, ShowsBackgroundWhereTheMarkerCannotBeRenderedOrSeen) {
    const TwinPhysics physics(camera_with_noise(), scene(), RenderMethod::automatic, 7);
    for (const Rigid& away : {moved(0, 0, -300), moved(0, 0, -400), moved(5000, 0, 0)}) {
        const Radiance shown = physics.radiance(away);
        ASSERT_EQ(shown.size(), cv::Size(64, 48));
        EXPECT_LT(cv::norm(shown, cv::Mat(48, 64, CV_32FC1, cv::Scalar(0.6f)), cv::NORM_INF), 1e-5);
    }
}

TEST(TwinPhysics, MakesTheSameNoiseOfTheSameSeedAndFrameOnly) {
    const TwinPhysics physics(camera_with_noise(), scene(), RenderMethod::automatic, 7);
    const TwinPhysics other_seed(camera_with_noise(), scene(), RenderMethod::automatic, 8);
    const Radiance light(48, 64, CV_32FC1, cv::Scalar(0.6f));
    const auto differ = [](const CodeImage& a, const CodeImage& b) {
        return cv::norm(a.pixels, b.pixels, cv::NORM_INF) > 0.0;
    };
    const CodeImage frame = physics.expose(light, 1.0, 3);
    EXPECT_FALSE(differ(frame, physics.expose(light, 1.0, 3)));
    EXPECT_TRUE(differ(frame, physics.expose(light, 1.0, 4)));
    EXPECT_TRUE(differ(frame, other_seed.expose(light, 1.0, 3)));
}

TEST(TwinPhysics, ExposesInProportionAndSaturates) {
    CameraModel camera = camera_with_noise();
    camera.sensor->gain_e_per_dn = camera.sensor->read_noise_e = 0.0;
    const TwinPhysics physics(camera, scene(), RenderMethod::automatic, 7);
    const Radiance light(48, 64, CV_32FC1, cv::Scalar(0.4f));
    EXPECT_EQ(physics.expose(light, 1.0, 0).pixels.at<std::uint8_t>(7, 5), 102);
    EXPECT_EQ(physics.expose(light, 2.0, 0).pixels.at<std::uint8_t>(7, 5), 204);
    EXPECT_EQ(physics.expose(light, 3.0, 0).pixels.at<std::uint8_t>(7, 5), 255);
    EXPECT_EQ(physics.expose(light, 0.0, 0).pixels.at<std::uint8_t>(7, 5), 0);
}

}  // namespace
}  // namespace etalon
