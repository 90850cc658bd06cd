#include "station/register/stage_registration.h"

#include "station/register/qualification_input.h"
#include "tests/station/photographed_station.h"

namespace etalon {
namespace {

// Corners of 8-bit renders without noise are right to some hundredths of a pixel, or 0.05 mm in
// depth, once the detector's bias is taken out; uncorrected the depth is off by a millimetre.
void expect_true(const StageRegistration& result) {
    const Vector6d x = left_difference(true_x, result.registration.camera_from_base);
    EXPECT_LT(x.head<3>().norm(), 3e-3);
    EXPECT_LT(x.tail<3>().norm(), 0.3);
}

class StageRegistrationTest : public testing::Test {
protected:
    // Of photographs at this share of the travel (photographed_station.h).
    StageRegistration registered(int count, const std::vector<double>& share,
                                 const std::string& detector) {
        return register_photos(station,
                               read_stage_photos(set.photographs(count, share), station.stage.axes),
                               detector);
    }
    PhotographedStation set;
    const StationFile station = set.station();
};

TEST_F(StageRegistrationTest, FindsXAndYFromPhotographsAndACsv) {
    const StageRegistration corners = registered(10, {1, 1, 1, 1}, "auto");
    expect_true(corners);
    EXPECT_EQ(corners.used, 10);
    EXPECT_EQ(corners.detector, "apriltag");
    EXPECT_GE(corners.rounds, 1);
    ASSERT_EQ(corners.registration.freedoms.size(), 1u);
    EXPECT_EQ(corners.registration.freedoms[0].name, "shift along base z between X and Y");
    EXPECT_LT((corners.registration.carriage_from_marker.translation -
               station.carriage_from_marker_nominal.translation)
                  .norm(),
              0.3);
}

// Poses without a whole frame are left out; the first whole one counts.
TEST_F(StageRegistrationTest, ReadsTheFramesOfARecord) {
    const TemporaryFolder record;
    std::filesystem::create_directory(record / "frames");
    for (const char* name : {"0000_0.png", "0000_1.png", "0002_1.png"})
        write_text(record / "frames" / name, "not looked at");
    write_text(record / "poses.csv",
               "pose,split,commanded_z_mm,read_back_z_mm,read_back_rz_deg,used\n"
               "0,training,7,7.25,90,1\n1,training,5,5.5,0,0\n2,hold-out,3,3.5,-45,1\n");
    const std::vector<Axis> axes = {{"rz", Axis::Kind::rotary}, {"z", Axis::Kind::linear}};
    const std::vector<StagePhoto> photos = read_record_photos(record.path(), axes);
    ASSERT_EQ(photos.size(), 2u);
    EXPECT_EQ(photos[0].photo, record / "frames" / "0000_0.png");
    EXPECT_EQ(photos[1].photo, record / "frames" / "0002_1.png");
    EXPECT_DOUBLE_EQ(photos[0].positions[0], std::numbers::pi / 2.0);
    EXPECT_DOUBLE_EQ(photos[1].positions[1], 3.5);
}

TEST_F(StageRegistrationTest, FindsThemFromPhotometricPoses) {
    const StageRegistration result = registered(6, {1, 1, 1, 1}, "photometric");
    expect_true(result);
    EXPECT_EQ(result.rounds, 0);
    EXPECT_EQ(result.registration.residual_rms_px, 0.0);
}

TEST_F(StageRegistrationTest, NamesAPlanThatIsDegenerateForThisStage) {
    EXPECT_THAT(text_of_error<NumericalError>([&] {
                    registered(5, {0, 0, 1, 0}, "auto");
                }),
                HasSubstr("one line, base z"));
}

// The plan's volume lets all axes move; its training poses did not.
TEST_F(StageRegistrationTest, AQualificationOfDegenerateTrainingPosesIsRefused) {
    const Projector projector(station.camera.model);
    std::vector<VisitedPose> poses(30);
    for (std::size_t i = 0; i < poses.size(); ++i) {
        VisitedPose& pose = poses[i];
        pose.hold_out = i % 2 == 1;
        pose.read_back = {0.0, 0.0, 2.0 * static_cast<double>(i), 0.0};
        pose.read_back_uncertainty.assign(4, 0.0);
        pose.base_from_carriage = base_from_carriage(station.stage.axes, pose.read_back);
        const Rigid truth = true_x * pose.base_from_carriage * station.carriage_from_marker_nominal;
        for (const Eigen::Vector3d& point : station.marker.points_mm)
            pose.corners.push_back(projector.project(truth * point).value());
    }
    QualificationInput input = declared_input(station, poses);
    input.render_and_detect = [](const Rigid&) { return std::nullopt; };
    EXPECT_THAT(text_of_error<NumericalError>([&] { qualify(input); }),
                AllOf(HasSubstr("degenerate plan"), HasSubstr("one line, base z")));
}

TEST_F(StageRegistrationTest, RefusesATableThatItCannotUse) {
    const auto refusal = [&](const std::string& csv) {
        write_text(set.folder() / "table.csv", csv);
        return text_of_error<ConfigError>(
            [&] { read_stage_photos(set.folder() / "table.csv", station.stage.axes); });
    };
    EXPECT_THAT(refusal("photo,x_mm,y_mm,z_mm\n"), HasSubstr("table.csv:1: the header lacks"));
    EXPECT_THAT(refusal("photo,x_mm,y_mm,z_mm,rz_deg\n"), HasSubstr("no photograph"));
    EXPECT_THAT(refusal("photo,x_mm,y_mm,z_mm,rz_deg,w_mm\n"), HasSubstr("one column for each"));
    EXPECT_THAT(refusal("photo,x_mm,y_mm,z_mm,rz_deg\na.png,1,2,nan,4\n"),
                HasSubstr("table.csv:2: 'nan' is not a finite number"));
    EXPECT_THAT(refusal("photo,x_mm,y_mm,z_mm,rz_deg\na.png,1,2,3\n"), HasSubstr("4 cells"));
    EXPECT_THAT(refusal("photo,x_mm,y_mm,z_mm,rz_deg\na.png,61,2,3,4\n"), HasSubstr("x"));
}

}  // namespace
}  // namespace etalon
