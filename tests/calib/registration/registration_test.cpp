#include "calib/registration/registration.h"

#include <Eigen/Dense>

#include "calib/registration/stage_motion.h"
#include "core/statistics/random.h"
#include "tests/calib/registration/true_stage.h"
#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

const Projector projector(webcam());

// Motions of a stage by its free axes; the first axis is nearest to the base.
struct Motion {
    bool x = false, y = false, z = false, rx = false, ry = false, rz = false;
};
const Motion xyz_stage{.x = true, .y = true, .z = true},
    xyz_and_rz{.x = true, .y = true, .z = true, .rz = true},
    five_axes{.x = true, .y = true, .z = true, .rx = true, .rz = true};

std::vector<Rigid> stage_poses(const Motion& motion, int count, std::uint64_t seed = 5) {
    std::vector<Rigid> poses;
    for (int i = 0; i < count; ++i) {
        RandomStream random(seed, 1, static_cast<std::uint64_t>(i));
        const auto within = [&](bool moves, double reach) {
            const double value = reach * (2.0 * random.uniform() - 1.0);
            return moves ? value : 0.0;
        };
        const double x = within(motion.x, 90), y = within(motion.y, 70), z = within(motion.z, 110);
        const double rx = within(motion.rx, 0.4), ry = within(motion.ry, 0.3);
        const double rz = within(motion.rz, 3.0);
        poses.push_back(Rigid{Eigen::Quaterniond::Identity(), {x, y, z}} *
                        Rigid{rotation_from_vector({rx, 0, 0}), Eigen::Vector3d::Zero()} *
                        Rigid{rotation_from_vector({0, ry, 0}), Eigen::Vector3d::Zero()} *
                        Rigid{rotation_from_vector({0, 0, rz}), Eigen::Vector3d::Zero()});
    }
    return poses;
}

std::vector<Eigen::Vector2d> seen(const Rigid& camera_from_marker,
                                  const Projector& by = projector) {
    std::vector<Eigen::Vector2d> pixels;
    for (const Eigen::Vector3d& point : tag)
        pixels.push_back(by.project(camera_from_marker * point).value());
    return pixels;
}

// Exact first estimates are not needed: they are off by a degree and some millimetres.
std::vector<RegistrationPose> observations(const std::vector<Rigid>& stage, double noise_px = 0.0,
                                           std::uint64_t seed = 1) {
    std::vector<RegistrationPose> poses;
    for (std::size_t i = 0; i < stage.size(); ++i) {
        RandomStream random(seed, 2, i);
        const Rigid camera_from_marker = true_x * stage[i] * true_y;
        RegistrationPose pose{stage[i], camera_from_marker, seen(camera_from_marker)};
        for (Eigen::Vector2d& pixel : pose.pixels)
            pixel += noise_px * Eigen::Vector2d{random.normal(), random.normal()};
        Vector6d wrong;
        for (int k = 0; k < 6; ++k)
            wrong[k] = (k < 3 ? 0.01 : 2.0) * random.normal();
        pose.camera_from_marker = left_perturbed(camera_from_marker, wrong);
        poses.push_back(pose);
    }
    return poses;
}

Registration registered(const Motion& motion, const Rigid& nominal = true_y) {
    return register_stage(projector, tag, observations(stage_poses(motion, 25)), nominal);
}

double largest_difference(const Registration& one, const Rigid& x, const Rigid& y,
                          const std::vector<Rigid>& stage) {
    double largest = 0.0;
    for (const Rigid& base_from_carriage : stage)
        largest = std::max(largest, left_difference(one.camera_from_marker(base_from_carriage),
                                                    x * base_from_carriage * y)
                                        .norm());
    return largest;
}

std::vector<std::string> freedom_names(const Registration& registration) {
    std::vector<std::string> names;
    for (const GaugeFreedom& freedom : registration.freedoms)
        names.push_back(freedom.name);
    return names;
}

