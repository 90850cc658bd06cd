#include "station/setup/station_file.h"

#include <gmock/gmock.h>

#include <numbers>

#include "compare/expect/expected_view.h"
#include "core/file/sha256.h"
#include "station/setup/plan.h"
#include "tests/station/stations.h"

namespace etalon {
namespace {

using testing::EndsWith;
using testing::HasSubstr;

constexpr double deg = std::numbers::pi / 180.0;

// The message for station_text with `what` replaced by `by`; empty if it was read.
std::string fault(const std::string& what, const std::string& by) {
    const TemporaryFolder folder;
    try {
        read_station(write_station(folder, replaced(station_text, what, by)));
    } catch (const ConfigError& error) {
        return error.what();
    }
    return "";
}

TEST(StationFile, GivesWhatItSays) {
    const TemporaryFolder folder;
    const StationFile station = read_station(write_station(folder));
    EXPECT_EQ(station.id, "test-station");
    EXPECT_EQ(station.camera.uri, "genicam:127.0.0.1");
    EXPECT_EQ(station.camera.model.serial, "CAM-7");
    EXPECT_EQ(station.camera.settings.width, 320);
    EXPECT_EQ(station.camera.settings.bits, 8);
    EXPECT_EQ(station.camera.settings.exposure, std::chrono::microseconds(2000));
    EXPECT_EQ(station.camera.link.frame_timeout, std::chrono::milliseconds(900));
    EXPECT_EQ(station.camera.retries, 3);
    EXPECT_EQ(std::get<TcpAddress>(station.stage.link.address).port, 1599);
    EXPECT_EQ(station.stage.link.unit, 2);
    ASSERT_EQ(station.stage.axes.size(), 4u);
    EXPECT_EQ(station.marker.id, 5);
    EXPECT_DOUBLE_EQ(*station.marker_size_uncertainty, 50e-6);
    EXPECT_DOUBLE_EQ(*station.marker_flatness_mm, 0.004);
    ASSERT_TRUE(station.temperature);
    EXPECT_DOUBLE_EQ(station.temperature->standard_uncertainty_k, 0.3);
    EXPECT_DOUBLE_EQ(station.temperature->marker_expansion_per_k, 9e-6);
    EXPECT_DOUBLE_EQ(station.temperature->stage_expansion_per_k, 11e-6);
    EXPECT_EQ(station.limits.id, "test-limits-5");
    EXPECT_EQ(station.plan.poses, 25);
    EXPECT_EQ(station.plan.settle, std::chrono::milliseconds(40));
}

TEST(StationFile, GivesWhatElseTheCameraIsTold) {
    const TemporaryFolder folder;
    const StationFile station = read_station(
        write_station(folder, replaced(station_text, "  packet_size: 1400\n",
                                       "  format: Mono12p\n  black_level: 5\n  trigger: Line1\n"
                                       "  controls: {Gamma: 0.7, Sharpness: 0}\n"
                                       "  packet_delay_us: 3\n  interface: 192.168.7.1\n")));
    const StationCamera& camera = station.camera;
    EXPECT_EQ(camera.settings.format, "Mono12p");
    EXPECT_EQ(camera.settings.black_level, 5.0);
    EXPECT_EQ(camera.settings.trigger, "Line1");
    EXPECT_EQ(camera.settings.controls,
              (std::map<std::string, double>{{"Gamma", 0.7}, {"Sharpness", 0.0}}));
    EXPECT_EQ(camera.link.packet_delay, std::chrono::microseconds(3));
    EXPECT_EQ(camera.link.interface, "192.168.7.1");
}

TEST(StationFile, GivesWhereTheAxesMayNotGo) {
    const TemporaryFolder folder;
    const std::string rules =
        "  forbidden: [{name: lens, x: [-5, 7], rz: [0, 90]}]\n"
        "  slow_near: {margin: {y: 3}, speed_share: 0.25}\n";
    const StationFile station = read_station(write_station(
        folder, replaced(station_text, "  profile: generic\n", "  profile: generic\n" + rules)));
    ASSERT_EQ(station.stage.rules.forbidden.size(), 1u);
    EXPECT_EQ(station.stage.rules.forbidden[0].sides.at(0).high, 7.0);
    EXPECT_NEAR(station.stage.rules.forbidden[0].sides.at(3).high, 90 * deg, 1e-12);
    EXPECT_EQ(station.stage.rules.slow_margin, (std::vector<double>{0, 3, 0, 0}));
    EXPECT_THAT(fault("  profile: generic\n", "  profile: generic\n  forbidden: [{name: lens}]\n"),
                HasSubstr(":14: stage.forbidden[0]: names no axis"));
}

TEST(StationFile, TurnsDegreesIntoRadians) {
    const TemporaryFolder folder;
    const StationFile station = read_station(write_station(folder));
    EXPECT_NEAR(station.plan.volume.at(3).high, 175 * deg, 1e-12);
    EXPECT_NEAR(station.plan.volume.at(1).high, 45, 1e-12);
    const Vector6d mount = vector_from_rigid(station.carriage_from_marker_nominal);
    EXPECT_NEAR(mount[0], 20 * deg, 1e-12);
    EXPECT_NEAR(mount[4], -7, 1e-12);
}

constexpr const char* wide_camera = R"(etalon: camera/1
serial: "CAM-7"
image: {width: 320, height: 240}
projection: equidistant
intrinsics: {fx: 95.0, fy: 95.0, cx: 158.3, cy: 121.6}
distortion: {k1: 0.03, k7: -0.0002}
)";

// The marker may stand aside, where a tangent has run away, but not beyond what is rendered.
TEST(StationFile, TakesAWideLensWithAPlanThatIsRendered) {
    const TemporaryFolder folder;
    write_station(folder,
                  std::string(station_text) +
                      "camera_mount: {rotation_deg: [0, 62, 0], translation_mm: [280, 0, 120]}\n");
    write_text(folder / "camera.yml", wide_camera);
    const StationFile station = read_station(folder / "station.yaml");
    EXPECT_EQ(station.camera.model.projection.kind, Projection::equidistant);
    double widest = 0.0;
    for (const PlannedPose& pose : plan_of(station).poses) {
        const Rigid at = expected_pose(station, pose.target);
        EXPECT_TRUE(is_rendered(station.marker.grid, at, station.camera.model));
        widest = std::max(widest, std::acos(at.translation.normalized().z()));
    }
    EXPECT_GT(widest, 60.0 * deg);
    EXPECT_LT(widest, 80.0 * deg);
}

TEST(StationFile, RefusesATelecentricCamera) {
    const TemporaryFolder folder;
    write_station(folder);
    write_text(folder / "camera.yml", replaced(wide_camera, "equidistant", "telecentric"));
    try {
        read_station(folder / "station.yaml");
        ADD_FAILURE() << "accepted";
    } catch (const ConfigError& error) {
        EXPECT_THAT(error.what(), HasSubstr("a distance is not in its images"));
    }
}

TEST(StationFile, NamesItsInputsByContent) {
    const TemporaryFolder folder;
    const StationFile station = read_station(write_station(folder));
    ASSERT_EQ(station.inputs.size(), 3u);
    EXPECT_EQ(station.inputs[0].sha256, sha256(station_text));
    EXPECT_EQ(station.inputs[1].role, "calibration");
    EXPECT_EQ(station.inputs[1].sha256, sha256(camera_text));
    EXPECT_EQ(station.inputs[2].sha256, sha256(limits_text));
}

TEST(StationFile, NamesTheLineAndTheKeyOfEachFault) {
    EXPECT_THAT(fault("retries: 3", "retrys: 3"),
                EndsWith("station.yaml:10: camera.retrys: unknown key; did you mean 'retries'?"));
    EXPECT_THAT(fault("gain_db: 0", "gain_db: .nan"), HasSubstr(":7: camera.gain_db: must be a"));
    EXPECT_THAT(fault("exposure_us: 2000", "exposure_us: 0"),
                HasSubstr(":6: camera.exposure_us: must be"));
    EXPECT_THAT(fault("port: 1599", "port: 0"), HasSubstr(":12: stage.link.port: must be"));
    EXPECT_THAT(fault("  frames: 2\n", ""), HasSubstr("plan.frames: missing"));
    EXPECT_THAT(fault("  frames: 2\n", "  frames: 2\n  frames: 2\n"),
                HasSubstr("plan.frames: doubled key"));
    EXPECT_THAT(fault("id: test-station", "id: \"\""), HasSubstr(":2: id: must not be empty"));
    EXPECT_THAT(fault("calibration: camera.yml", "calibration: camara.yml"),
                HasSubstr(":5: camera.calibration: no such file: "));
    EXPECT_THAT(fault("limits: limits.yaml", "limits: nothing.yaml"),
                HasSubstr("limits: no such file: "));
    EXPECT_THAT(fault("hold_out: 0.6", "hold_out: 1.0"), HasSubstr("plan.hold_out: must be"));
    EXPECT_THAT(fault("background: 0.7", "background: 1.2"), HasSubstr("background: must be"));
}

TEST(StationFile, RefusesAVolumeThatLeavesTheSoftLimits) {
    EXPECT_THAT(
        fault("rz: [-170, 175]", "rz: [-170, 195]"),
        HasSubstr("plan.volume.rz: [-170, 195] leaves the soft limits [-190, 190] of axis rz"));
    EXPECT_THAT(fault("x: [-60, 50]", "x: [50, -60]"),
                HasSubstr("plan.volume.x: must be [low, high]"));
    EXPECT_THAT(fault("x: [-60, 50], ", ""), HasSubstr("plan.volume.x: missing"));
    EXPECT_THAT(fault("x: [-60, 50]", "x: [-60, 50], w: [1, 2]"),
                HasSubstr("plan.volume.w: unknown key"));
}

TEST(StationFile, RefusesAMarkerThatTheDetectorCannotSee) {
    EXPECT_THAT(fault("apriltag:36h11:5@60mm", "apriltag:37h11:5@60mm"),
                HasSubstr("station.yaml:19: marker: "));
    EXPECT_THAT(fault("detector: auto", "detector: aruco"),
                HasSubstr("station.yaml:31: detector: "));
}

}  // namespace
}  // namespace etalon
