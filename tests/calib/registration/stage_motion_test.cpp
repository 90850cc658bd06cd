#include "calib/registration/stage_motion.h"

#include "core/statistics/random.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr double deg = std::numbers::pi / 180.0;

// Motions by [x y z rx ry rz] within +- the reach; mm and rad; the rotary axes carried by the
// linear ones, about lines through `point_mm`.
std::vector<Rigid> poses_within(const Vector6d& reach, int count = 12,
                                const Eigen::Vector3d& point_mm = {30.0, -20.0, 10.0}) {
    std::vector<Rigid> poses;
    for (int i = 0; i < count; ++i) {
        RandomStream random(7, 3, static_cast<std::uint64_t>(i));
        Rigid pose{Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero()};
        Vector6d q;
        for (int k = 0; k < 6; ++k)
            q[k] = reach[k] * (2.0 * random.uniform() - 1.0);
        pose.translation = q.head<3>();
        for (int k = 0; k < 3; ++k) {
            const Eigen::Quaterniond turn =
                rotation_from_vector(q[3 + k] * Eigen::Vector3d::Unit(k));
            pose = pose * Rigid{turn, point_mm - turn * point_mm};
        }
        poses.push_back(pose);
    }
    return poses;
}

Vector6d reach(double x, double y, double z, double rx = 0, double ry = 0, double rz = 0) {
    return (Vector6d() << x, y, z, rx, ry, rz).finished();
}

// Of every kind, and a screw.
const std::vector<Vector6d> reaches{reach(70, 0, 0),
                                    reach(70, 0, 50),
                                    reach(0, 0, 0, 0, 1.2, 0),
                                    reach(0, 50, 0, 0, 1.2, 0),
                                    reach(70, 0, 50, 0, 1.2, 0),
                                    reach(70, 40, 50, 0, 1.2, 0),
                                    reach(0, 0, 0, 0.5, 0, 1.2)};

// The counts are those of docs/metrology.md: what commutes with all motions of the stage.
TEST(StageMotion, KnowsTheKindsAndCountsTheirFreedoms) {
    using enum MotionKind;
    const std::tuple<Vector6d, MotionKind, int> stages[] = {
        {reach(70, 0, 0), collinear, 4},
        {reach(70, 0, 50), planar_shifts, 3},
        {reach(70, 40, 50), shifts, 3},
        {reach(0, 0, 0, 0, 1.2, 0), one_axis, 2},
        {reach(0, 50, 0, 0, 1.2, 0), one_axis, 2},  // a screw keeps its line
        {reach(70, 0, 50, 0, 1.2, 0), planar_motion, 1},
        {reach(70, 40, 50, 0, 1.2, 0), parallel_turns, 1},
        {reach(0, 0, 0, 0.5, 0, 1.2), all_turns, 0},
        {reach(70, 40, 50, 0.5, 0.4, 1.2), all_turns, 0}};
    for (const auto& [within, kind, freedoms] : stages) {
        const StageMotion found = stage_motion(poses_within(within));
        EXPECT_EQ(found.kind, kind) << found.words;
        EXPECT_EQ(found.freedoms, freedoms) << found.words;
    }
}

TEST(StageMotion, IsTheSameFromAnyOtherBase) {
    const Rigid other{rotation_from_vector({0.7, -1.1, 0.4}), {1000.0, -3000.0, 500.0}};
    for (const Vector6d& within : reaches) {
        std::vector<Rigid> poses = poses_within(within);
        const StageMotion here = stage_motion(poses);
        for (Rigid& pose : poses)
            pose = other * pose;
        EXPECT_EQ(stage_motion(poses).kind, here.kind) << here.words;
    }
}

TEST(StageMotion, SaysItInWords) {
    EXPECT_EQ(stage_motion(poses_within(reach(0, 70, 0))).words, "shifts along one line, base y");
    EXPECT_EQ(stage_motion(poses_within(reach(70, 0, 50))).words,
              "shifts in the plane across base y");
    EXPECT_EQ(stage_motion(poses_within(reach(70, 40, 0, 0, 0, 2))).words,
              "planar motion: shifts across base z and turns about it");
}

TEST(StageMotion, DoesNotTakeTheNoiseOfReadingsForMotion) {
    std::vector<Rigid> poses = poses_within(reach(70, 0, 0));
    for (std::size_t i = 0; i < poses.size(); ++i) {
        RandomStream random(9, 4, i);
        poses[i].translation.y() += 5e-4 * (2.0 * random.uniform() - 1.0);
        poses[i].rotation =
            rotation_from_vector({2e-5 * (2.0 * random.uniform() - 1.0), 0, 0}) * poses[i].rotation;
    }
    EXPECT_EQ(stage_motion(poses).kind, MotionKind::collinear);
}