TEST(Registration, FindsBothTransformsWhenTheFreedomsAreFixedAtTheTruth) {
    for (const Motion& motion :
         {xyz_stage, xyz_and_rz, Motion{.rx = true, .ry = true, .rz = true}, Motion{.x = true},
          Motion{.rz = true}, Motion{.x = true, .y = true}}) {
        const Registration result = registered(motion);
        EXPECT_LT(left_difference(true_x, result.camera_from_base).norm(), 1e-6);
        EXPECT_LT(left_difference(true_y, result.carriage_from_marker).norm(), 1e-6);
        EXPECT_LT(result.residual_rms_px, 1e-8);
    }
}

TEST(Registration, PredictsPosesThatItHasNotSeenWhateverThePrior) {
    const Motion& motion = xyz_and_rz;
    const Rigid prior{rotation_from_vector({0.2, -0.1, 0.4}), {30.0, 20.0, -10.0}};
    const Registration result = registered(motion, prior);
    EXPECT_LT(largest_difference(result, true_x, true_y, stage_poses(motion, 20, 77)), 1e-6);
}

// Zhuang et al. count them by what commutes with the motions; see also docs/metrology.md.
TEST(Registration, CountsAndNamesTheFreedomsOfEachStage) {
    EXPECT_THAT(
        freedom_names(registered({.x = true})),
        ElementsAre("shift along base x between X and Y", "shift along base y between X and Y",
                    "shift along base z between X and Y", "rotation about base x between X and Y"));
    EXPECT_THAT(
        freedom_names(registered({.rz = true})),
        ElementsAre("shift along base z between X and Y", "rotation about base z between X and Y"));
    EXPECT_THAT(
        freedom_names(registered(xyz_stage)),
        ElementsAre("shift along base x between X and Y", "shift along base y between X and Y",
                    "shift along base z between X and Y"));
    EXPECT_THAT(freedom_names(registered(xyz_and_rz)),
                ElementsAre("shift along base z between X and Y"));
    EXPECT_THAT(freedom_names(registered({.rx = true, .rz = true})), ElementsAre());
}

TEST(Registration, HasFreedomsThatMoveNoPixel) {
    for (const Motion& motion : {Motion{.y = true}, Motion{.rz = true}, xyz_and_rz}) {
        const Registration result = registered(motion);
        for (const GaugeFreedom& freedom : result.freedoms)
            for (const Rigid& stage : stage_poses(motion, 5, 9)) {
                const Eigen::VectorXd moved =
                    registration_jacobian(projector, tag, result.camera_from_base, stage,
                                          result.carriage_from_marker) *
                    freedom.direction;
                EXPECT_LT(moved.norm(), 1e-6) << freedom.name;  // px per mm or rad
            }
    }
}

TEST(Registration, KeepsYAsNearToThePriorAsTheFreedomsAllow) {
    Rigid prior = true_y;
    prior.translation += Eigen::Vector3d(4.0, -3.0, 7.0);
    const Registration one = registered(xyz_and_rz, prior);
    // Rz alone ties Y's shift across the axis; along it Y follows the prior.
    EXPECT_LT(
        (one.carriage_from_marker.translation - true_y.translation - Eigen::Vector3d(0, 0, 7.0))
            .norm(),
        1e-5);
    const Registration none = registered(xyz_stage, prior);
    EXPECT_LT((none.carriage_from_marker.translation - prior.translation).norm(), 1e-5);
}

TEST(Registration, HasTheJacobianOfItsPrediction) {
    const Rigid stage = stage_poses({.x = true, .y = true, .rx = true, .rz = true}, 1).front();
    const auto jacobian = registration_jacobian(projector, tag, true_x, stage, true_y);
    for (int k = 0; k < 12; ++k) {
        constexpr double step = 1e-5;
        const auto moved = [&](double by) {
            const Vector6d d = by * Vector6d::Unit(k % 6);
            return seen(k < 6 ? left_perturbed(true_x, d) * stage * true_y
                              : true_x * stage * left_perturbed(true_y, d));
        };
        const auto plus = moved(step), minus = moved(-step);
        for (std::size_t i = 0; i < tag.size(); ++i) {
            const Eigen::Vector2d slope = (plus[i] - minus[i]) / (2 * step);
            const Eigen::Vector2d given = jacobian.col(k).segment<2>(2 * static_cast<int>(i));
            EXPECT_LT((given - slope).norm(), 1e-6 * (1.0 + slope.norm())) << k;
        }
    }
}

