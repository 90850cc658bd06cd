// The program etalon-twin: its exit codes, its one line, and that a signal ends it in order.

#include "core/file/text.h"
#include "mocks/camera/gige_camera.h"
#include "tests/loopback/program.h"
#include "tests/mocks/twin/twin_folder.h"

namespace etalon {
namespace {

TEST(TwinProgram, SaysWhenItIsReadyAndEndsWith0OnASignal) {
    const TwinFolder folder;
    for (const int signal : {SIGTERM, SIGINT}) {
        Program twin("etalon-twin", {folder.file("twin.yaml").string(), "--seed", "11",
                                     "--ready-file", folder.file("ready").string()});
        const std::string line = twin.line();
        EXPECT_EQ(line.rfind("twin ready: stage 127.0.0.1:", 0), 0u) << line;
        EXPECT_NE(line.find(", camera 127.0.0.1 (GigE Vision)"), std::string::npos) << line;
        twin.send(signal);
        EXPECT_EQ(twin.exit_code(), 0);
        EXPECT_EQ(read_text(folder.file("ready")), line + "\n");
    }
}

// A vendor's profile on a serial line: one unit for each axis.
TEST(TwinProgram, OffersAControllerOnASerialLine) {
    const TwinFolder folder;
    std::string text = twin_yaml_with("  port: 0\n", "  serial: line\n  profile: iai-pcon\n");
    text.replace(text.find("speed: 400}"), 11, "speed: 400, unit: 3}");
    text.replace(text.find("speed_deg: 200}"), 15, "speed_deg: 200, unit: 5}");
    folder.write("twin.yaml", text);
    const std::string line = folder.file("line").string();
    folder.write("station.yaml", "etalon: station/1\nstage:\n  link: {device: " + line + R"(}
  profile: iai-pcon
  axes:
    - {name: x, kind: linear, direction: [1, 0, 0], travel: [-30, 30], speed: 400, unit: 3}
    - {name: rz, kind: rotary, direction: [0, 0, 1], point_mm: [0, 0, 0],
       travel_deg: [-20, 20], speed_deg: 200, unit: 5}
)");
    Program twin("etalon-twin", {folder.file("twin.yaml").string()});
    const std::string ready = twin.line();
    EXPECT_EQ(ready.rfind("twin ready: stage " + line + ", camera ", 0), 0u) << ready;

    const std::string station = folder.file("station.yaml").string();
    Program status("etalon", {"stage", "status", station});
    const std::string printed = status.rest();
    EXPECT_EQ(status.exit_code(), 0);
    EXPECT_NE(printed.find("0.0000 mm"), std::string::npos) << printed;
    EXPECT_EQ(Program("etalon", {"stage", "home", station, "--yes"}).exit_code(), 0);
    Program move("etalon", {"stage", "move", station, "x=7.5", "rz=-3"});
    const std::string moved = move.rest();
    EXPECT_EQ(move.exit_code(), 0);
    EXPECT_NE(moved.find("7.5000 mm"), std::string::npos) << moved;
    twin.send(SIGTERM);
    EXPECT_EQ(twin.exit_code(), 0);
    EXPECT_FALSE(std::filesystem::is_symlink(line));
}

TEST(TwinProgram, EndsWith3AndTheLineOfAMistakeInItsFile) {
    const TwinFolder folder;
    folder.write("twin.yaml", twin_yaml_with("background: 0.6", "background: 1.6"));
    Program twin("etalon-twin", {folder.file("twin.yaml").string()});
    const std::string line = twin.line();
    EXPECT_NE(line.find("twin.yaml:17: scene.background"), std::string::npos) << line;
    EXPECT_EQ(twin.exit_code(), 3);
}

TEST(TwinProgram, EndsWith3OnAWrongCommandLine) {
    EXPECT_EQ(Program("etalon-twin", {}).exit_code(), 3);
    EXPECT_EQ(Program("etalon-twin", {"twin.yaml", "--speed", "3"}).exit_code(), 3);
    EXPECT_EQ(Program("etalon-twin", {"missing.yaml"}).exit_code(), 3);
}

TEST(TwinProgram, EndsWith4WhenTheCameraPortIsTaken) {
    const TwinFolder folder;
    const GigeCamera other({}, [](const CaptureSettings&) { return CodeImage{}; });
    Program twin("etalon-twin", {folder.file("twin.yaml").string()});
    const std::string line = twin.line();
    EXPECT_NE(line.find("127.0.0.1:3956"), std::string::npos) << line;
    EXPECT_EQ(twin.exit_code(), 4);
}

}  // namespace
}  // namespace etalon
