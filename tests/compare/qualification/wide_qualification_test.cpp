// A run before a wide lens, at corner level: as declared it passes, an error fails it and is named.

#include "core/geometry/units.h"
#include "tests/compare/qualification/injected_errors.h"
#include "tests/test.h"

namespace etalon {
namespace {

Qualification qualified_wide(SimulatedRun run, std::uint64_t seed = 1) {
    run.look_for_causes = true;
    return qualify(input_of(run, seed));
}

std::vector<std::string> best_names(const Qualification& result) {
    const Cause* cause = result.causes ? result.causes->named() : nullptr;
    return cause && cause->errors.size() == 1 ? cause->errors.front().names
                                              : std::vector<std::string>{};
}

// Angles to the axis of the marker's places, deg: the least and the largest.
std::pair<double, double> angles_deg(const std::vector<AnalysedPose>& poses) {
    std::pair<double, double> ends{180.0, 0.0};
    for (const AnalysedPose& pose : poses) {
        const double angle =
            std::acos(pose.bias.predicted.translation.normalized().z()) * deg_per_rad;
        ends = {std::min(ends.first, angle), std::max(ends.second, angle)};
    }
    return ends;
}

TEST(WideQualification, PassesALensThatIsAsDeclaredBeyondNinetyDegreesToo) {
    for (const double aside : {0.67, 1.35}) {
        const SimulatedRun run = wide_run(aside);
        const Qualification result = qualify(input_of(run, 1));
        EXPECT_EQ(result.verdict, Outcome::pass);
        EXPECT_THAT(result.reasons, IsEmpty());
        const auto [least, largest] = angles_deg(result.poses);
        EXPECT_LT(least, aside < 1.0 ? 25.0 : 62.0);
        EXPECT_GT(largest, aside < 1.0 ? 60.0 : 90.0);
    }
}

// Far aside the image is stretched unlike in two directions, and no field of positions follows the
// error: no PASS. Elsewhere it is a FAIL.
TEST(WideQualification, FailsAWrongLensAndNamesIt) {
    for (const bool is_far_aside : {true, false}) {
        SimulatedRun run = wide_run(is_far_aside ? 1.35 : 0.67);
        run.true_camera.intrinsics.zoom(1.005);
        const Qualification result = qualified_wide(run);
        EXPECT_NE(result.verdict, Outcome::pass);
        EXPECT_TRUE(is_far_aside || result.verdict == Outcome::fail);
        EXPECT_THAT(best_names(result), Contains("focal length"));
    }
    SimulatedRun run = wide_run();
    run.true_camera.distortion.k1 *= 1.1;
    const Qualification result = qualified_wide(run);
    EXPECT_EQ(result.verdict, Outcome::fail);
    EXPECT_THAT(best_names(result), Contains("k1"));
}

TEST(WideQualification, FindsTheParametersOfItsProjection) {
    SimulatedRun run = wide_run();
    run.camera.projection = {Projection::double_sphere, -0.17, 0.59};
    run.camera.intrinsics.fx = run.camera.intrinsics.fy = 195.0;
    run.camera.distortion = {};
    run.true_camera = run.camera;
    EXPECT_EQ(qualified_wide(run).verdict, Outcome::pass);
    run.true_camera.projection.b += 0.004;
    const Qualification result = qualified_wide(run);
    EXPECT_EQ(result.verdict, Outcome::fail);
    EXPECT_THAT(best_names(result), Contains("alpha"));
}

std::vector<std::string> names(const std::vector<CameraError>& errors) {
    std::vector<std::string> all;
    for (const CameraError& error : errors)
        all.push_back(error.name);
    return all;
}

TEST(WideQualification, LooksForErrorsThatTheLensCanHave) {
    CameraModel camera = demo_run().camera;
    EXPECT_THAT(names(named_camera_errors(camera)), Not(Contains("k7")));
    EXPECT_THAT(names(further_camera_errors(camera)), Contains("sensor tilt tau_x"));
    camera.projection = {Projection::unified, 1.31};
    EXPECT_THAT(names(named_camera_errors(camera)), testing::IsSupersetOf({"k7", "xi"}));
    EXPECT_THAT(names(further_camera_errors(camera)), Each(Not(HasSubstr("tilt"))));
    // At the end of its range it can be off one way only.
    camera.projection = {Projection::double_sphere, 0.1, 1.0};
    EXPECT_THAT(names(named_camera_errors(camera)), Not(Contains("alpha")));
}

// At 100 degrees r^9 is 170 times what it is at 1 radian: the size must not fold the image.
TEST(WideQualification, TakesErrorsThatAreSmallAllOverTheImage) {
    const SimulatedRun run = wide_run();
    for (const CameraError& error : named_camera_errors(run.camera))
        for (const double side : {-1.0, 1.0}) {
            CameraModel off = run.camera;
            error.change(off, side * error.size);
            const Eigen::Vector3d aside(std::sin(1.75), 0.0, std::cos(1.75));
            const auto moved = Projector(off).project(aside);
            ASSERT_TRUE(moved) << error.name;
            EXPECT_LT((*moved - *Projector(run.camera).project(aside)).norm(), 1.0) << error.name;
        }
}

}  // namespace
}  // namespace etalon
