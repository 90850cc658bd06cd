// What `etalon devices`, `etalon stage` and `etalon init` print, write and are told.
#include "station/devices/commands.h"

#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/station/built_program.h"
#include "tests/station/stations.h"

namespace etalon {
namespace {

FrameSizes size(int width, int height) {
    return {{width, height}, {width, height}};
}

// A webcam with more to tell than fits into a line.
ListedBackend webcam() {
    ListedCamera camera;
    camera.identity = {R"(v4l2:usb-0000:00:14.0-3)", "uvcvideo", "HD Pro Webcam with a long name",
                       ""};
    CameraFormat plain{"GREY", "8-bit Greyscale", 8, {size(640, 480)}};
    for (int i = 1; i <= 7; ++i)
        plain.sizes.push_back(size(160 * i, 90 * i));
    camera.abilities.formats = {plain,
                                {"Y10", "10-bit Greyscale", 10, {{{16, 16}, {640, 480}, {8, 8}}}},
                                {"H264", "H.264", 0, {size(640, 480)}},
                                {"NM12", "two planes", 0, {size(640, 480)}}};
    CameraControl exposure{"Exposure Time, Absolute", "157", "", 1, 1e7, 1, {}, false};
    CameraControl white{"White Balance Temperature", "4600", "K", 2800, 6500, 5, {}, true};
    CameraControl gain{"Gain", "0.5", "dB", 0.25, 1.0, std::nullopt, {}, false};
    CameraControl mode{
        "Auto Exposure",
        "Aperture Priority Mode",
        "",
        {},
        {},
        {},
        {"Auto Mode", "Manual Mode", "Shutter Priority Mode", "Aperture Priority Mode"},
        false};
    camera.abilities.controls = {exposure, white, gain, mode};
    return {{"v4l2", true, "Linux video drivers", {}}, {camera}};
}

TEST(DevicesTable, FitsATerminalAndKeepsItsColumns) {
    EXPECT_EQ(devices_table({webcam()}, {"generic", "leadshine-icl-rs"}), R"(cameras
  v4l2              yes  Linux video drivers
      v4l2:usb-0000:00:14.0-3
        uvcvideo HD Pro Webcam with a long name, serial unknown
        formats
          GREY  8 bits   640x480, 160x90, 320x180, 480x270, 640x360, 800x450,
                         960x540, 1120x630
          Y10   10 bits  16x16 to 640x480
          cannot be unpacked: H264, NM12
        controls
          Exposure Time, Absolute    157                     1 to 10000000
          White Balance Temperature  4600 K                  2800 to 6500, steps 5,
                                                             read only
          Gain                       0.5 dB                  0.25 to 1
          Auto Exposure              Aperture Priority Mode  Auto Mode,
                                                             Manual Mode,
                                                             Shutter Priority Mode,
                                                             Aperture Priority Mode
stages
  generic           yes  Modbus TCP
  leadshine-icl-rs  yes  Modbus TCP
)");
}

TEST(DevicesTable, SaysWhyABackendIsLeftOutAndACameraTellsNothing) {
    ListedCamera taken;
    taken.identity = {"genicam:Maker-7", "Maker", "M1", "SN-7"};
    taken.fault =
        "camera genicam:Maker-7: open: it is controlled by another program, which somebody "
        "has to end";
    const ListedBackend genicam{{"genicam", true, "Aravis 0.8.26", {}}, {taken}};
    const ListedBackend none{{"v4l2", true, "Linux video drivers", {}}, {}};
    const ListedBackend left_out{
        {"libcamera",
         false,
         "left out: libcamera was not found when this program was configured and built",
         {}},
        {}};
    EXPECT_EQ(devices_table({genicam, none, left_out}, {}), R"(cameras
  genicam    yes  Aravis 0.8.26
      genicam:Maker-7  Maker M1, serial SN-7
        camera genicam:Maker-7: open: it is controlled by another program,
        which somebody has to end
  v4l2       yes  Linux video drivers
      no camera answers
  libcamera  no   left out: libcamera was not found when this program was
                  configured and built
stages
)");
}

constexpr double rad_per_deg = std::numbers::pi / 180.0;

std::vector<Axis> two_axes() {
    return {{.name = "x", .low = -7.0, .high = 70.0, .speed = 20.0},
            {.name = "rz", .kind = Axis::Kind::rotary, .low = -1.0, .high = 2.0, .speed = 2.0}};
}

std::size_t longest_line(const std::string& text) {
    std::size_t longest = 0;
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);)
        longest = std::max(longest, line.size());
    return longest;
}

