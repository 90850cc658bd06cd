#include "sim/scene/pose_file.h"

#include "tests/test.h"

namespace etalon {
namespace {

class PoseFile : public testing::Test {
protected:
    std::filesystem::path file(const std::string& name, const std::string& text) const {
        write_text(folder_ / name, text);
        return folder_ / name;
    }
    std::string complaint(const std::string& name, const std::string& text) const {
        return config_error_of([&] { read_poses(file(name, text)); });
    }

    TemporaryFolder folder_;
};

constexpr const char* header = "rx,ry,rz,tx,ty,tz\n";

TEST_F(PoseFile, ReadsCsvWithItsHeaderAndEitherLineEnding) {
    const auto poses = read_poses(
        file("p.csv", "rx,ry,rz,tx,ty,tz\r\n0, 0, 1.5707963267948966, 10,-7,500\r\n0,0,0,1,2,3"));
    ASSERT_EQ(poses.size(), 2u);
    EXPECT_EQ(poses[0].translation, Eigen::Vector3d(10, -7, 500));
    // A quarter turn about z takes x to y.
    EXPECT_LT((poses[0].rotation * Eigen::Vector3d::UnitX() - Eigen::Vector3d::UnitY()).norm(),
              1e-15);
}

TEST_F(PoseFile, ReadsBothKindsOfJson) {
    const auto poses = read_poses(
        file("p.json",
             "[[0, 0, 0, 10, -7, 500],\n"
             " {\"tz\": 300, \"rx\": 0.5, \"ry\": 0, \"rz\": 0, \"tx\": 1e1, \"ty\": -0.7}]"));
    ASSERT_EQ(poses.size(), 2u);
    EXPECT_EQ(poses[0].translation, Eigen::Vector3d(10, -7, 500));
    EXPECT_EQ(poses[1].translation, Eigen::Vector3d(10, -0.7, 300));
    EXPECT_NEAR(rotation_vector(poses[1].rotation).x(), 0.5, 1e-15);
}

TEST_F(PoseFile, NamesTheLineOfWhatIsWrong) {
    EXPECT_THAT(complaint("a.csv", ""), HasSubstr("a.csv:1: the first line must be"));
    EXPECT_THAT(complaint("b.csv", "0,0,0,1,2,3\n"), HasSubstr("b.csv:1: the first line"));
    EXPECT_THAT(complaint("c.csv", header), HasSubstr("holds no pose"));
    EXPECT_THAT(complaint("d.csv", std::string(header) + "0,0,0,1,2,3\n0,0,0,1,2\n"),
                EndsWith("d.csv:3: has 5 cells, not the header's 6"));
    EXPECT_THAT(complaint("e.csv", std::string(header) + "0,0,nan,1,2,3\n"),
                EndsWith("e.csv:2: 'nan' is not a finite number"));
    EXPECT_THAT(complaint("f.csv", std::string(header) + "\n0,0,,1,2,3\n"),
                HasSubstr("f.csv:3: '' is not"));
    EXPECT_THAT(complaint("g.csv", std::string(header) + "0,30,0,1,2,3\n"),
                HasSubstr("g.csv:2: the rotation vector (0, 30, 0) is longer than 2 pi"));
    EXPECT_THAT(complaint("h.csv", std::string(header) + "1e308,1e308,0,1,2,3\n"),
                HasSubstr("h.csv:2: the rotation vector"));
    EXPECT_THAT(complaint("i.csv", std::string(header) + "0,0,0,1e308,1e308,3\n"),
                HasSubstr("longer than a kilometre"));
    EXPECT_THAT(complaint("j.txt", header), HasSubstr("ends in .csv or .json"));
}

TEST_F(PoseFile, IsAsStrictWithJson) {
    EXPECT_THAT(complaint("a.json", "[]"), HasSubstr("holds no pose"));
    EXPECT_THAT(complaint("b.json", "[[0,0,0,1,2,3],\n[0,0,0,1,2]]"), HasSubstr("b.json:2:"));
    EXPECT_THAT(complaint("c.json", "[\n{\"rx\":0,\"ry\":0,\"rz\":0,\"tx\":1,\"ty\":2}]"),
                HasSubstr("c.json:2: poses[0].tz: missing"));
    EXPECT_THAT(
        complaint("d.json", "[{\"rx\":0,\"ry\":0,\"rz\":0,\"tx\":1,\"ty\":2,\n\"tz\":3,\"q\":5}]"),
        HasSubstr("d.json:2: poses[0].q"));
    EXPECT_THAT(
        complaint("e.json", "[{\"rx\":0,\"ry\":0,\"rz\":0,\"tx\":1,\"ty\":2,\n\"tz\":3,\"tz\":3}]"),
        HasSubstr("doubled"));
    EXPECT_THAT(complaint("f.json", "[[0,0,0,1,2,\"3\"]]"), HasSubstr("f.json:1:"));
    EXPECT_THAT(complaint("g.json", "[[0,0,0,1,2,3]"), HasSubstr("g.json"));
    EXPECT_THAT(complaint("h.json", "[[0,0,0,1,2,3]], \"other\": 5"), HasSubstr("other"));
    EXPECT_THAT(complaint("i.json", "{\"rx\": 0}"), HasSubstr("must be a list"));
    EXPECT_THROW(read_poses(folder_ / "none.json"), ConfigError);
}

TEST(ParsePose, TakesSixNumbersAndNamesTheOption) {
    const Rigid pose = parse_pose("0.1,0,0,7,-5,400", "--pose");
    EXPECT_EQ(pose.translation, Eigen::Vector3d(7, -5, 400));
    for (const char* bad :
         {"", "1,2,3", "0,0,0,0,0,inf", "a,0,0,0,0,1", "0,0,0,0,0,1,", "7,0,0,0,0,1"})
        EXPECT_THAT(config_error_of([&] { parse_pose(bad, "--pose"); }), StartsWith("--pose: "))
            << bad;
}

}  // namespace
}  // namespace etalon