// Neither does it move a pose by more than the noise that it takes away, whatever the kind.
TEST(StageMotion, LeavesPosesWhereTheyAreButForTheNoise) {
    for (const Vector6d& within : reaches) {
        const std::vector<Rigid> exact = poses_within(within);
        std::vector<Rigid> read = exact;
        for (std::size_t i = 0; i < read.size(); ++i) {
            RandomStream random(11, 5, i);
            Vector6d noise;
            for (int k = 0; k < 6; ++k)
                noise[k] = (k < 3 ? 1e-6 : 1e-4) * (2.0 * random.uniform() - 1.0);
            read[i] = left_perturbed(read[i], noise);
        }
        const StageMotion motion = stage_motion(read);
        EXPECT_EQ(motion.kind, stage_motion(exact).kind) << motion.words;
        for (std::size_t i = 0; i < read.size(); ++i) {
            const Vector6d moved = left_difference(read[i], motion.without_noise[i]);
            EXPECT_LT(moved.head<3>().norm(), 1e-5) << motion.words;
            EXPECT_LT(moved.tail<3>().norm(), 1e-3) << motion.words;
        }
    }
}

TEST(StageMotion, CountsPosesThatAreApart) {
    const std::vector<Rigid> far = poses_within(reach(70, 40, 50), 2);
    std::vector<Rigid> poses;
    for (int i = 0; i < 10; ++i) {
        poses.push_back(far[static_cast<std::size_t>(i % 2)]);
        poses.back().translation.x() += 1e-4 * i;
    }
    EXPECT_EQ(stage_motion(poses).distinct_poses, 2);
    EXPECT_EQ(stage_motion(std::vector<Rigid>(7)).distinct_poses, 1);
    EXPECT_EQ(stage_motion(poses_within(reach(70, 40, 50), 9)).distinct_poses, 4);
}

std::string refusal(const Vector6d& plan, const Vector6d& stage) {
    return text_of_error<NumericalError>(
        [&] { require_full_motion(poses_within(plan), poses_within(stage)); });
}

TEST(StageMotion, NamesAPlanThatMovesLessThanItsStage) {
    const Vector6d xyz = reach(70, 40, 50), six = reach(70, 40, 50, 0.5, 0.4, 1.2);
    EXPECT_THAT(refusal(reach(0, 0, 0), xyz), HasSubstr("no motion"));
    EXPECT_THAT(refusal(reach(70, 0, 0), xyz),
                AllOf(HasSubstr("one line, base x"), HasSubstr("shifts in space"),
                      HasSubstr("4 instead of 3")));
    EXPECT_THAT(refusal(reach(70, 40, 0), xyz), HasSubstr("plane across base z"));
    EXPECT_THAT(refusal(reach(70, 0, 50, 0, 1.2, 0), six),
                AllOf(HasSubstr("planar motion"), HasSubstr("1 instead of 0")));
    EXPECT_THAT(refusal(reach(0, 0, 0, 0, 1.2, 0), six), HasSubstr("one fixed axis"));
    EXPECT_EQ(refusal(reach(70, 0, 0), reach(90, 0, 0)), "no error");
    EXPECT_EQ(refusal(xyz, xyz), "no error");
    EXPECT_EQ(refusal(reach(0, 0, 0, 20 * deg, 0, 30 * deg), six), "no error");
}

TEST(StageMotion, RefusesTwoPosesHoweverOftenTheyAreVisited) {
    const std::vector<Rigid> stage = poses_within(reach(0, 0, 70));
    std::vector<Rigid> plan;
    for (int i = 0; i < 12; ++i)
        plan.push_back(stage[static_cast<std::size_t>(i % 2)]);
    EXPECT_THAT(text_of_error<NumericalError>([&] { require_full_motion(plan, stage); }),
                HasSubstr("2 distinct poses"));
}

TEST(StageMotion, RefusesWhatIsNotFinite) {
    std::vector<Rigid> poses = poses_within(reach(70, 0, 0));
    poses[5].translation.y() = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(stage_motion(poses), NumericalError);
    EXPECT_THROW(stage_motion({}), NumericalError);
}

}  // namespace
}  // namespace etalon