TEST(StageText, TellsTheWorstOfAnAxisFirst) {
    const StageProfile profile = builtin_stage_profile("generic");
    AxisStatus x{.enabled = true, .homed = true, .in_position = true, .position = 7.12345};
    AxisStatus rz{.homing = true, .emergency_stop = true};
    rz.alarm = 3;
    rz.position = -0.5 * rad_per_deg;
    const std::string text = stage_status_text(two_axes(), std::vector{x, rz}, profile);
    EXPECT_TRUE(has(text, "x             7.1234 mm   enabled, homed, in position\n") ||
                has(text, "x             7.1235 mm   enabled, homed, in position\n"))
        << text;
    EXPECT_TRUE(has(text, "rz           -0.5000 deg  EMERGENCY STOP, alarm 3 (watchdog expired"));
    EXPECT_TRUE(has(text, "off, not homed, homing"));
    EXPECT_LE(longest_line(text), 79U);
}

TEST(StageText, IsTheSameAsJson) {
    const StageProfile profile = builtin_stage_profile("generic");
    const std::vector<AxisStatus> statuses = {{.enabled = true, .position = 7.5},
                                              {.moving = true, .position = 0.25 * rad_per_deg}};
    const auto json = nlohmann::json::parse(stage_status_json(two_axes(), statuses, profile));
    EXPECT_EQ(json["etalon"], "stage/1");
    EXPECT_EQ(json["axes"][0]["position"], 7.5);
    EXPECT_EQ(json["axes"][0]["enabled"], true);
    EXPECT_NEAR(json["axes"][1]["position"].get<double>(), 0.25, 1e-12);
    EXPECT_EQ(json["axes"][1]["unit"], "deg");
    EXPECT_EQ(json["axes"][1]["moving"], true);
}

TEST(StageText, ShowsAPathWithWhatMakesItSlow) {
    Plan plan;
    plan.poses = {{{5.0, 0.0}, false}, {{7.0, 0.5}, true}};
    plan.legs = {{{{0.0, 0.0}, {5.0, 0.0}, 1.0, std::chrono::milliseconds(250), {}}},
                 {{{5.0, 0.0}, {5.0, 0.5}, 1.0, std::chrono::milliseconds(400), {}},
                  {{5.0, 0.5}, {7.0, 0.5}, 0.2, std::chrono::milliseconds(1500), {"lens"}}}};
    plan.expected_duration = std::chrono::seconds(7);
    const std::string text = stage_plan_text(two_axes(), plan);
    EXPECT_TRUE(has(text, "   1   0.2s  100 %  x=5.000\n")) << text;
    EXPECT_TRUE(has(text, "   2   0.4s  100 %  rz=28.648\n"));
    EXPECT_TRUE(has(text, "       1.5s   20 %  x=7.000 (near lens)\n"));
    EXPECT_TRUE(has(text, "2 poses in 3 motions"));
    const auto json = nlohmann::json::parse(stage_plan_json(two_axes(), plan));
    EXPECT_EQ(json["poses"][1]["motions"][1]["near"][0], "lens");
    EXPECT_EQ(json["poses"][1]["hold_out"], true);
    EXPECT_NEAR(json["poses"][1]["target"]["rz"].get<double>(), 0.5 / rad_per_deg, 1e-12);
}