TEST(Registration, IsHardlyMovedByOneWrongDetection) {
    const Motion& motion = xyz_and_rz;
    std::vector<RegistrationPose> poses = observations(stage_poses(motion, 25), 0.01);
    for (Eigen::Vector2d& pixel : poses[6].pixels)
        pixel += Eigen::Vector2d(9.0, -5.0);
    const Registration result = register_stage(projector, tag, poses, true_y);
    // Plain least squares would be off by 10 px / 25 poses, half a millimetre.
    EXPECT_LT((result.camera_from_base.translation - true_x.translation).norm(), 0.1);
    EXPECT_GE(result.down_weighted_points, 4);
    EXPECT_LE(result.down_weighted_points, 10);
}

// XYZ with a rotary axis of +-`reach` rad about base z, 25 poses.
std::vector<Rigid> turned_a_little(double reach) {
    std::vector<Rigid> stage = stage_poses(xyz_stage, 25);
    for (std::size_t i = 0; i < stage.size(); ++i) {
        const double angle = reach * (2.0 * RandomStream(8, 1, i).uniform() - 1.0);
        stage[i].rotation = rotation_from_vector({0, 0, angle});
    }
    return stage;
}

// Turns by the angle t tell X's shift d across the axis from Y's by the shift t d of the marker
// only: 25 poses within 2 degrees (mean square of t: 4.1e-4) together say 25 * 4.1e-4 = 0.01 times
// what one pose says. The shift along the axis stays free, however small the turns are.
TEST(Registration, LabelsWhatARotaryAxisOfTwoDegreesHardlyShows) {
    const auto result_for = [&](double reach) {
        return register_stage(projector, tag, observations(turned_a_little(reach)), true_y);
    };
    const Registration little = result_for(2.0 * std::numbers::pi / 180.0);
    EXPECT_EQ(little.rank, 11);
    ASSERT_EQ(little.weak.size(), 2u);
    for (const PoorlyConstrainedDirection& weak : little.weak) {
        EXPECT_THAT(weak.name, HasSubstr("shift along base"));
        EXPECT_NEAR(weak.worth_poses, 0.01, 0.01);
        EXPECT_GT(weak.deviation, 1.0);  // mm, at 1 px: 10 times that of a shift of the whole
    }
    EXPECT_TRUE(result_for(2.0).weak.empty());
    EXPECT_TRUE(registered({.x = true}).weak.empty());
    EXPECT_TRUE(registered(five_axes).weak.empty());
}

// The stated deviation is that with which repeated runs place X along the direction.
TEST(Registration, HasWeakDirectionsThatMovePixelsAsLittleAsTheySay) {
    const std::vector<Rigid> stage = turned_a_little(0.03);
    const Registration result = register_stage(projector, tag, observations(stage), true_y);
    ASSERT_FALSE(result.weak.empty());
    for (const PoorlyConstrainedDirection& weak : result.weak) {
        double squares = 0.0;
        for (const Rigid& base_from_carriage : stage)
            squares += (registration_jacobian(projector, tag, result.camera_from_base,
                                              base_from_carriage, result.carriage_from_marker) *
                        weak.direction)
                           .squaredNorm();
        EXPECT_NEAR(1.0 / std::sqrt(squares), weak.deviation, 1e-6 * weak.deviation) << weak.name;
    }
}

