#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "mocks/gige_camera.h"
#include "station/commands.h"

namespace etalon {
namespace {

std::string printed(bool json) {
    DevicesArguments arguments;
    arguments.json = json;
    testing::internal::CaptureStdout();
    EXPECT_EQ(run_devices(arguments), 0);
    return testing::internal::GetCapturedStdout();
}

TEST(DevicesCommand, NamesWhatIsThereAndWhatIsLeftOutAndWhy) {
    GigeCameraOptions options;
    options.serial = "SN-75";
    const GigeCamera camera(options, [](const CaptureSettings&) { return CodeImage{}; });
    const std::string table = printed(false);
    for (const char* words :
         {"genicam    yes  Aravis", "genicam:Aravis-Fake-SN-75  Aravis Fake, serial SN-75",
          "files      yes", "v4l2       ", "libcamera  ", "generic    yes  Modbus TCP"})
        EXPECT_NE(table.find(words), std::string::npos) << words << " is missing in\n" << table;
}

TEST(DevicesCommand, PrintsTheSameAsJson) {
    GigeCameraOptions options;
    options.serial = "SN-75";
    const GigeCamera camera(options, [](const CaptureSettings&) { return CodeImage{}; });
    const nlohmann::json json = nlohmann::json::parse(printed(true));
    EXPECT_EQ(json.at("etalon"), "devices/1");
    const nlohmann::json genicam = json.at("camera_backends").at(0);
    EXPECT_EQ(genicam.at("name"), "genicam");
    EXPECT_EQ(genicam.at("built_in"), true);
    EXPECT_EQ(genicam.at("cameras").at(0).at("serial"), "SN-75");
    EXPECT_EQ(json.at("stage_profiles").at(0), "generic");
}

}  // namespace
}  // namespace etalon