TEST(StageText, SaysWhatAProfileCannotDo) {
    StageProfile profile = builtin_stage_profile("generic");
    profile.unconfirmed = {
        "that the fourth register of each axis keeps its value over a loss of "
        "power, as an integrator wrote"};
    EXPECT_TRUE(has(stage_profile_text(profile), "the controller stops the axes 1500 ms after"));
    profile.watchdog.reset();
    const std::string text = stage_profile_text(profile);
    EXPECT_TRUE(has(text, "none: axes that move go on when this program is killed"));
    EXPECT_TRUE(has(text, "does not tell: ready, homing"));
    EXPECT_TRUE(has(text, "profile valid\n"));
    EXPECT_LE(longest_line(text), 79U);
    const auto json = nlohmann::json::parse(stage_profile_json(profile));
    EXPECT_TRUE(json["watchdog_ms"].is_null());
    EXPECT_EQ(json["unconfirmed"].size(), 1U);
}

TEST(TypedTarget, IsAbsoluteOrRelativeInMmAndDegrees) {
    const std::vector<double> from = {5.0, 0.5};
    const auto absolute = typed_target(two_axes(), {"rz=-3"}, from, false);
    EXPECT_EQ(absolute[0], 5.0);
    EXPECT_NEAR(absolute[1], -3.0 * rad_per_deg, 1e-15);
    const auto relative = typed_target(two_axes(), {"x=-0.5", "rz=+3"}, from, true);
    EXPECT_EQ(relative[0], 4.5);
    EXPECT_NEAR(relative[1], 0.5 + 3.0 * rad_per_deg, 1e-15);
}

TEST(TypedTarget, MustNameAnAxisOnceWithANumber) {
    const std::vector<double> from = {5.0, 0.5};
    for (const std::vector<std::string>& words : std::vector<std::vector<std::string>>{
             {"y=1"}, {"x"}, {"x="}, {"=1"}, {"x=nan"}, {"x=1mm"}, {"x=1", "x=2"}, {"x=+-1"}})
        EXPECT_THROW(typed_target(two_axes(), words, from, false), ConfigError) << words[0];
}

TEST(StationTemplate, IsAStationThatIsRead) {
    const TemporaryFolder folder;
    write_text(folder / "camera.yml", camera_text);
    write_text(folder / "limits.yaml", drafted_limits());
    StationTemplate draft;
    draft.stage = "192.0.2.7:1502";
    draft.axes = {"z", "rx"};
    write_text(folder / "station.yaml", drafted_station(draft));
    const StationFile station = read_station(folder / "station.yaml");
    EXPECT_EQ(describe(station.stage.link), "192.0.2.7:1502");
    ASSERT_EQ(station.stage.axes.size(), 2u);
    EXPECT_EQ(station.stage.axes[1].direction, Eigen::Vector3d::UnitX());
    EXPECT_EQ(station.plan.poses, 100);
    EXPECT_EQ(station.limits.id, "limits-1");
}

TEST(StationTemplate, RefusesWhatCannotBeSaidInAFile) {
    const auto refused = [](StationTemplate draft, const char* option) {
        EXPECT_THAT(config_error_of([&] { drafted_station(draft); }), HasSubstr(option));
    };
    refused({.camera = "genicam:\"x\""}, "--camera");
    refused({.stage = "host:70000"}, "--stage");
    refused({.axes = {"x", "x"}}, "--axes");
    refused({.axes = {"w"}}, "--axes");
}

TEST(InitCommand, WritesAStationOnceAndSaysWhatIsNext) {
    const TemporaryFolder folder;
    const std::string init = "init new --camera files:. --stage /dev/ttyUSB7 --profile iai-pcon";
    const Finished first = etalon_with(folder, init + " </dev/null");
    EXPECT_EQ(first.exit_code, 0) << first.err;
    EXPECT_EQ(first.out, "station new/station.yaml\n");
    EXPECT_THAT(first.err, HasSubstr("new/camera.yml is missing: `etalon calibrate` makes it"));
    const StationStage stage = read_station_stage(folder / "new/station.yaml");
    EXPECT_EQ(describe(stage.link), "/dev/ttyUSB7");
    expect_one_line_error(etalon_with(folder, init + " </dev/null"), 3, "is there already");
}

}  // namespace
}  // namespace etalon
