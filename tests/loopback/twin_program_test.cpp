// The program etalon-twin: its exit codes, its one line, and that a signal ends it in order.
#include <gtest/gtest.h>

#include <csignal>
#include <string>

#include "core/clock.h"
#include "core/text.h"
#include "mocks/gige_camera.h"
#include "tests/loopback/program.h"
#include "tests/mocks/twin_folder.h"

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
