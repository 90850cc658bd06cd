// `etalon stability` would notice a renderer that is wrong: the cases are given wrong ones.
#include "bench/stability/stability_case.h"
#include "tests/test.h"

#include <opencv2/imgproc.hpp>

namespace etalon {
namespace {

StabilityCase case_named(const std::string& name) {
    for (const StabilityCase& one : stability_cases())
        if (one.name == name)
            return one;
    throw std::invalid_argument("no case is named " + name);
}

// The image half a gray too bright, its marker a tenth of a pixel too far to the right.
RenderedImage too_bright(const CameraModel& camera, const Scene& scene,
                         const RenderOptions& options) {
    RenderedImage image = render_once(camera, scene, options);
    image.radiance += 0.5 / 255.0;
    return image;
}
RenderedImage shifted(const CameraModel& camera, const Scene& scene, const RenderOptions& options) {
    Scene moved = scene;
    for (PlacedMarker& marker : moved.markers)
        marker.camera_from_marker.translation.x() +=
            0.1 * marker.camera_from_marker.translation.z() / camera.intrinsics.fx;
    return render_once(camera, moved, options);
}
RenderedImage too_bright_on_the_left(const CameraModel& camera, const Scene& scene,
                                     const RenderOptions& options) {
    RenderedImage image = render_once(camera, scene, options);
    image.radiance.colRange(0, camera.width / 2) += 0.5 / 255.0;
    return image;
}
// An image whatever the numbers are.
RenderedImage credulous(const CameraModel& camera, const Scene& scene, const RenderOptions&) {
    RenderedImage image;
    image.radiance = cv::Mat(camera.height, camera.width, CV_32FC1, cv::Scalar(scene.background));
    return image;
}

TEST(Stability, ARightRenderPasses) {
    const StabilityOutcome outcome =
        outcome_of(case_named("marker outside the image"), render_once);
    EXPECT_TRUE(outcome.passed) << outcome.words;
    EXPECT_TRUE(outcome_of(case_named("behind the lens"), render_once).passed);
}

TEST(Stability, CatchesAWrongRender) {
    EXPECT_FALSE(outcome_of(case_named("marker outside the image"), too_bright).passed);
    EXPECT_FALSE(outcome_of(case_named("moved by whole pixels"), too_bright_on_the_left).passed);
    EXPECT_FALSE(outcome_of(case_named("tiny marker, 3 px"), credulous).passed);
}

TEST(Stability, CatchesABrokenSymmetry) {
    EXPECT_TRUE(outcome_of(case_named("mirrored"), credulous).passed);
    EXPECT_FALSE(outcome_of(case_named("mirrored"), shifted).passed);
}

TEST(Stability, CatchesAnImageWhereARefusalIsDue) {
    for (const char* name : {"behind the lens", "nan: pose", "infinity: camera and lens"}) {
        const StabilityOutcome outcome = outcome_of(case_named(name), credulous);
        EXPECT_FALSE(outcome.passed) << name;
    }
    EXPECT_THAT(outcome_of(case_named("nan: pose"), credulous).words,
                HasSubstr("accepted: qx = nan"));
}

TEST(Stability, CountsAnExceptionAsAFailure) {
    const auto throwing = [](const CameraModel&, const Scene&,
                             const RenderOptions&) -> RenderedImage {
        throw NumericalError("not today");
    };
    const StabilityOutcome outcome = outcome_of(case_named("tiny marker, 3 px"), throwing);
    EXPECT_FALSE(outcome.passed);
    EXPECT_EQ(outcome.words, "not today");
}

// All of a group pass; `check` gets each one's outcome.
void expect_all_pass(
    const std::vector<StabilityCase>& cases, const RenderFunction& render,
    const std::function<void(const StabilityOutcome&)>& check = [](const auto&) {}) {
    for (const StabilityCase& one : cases) {
        SCOPED_TRACE(one.name);
        const StabilityOutcome outcome = outcome_of(one, render);
        EXPECT_TRUE(outcome.passed) << outcome.words;
        check(outcome);
    }
}

void has_a_figure(const StabilityOutcome& outcome) {
    EXPECT_GT(outcome.figure, 0.0);
}

TEST(Stability, NumbersWithoutAMeaningAreRefused) {
    expect_all_pass(input_cases(), render_once);
}

TEST(Stability, ProjectionComesBack) {
    expect_all_pass(projection_cases(), render_once);
    expect_all_pass(wide_lens_cases(), render_once);
}

TEST(Stability, StiffServosFollowTheirClosedForm) {
    expect_all_pass(servo_cases(), credulous, has_a_figure);
}

TEST(Stability, CalibrationsAgreeWithLongDouble) {
    expect_all_pass(calibration_cases(), credulous, has_a_figure);
}

TEST(Stability, RegistrationsNameWhatAStageCannotTell) {
    expect_all_pass(registration_cases(), credulous, [](const StabilityOutcome& outcome) {
        EXPECT_FALSE(outcome.words.empty() && outcome.bound > 0.0);
    });
}

TEST(Stability, NamesAreDistinctFitTheTableAndCoverWhatIsPromised) {
    std::set<std::string> names;
    std::string all;
    for (const StabilityCase& one : stability_cases()) {
        EXPECT_TRUE(names.insert(one.name).second) << one.name;
        EXPECT_LE(one.name.size(), 32u) << one.name;
        EXPECT_LE(one.expectation.size(), 22u) << one.expectation;
        all += one.name + "\n";
    }
    for (const char* word :
         {"tilt", "focus", "behind", "fold", "pole", "nan", "infinity", "barrel", "tiny",
          "background", "megapixel", "stiff", "calibrating", "registering"})
        EXPECT_THAT(all, HasSubstr(word));
}

}  // namespace
}  // namespace etalon
