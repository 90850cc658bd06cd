// `etalon register` and `etalon expect` as a user meets them.
#include <nlohmann/json.hpp>

#include "tests/station/built_program.h"
#include "tests/station/photographed_station.h"

namespace etalon {
namespace {

using SortedJson = nlohmann::json;

constexpr const char* register_command =
    "register --station station.yaml --positions positions.csv";
constexpr const char* expect_command =
    "expect --camera camera.yml --marker apriltag:36h11:5@60mm --volume 160:260 --poses 20 "
    "--frames 2 ";

TEST(RegisterCommand, PrintsWhereTheStageStandsAndWhatItCannotTell) {
    PhotographedStation set;
    set.photographs(10, {1, 1, 1, 1});
    const Finished text = etalon_with(set.folder(), register_command);
    EXPECT_EQ(text.exit_code, 0) << text.err;
    EXPECT_EQ(text.err, "");
    for (const char* words : {"10 of 10 photographs, detector apriltag", "rank 11 of 12",
                              "shift along base z between X and Y", "camera_from_base"})
        EXPECT_THAT(text.out, HasSubstr(words));

    const Finished json = etalon_with(set.folder(), std::string(register_command) + " --json");
    const SortedJson found = SortedJson::parse(json.out);
    EXPECT_EQ(found["etalon"], "registration/1");
    EXPECT_EQ(found["photos_used"], 10);
    EXPECT_EQ(found["freedoms"].size(), 1u);
    // To what renders without noise allow (tests/station/register/stage_registration_test.cpp).
    const Vector6d truth = vector_from_rigid(true_x);
    for (std::size_t i = 0; i < 6; ++i)
        EXPECT_NEAR(found["camera_from_base"][i].get<double>(), truth[static_cast<Eigen::Index>(i)],
                    i < 3 ? 3e-3 : 0.3);
}

TEST(RegisterCommand, RefusesWhatItCannotUse) {
    PhotographedStation set;
    const auto refused = [&](const std::string& command, const std::string& message) {
        expect_one_line_error(etalon_with(set.folder(), command), 3, message);
    };
    refused("register", "--positions: give either a record's folder or --positions");
    refused("register --positions positions.csv", "--station: is needed with --positions");
    refused("register nothing", "run.json: no such file");
    refused(register_command, "positions.csv: no such file");
    write_text(set.folder() / "positions.csv", "photo,x_mm,y_mm,z_mm,rz\n0.png,1,2,3,4\n");
    refused(register_command, "positions.csv:1: the header lacks the column 'rz_deg'");
    write_station(set.folder(), replaced(station_text, "detector:", "detecter: aruco\ndetector:"));
    refused(register_command, "station.yaml:31: detecter: unknown key");
}

TEST(ExpectCommand, PrintsTheErrorsToExpectAndWritesThem) {
    const TemporaryFolder folder;
    write_station(folder);
    const Finished text = etalon_with(folder, std::string(expect_command) + "--out expected");
    EXPECT_EQ(text.exit_code, 0) << text.err;
    EXPECT_THAT(text.out, HasSubstr("detected at 20 of 20 poses"));
    EXPECT_THAT(text.out, HasSubstr("no noise: the calibration declares no sensor noise"));
    EXPECT_THAT(text.out, HasSubstr("report expected/report.html"));
    EXPECT_TRUE(std::filesystem::exists(folder / "expected/report.html"));
    const Finished json = etalon_with(folder, std::string(expect_command) + "--json");
    EXPECT_EQ(SortedJson::parse(json.out)["poses"], 20);
}

TEST(ExpectCommand, RefusesBadInputAndWritesNothing) {
    const TemporaryFolder folder;
    write_station(folder);
    const auto refused = [&](const std::string& arguments, const std::string& message) {
        expect_one_line_error(etalon_with(folder, "expect --out expected " + arguments), 3,
                              message);
        EXPECT_FALSE(std::filesystem::exists(folder / "expected")) << arguments;
    };
    const std::string marker = "--marker apriltag:36h11:5@60mm ";
    refused("--camera camera.yml " + marker, "--volume is required");
    refused("--camera camera.yml " + marker + "--volume 260:160", "--volume: must be two depths");
    refused("--camera nothing.yml " + marker + "--volume 160:260", "nothing.yml: no such file");
    refused("--camera camera.yml --volume 160:260 --marker apriltag:36h12:5@60mm", "36h12");
    write_text(folder / "camera.yml", replaced(camera_text, "distortion", "distorsion"));
    refused("--camera camera.yml " + marker + "--volume 160:260",
            "camera.yml:5: distorsion: unknown key");
}

}  // namespace
}  // namespace etalon