// An axis at rest whose reading trembles by a microradian: without turns that are more than noise,
// X and Y would be 30 m off (and the predicted pixels right all the same).
TEST(Registration, IsNotPlacedByTheNoiseOfAnAxisAtRest) {
    std::vector<RegistrationPose> poses = observations(stage_poses(xyz_stage, 25), 0.05);
    for (std::size_t i = 0; i < poses.size(); ++i)
        poses[i].base_from_carriage.rotation =
            rotation_from_vector({0, 0, 1e-6 * RandomStream(6, 1, i).normal()});
    const Registration result = register_stage(projector, tag, poses, true_y);
    EXPECT_EQ(result.rank, 9);
    EXPECT_LT((result.carriage_from_marker.translation - true_y.translation).norm(), 1e-6);
}

TEST(Registration, SaysWhichMotionThePosesMake) {
    EXPECT_EQ(registered({.x = true}).motion, "shifts along one line, base x");
    EXPECT_EQ(registered({.x = true, .y = true, .rz = true}).motion,
              "planar motion: shifts across base z and turns about it");
}

// Poses that differ from the truth by draws from a covariance with all its correlations.
std::vector<MeasuredPose> measured(const std::vector<Rigid>& stage, double noise,
                                   std::uint64_t seed = 1) {
    Matrix6d root = Matrix6d::Zero();  // turns 1 mrad, along the line of sight 0.1 mm
    root.diagonal() << 1e-3, 1.5e-3, 3e-4, 0.01, 0.013, 0.1;
    root(3, 1) = 0.008;
    root(5, 0) = -0.03;
    std::vector<MeasuredPose> poses;
    for (std::size_t i = 0; i < stage.size(); ++i) {
        RandomStream random(seed, 3, i);
        Vector6d normal;
        for (double& value : normal)
            value = noise * random.normal();
        poses.push_back({stage[i], left_perturbed(true_x * stage[i] * true_y, root * normal),
                         root * root.transpose()});
    }
    return poses;
}

TEST(Registration, FindsBothTransformsFromPoses) {
    for (const Motion& motion :
         {xyz_and_rz, Motion{.rx = true, .ry = true, .rz = true}, Motion{.x = true}}) {
        const Registration result =
            register_stage_on_poses(measured(stage_poses(motion, 25), 0.0), true_y);
        EXPECT_LT(left_difference(true_x, result.camera_from_base).norm(), 1e-6);
        EXPECT_LT(left_difference(true_y, result.carriage_from_marker).norm(), 1e-6);
        EXPECT_LT(result.reduced_squares, 1e-10);
    }
}

// The determined part of the error, in standard deviations squared, is a chi-square of 12 degrees
// of freedom: over 200 runs its mean is 12 +- 0.35; 3.5 times that are allowed. The same for the
// squares of the residuals: 25 * 6 - 12 = 138 degrees each, per degree 1 +- 0.0085.
TEST(Registration, StatesTheCovarianceOfARegistrationOnPoses) {
    const std::vector<Rigid> stage = stage_poses(five_axes, 25);
    constexpr int runs = 200;
    double squares = 0.0, residuals = 0.0;
    for (int run = 0; run < runs; ++run) {
        const Registration result = register_stage_on_poses(measured(stage, 1.0, 50 + run), true_y);
        Vector12d error;
        error << left_difference(true_x, result.camera_from_base),
            left_difference(true_y, result.carriage_from_marker);
        squares += error.dot(result.covariance.ldlt().solve(error)) / runs;
        residuals += result.reduced_squares / runs;
    }
    EXPECT_NEAR(squares, 12.0, 1.22);
    EXPECT_NEAR(residuals, 1.0, 0.03);
}

TEST(Registration, RefusesPosesWithoutACovariance) {
    std::vector<MeasuredPose> poses = measured(stage_poses(xyz_stage, 8), 1.0);
    poses[3].covariance(2, 2) = 0.0;
    EXPECT_THROW(register_stage_on_poses(poses, true_y), NumericalError);
    poses[3].covariance = Matrix6d::Constant(std::numeric_limits<double>::quiet_NaN());
    EXPECT_THROW(register_stage_on_poses(poses, true_y), NumericalError);
    poses.resize(3);
    EXPECT_THROW(register_stage_on_poses(poses, true_y), NumericalError);
}

