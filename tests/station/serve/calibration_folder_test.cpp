#include "station/serve/station_control.h"

#include "tests/station/stations.h"

namespace etalon {
namespace {

class CalibrationFolder : public testing::Test {
protected:
    CalibrationFolder() {
        write_station(folder_);  // a station and limits lie there too, and CAM-7's calibration
        write_text(folder_ / "other.yaml", replaced(camera_text, "CAM-7", "CAM-12"));
    }
    std::string refusal(const std::string& serial) const {
        return config_error_of([&] { calibration_of(folder_ / ".", serial); });
    }

    TemporaryFolder folder_;
};

TEST_F(CalibrationFolder, GivesTheFileWithTheSerialNumber) {
    EXPECT_EQ(calibration_of(folder_ / ".", "CAM-7").filename(), "camera.yml");
    EXPECT_EQ(calibration_of(folder_ / ".", "CAM-12").filename(), "other.yaml");
}

TEST_F(CalibrationFolder, NamesThoseThatAreThereWhereNoneFits) {
    EXPECT_THAT(refusal("CAM-1"),
                HasSubstr("no calibration of camera CAM-1; there are those of CAM-7, CAM-12"));
    EXPECT_THAT(refusal(""), HasSubstr("no calibration of camera "));
    EXPECT_THAT(refusal("../camera"), HasSubstr("no calibration"));
}

TEST_F(CalibrationFolder, RefusesTwoOfOneCamera) {
    write_text(folder_ / "second.yml", camera_text);
    EXPECT_THAT(refusal("CAM-7"), HasSubstr("camera.yml and second.yml are both of camera CAM-7"));
}

TEST_F(CalibrationFolder, PassesOverAFileThatIsNoCamera) {
    write_text(folder_ / "broken.yml", "etalon: camera/1\nserial: [");
    EXPECT_EQ(calibration_of(folder_ / ".", "CAM-7").filename(), "camera.yml");
}

}  // namespace
}  // namespace etalon
