// `etalon init`: what it writes is read by every command, and nothing is written over.

#include "station/devices/commands.h"
#include "tests/error_text.h"
#include "tests/station/built_program.h"
#include "tests/station/stations.h"

namespace etalon {
namespace {

using testing::HasSubstr;

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
