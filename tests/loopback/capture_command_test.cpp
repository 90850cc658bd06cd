// `etalon capture` as its user sees it, with a GigE Vision camera on loopback.
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "core/text.h"
#include "tests/loopback/gige_rig.h"
#include "tests/loopback/program.h"
#include "tests/temporary_folder.h"

namespace etalon {
namespace {

using testing::HasSubstr;

GigeCameraOptions options_of_12_bits() {
    GigeCameraOptions options;
    options.width = 68;
    options.height = 41;
    options.bits = 12;
    return options;
}

std::string rest_of(Program& program) {
    std::string text, line;
    while (!(line = program.line()).empty())
        text += line + "\n";
    return text;
}

TEST(CaptureCommand, RecordsFramesOfACameraWithItsSettings) {
    GigeRig rig(options_of_12_bits());
    TemporaryFolder folder;
    const std::string out = (folder / "record").string();
    Program program("etalon",
                    {"capture", "--camera", "genicam:127.0.0.1", "--format", "Mono12p",
                     "--exposure-us", "7000", "--gain-db", "3", "--black-level", "5", "--set",
                     "AcquisitionFrameRate=40", "--frames", "6", "--out", out, "--live"});
    const std::string printed = rest_of(program);
    EXPECT_EQ(program.exit_code(), 0) << printed;
    EXPECT_THAT(printed, HasSubstr("captured 6 frames\nnoise 0.000 DN\nrecord " + out));
    EXPECT_THAT(printed, HasSubstr("fps  mean"));
    const auto record = nlohmann::json::parse(read_text(out + "/capture.json"));
    const auto& settings = record["camera"]["settings"];
    EXPECT_EQ(settings["format"], "Mono12p");
    EXPECT_EQ(settings["bits"], 12);
    EXPECT_EQ(settings["exposure_us"], 7000);
    EXPECT_EQ(settings["gain_db"], 3.0);
    EXPECT_EQ(settings["black_level"], 5.0);
    EXPECT_EQ(settings["trigger"], "Software");
    EXPECT_EQ(settings["controls"]["AcquisitionFrameRate"], 40.0);
    EXPECT_EQ(record["camera"]["serial"], "TWIN");
    EXPECT_TRUE(same(read_image(out + "/frames/000005.png").pixels, rig.shown().pixels));
}

TEST(CaptureCommand, ShowsFramesLiveUntilItIsInterrupted) {
    GigeRig rig(options_of_12_bits());
    Program program("etalon", {"capture", "--camera", "genicam:127.0.0.1", "--live"});
    std::string line = program.line();
    while (line.find("fps") == std::string::npos && !line.empty())
        line = program.line();
    EXPECT_THAT(line, HasSubstr("mean"));
    program.send(SIGINT);
    const std::string rest = rest_of(program);
    EXPECT_THAT(rest, HasSubstr("captured "));
    EXPECT_EQ(program.exit_code(), 0) << rest;
}

TEST(CaptureCommand, EndsWithFourWhenTheCameraRefuses) {
    GigeRig rig(options_of_12_bits());
    TemporaryFolder folder;
    Program program("etalon", {"capture", "--camera", "genicam:127.0.0.1", "--gain-db", "11",
                               "--frames", "2", "--out", (folder / "record").string()});
    EXPECT_THAT(rest_of(program), HasSubstr("set gain 11 dB"));
    EXPECT_EQ(program.exit_code(), 4);
}

}  // namespace
}  // namespace etalon