std::string refusal(const std::vector<RegistrationPose>& poses) {
    return text_of_error<NumericalError>([&] { register_stage(projector, tag, poses, true_y); });
}

TEST(Registration, RefusesWhatCannotGiveAResult) {
    const std::vector<RegistrationPose> good = observations(stage_poses(xyz_stage, 8));
    EXPECT_THAT(refusal({good.begin(), good.begin() + 3}), HasSubstr("3 poses"));
    EXPECT_THAT(refusal(std::vector<RegistrationPose>(8, good[0])), HasSubstr("did not move"));
    std::vector<RegistrationPose> two;
    for (std::size_t i = 0; i < 8; ++i)
        two.push_back(good[i % 2]);
    EXPECT_THAT(refusal(two), HasSubstr("only 2 distinct"));

    const auto broken = [&](const std::function<void(RegistrationPose&)>& change) {
        std::vector<RegistrationPose> bad = good;
        change(bad[2]);
        return refusal(bad);
    };
    EXPECT_THAT(broken([](auto& pose) { pose.pixels[1].y() = NAN; }), HasSubstr("not finite"));
    EXPECT_THAT(broken([](auto& pose) { pose.base_from_carriage.translation.x() = INFINITY; }),
                HasSubstr("not finite"));
    EXPECT_THAT(broken([](auto& pose) { pose.sigma_px = 0.0; }), HasSubstr("sigma"));
    EXPECT_THAT(broken([](auto& pose) { pose.pixels.pop_back(); }), HasSubstr("3 pixels"));
}

// The stage stands aside: some of the tag's places are behind the camera's plane.
TEST(Registration, FindsBothTransformsBeforeEveryWideLens) {
    const Rigid aside{rotation_from_vector({-0.15, 1.25, 0.1}), {410.0, 55.0, 90.0}};
    const std::vector<Rigid> stage = stage_poses(five_axes, 25);
    for (const auto& [name, camera] : wide_models()) {
        SCOPED_TRACE(name);
        const Projector wide(camera);
        std::vector<RegistrationPose> poses;
        double widest = 0.0;
        for (std::size_t i = 0; i < stage.size(); ++i) {
            const Rigid truth = aside * stage[i] * true_y;
            const Vector6d wrong = (Vector6d() << 0.01, -0.02, 0.015, 3, -2, 4).finished();
            poses.push_back({stage[i], left_perturbed(truth, i % 2 ? wrong : Vector6d(-wrong)),
                             seen(truth, wide)});
            widest = std::max(widest, std::acos(truth.translation.normalized().z()));
        }
        EXPECT_GT(widest, 90.0 * std::numbers::pi / 180.0);
        const Registration result = register_stage(wide, tag, poses, true_y);
        EXPECT_LT(left_difference(aside, result.camera_from_base).norm(), 1e-6);
        EXPECT_LT(left_difference(true_y, result.carriage_from_marker).norm(), 1e-6);
        EXPECT_LT(result.residual_rms_px, 1e-8);
    }
}

TEST(Registration, RefusesATelecentricCamera) {
    CameraModel camera = webcam();
    const std::vector<RegistrationPose> good = observations(stage_poses(xyz_stage, 8));
    camera.projection.kind = Projection::telecentric;
    EXPECT_THROW(register_stage(Projector(camera), tag, good, Rigid{}), NumericalError);
}

TEST(Registration, RefusesAMarkerThatIsPredictedBehindTheCamera) {
    std::vector<RegistrationPose> poses = observations(stage_poses(xyz_stage, 8));
    for (RegistrationPose& pose : poses)
        pose.camera_from_marker.translation.z() -= 1000.0;
    EXPECT_THAT(refusal(poses), HasSubstr("valid region"));
}

// ---- stage motion

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
