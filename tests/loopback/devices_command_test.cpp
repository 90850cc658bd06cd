#include <nlohmann/json.hpp>

#include "mocks/camera/gige_camera.h"
#include "station/devices/commands.h"
#include "tests/station/built_program.h"

namespace etalon {
namespace {

std::string printed(bool json) {
    const Finished done = finished([&] { return run_devices({.json = json}); });
    EXPECT_EQ(done.exit_code, 0);
    return done.out;
}

TEST(DevicesCommand, NamesWhatIsThereAndWhatIsLeftOutAndWhy) {
    const GigeCamera camera({.serial = "SN-75"},
                            [](const CaptureSettings&) { return CodeImage{}; });
    const std::string table = printed(false);
    for (const char* words :
         {"genicam           yes  Aravis", "genicam:Aravis-Fake-SN-75  Aravis Fake, serial SN-75",
          "Mono12p       12 bits  1x1 to 512x384",
          "ExposureTime          10000 us    10 to 10000000",
          "GainAuto              Off         Off, Continuous", "files             yes", "v4l2 ",
          "libcamera ", "leadshine-icl-rs  yes  Modbus TCP"})
        EXPECT_NE(table.find(words), std::string::npos) << words << " is missing in\n" << table;
    for (std::size_t begin = 0, end = 0; begin < table.size(); begin = end + 1) {
        end = table.find('\n', begin);
        EXPECT_LT(end - begin, 80u) << table.substr(begin, end - begin);
    }
}

TEST(DevicesCommand, PrintsTheSameAsJson) {
    const GigeCamera camera({.serial = "SN-75"},
                            [](const CaptureSettings&) { return CodeImage{}; });
    const nlohmann::json json = nlohmann::json::parse(printed(true));
    EXPECT_EQ(json.at("etalon"), "devices/1");
    const nlohmann::json genicam = json.at("camera_backends").at(0);
    EXPECT_EQ(genicam.at("name"), "genicam");
    EXPECT_EQ(genicam.at("built_in"), true);
    EXPECT_EQ(genicam.at("cameras").at(0).at("serial"), "SN-75");
    const nlohmann::json fake = genicam.at("cameras").at(0);
    EXPECT_EQ(fake.at("fault"), "");
    EXPECT_EQ(fake.at("formats").at(5).at("name"), "Mono12p");
    EXPECT_EQ(fake.at("formats").at(5).at("bits"), 12);
    EXPECT_EQ(fake.at("formats").at(5).at("sizes").at(0).at("largest").at(1), 384);
    bool listed = false;
    for (const nlohmann::json& control : fake.at("controls"))
        listed = listed || (control.at("name") == "BlackLevel" && control.at("high") == 255.0);
    EXPECT_TRUE(listed);
    EXPECT_EQ(json.at("stage_profiles").at(0), "generic");
}

TEST(DevicesCommand, SaysWhyACameraTellsNothingOfItself) {
    const GigeCamera camera({}, [](const CaptureSettings&) { return CodeImage{}; });
    SteadyClock clock;
    const auto user = open_camera("genicam:127.0.0.1", {}, clock);
    EXPECT_NE(printed(true).find("controlled by another program"), std::string::npos);
}

}  // namespace
}  // namespace etalon
