#include "compare/diagnosis/error_signatures.h"

#include "tests/compare/qualification/simulated_run.h"
#include "tests/test.h"

namespace etalon {
namespace {

struct Study {
    SimulatedRun run = demo_run();
    Projector projector{run.camera};
    std::vector<ErrorSignature> signatures;
    std::vector<StageError> stage_errors;

    Study() {
        const auto all = positions(run, run.plan_seed.value());
        SignatureChain chain{
            projector, run.points_mm, run.camera_from_base, run.carriage_from_marker, {}};
        for (std::size_t i = 0; i < all.size(); ++i) {
            chain.poses.emplace_back().hold_out = static_cast<int>(i) >= run.training;
            chain.poses.back().base_from_carriage = base_from_carriage(run.axes, all[i]);
        }
        for (std::size_t k = 0; k < 3; ++k)
            stage_errors.push_back(scale_term(run, all, k).error);
        const auto count = static_cast<std::size_t>(run.hold_out);
        const HoldOutNoise noise{std::vector<double>(count, 0.08),
                                 std::vector<double>(count, 0.007)};
        signatures = error_signatures(chain, stage_errors, noise, 0.1);
    }

    const ErrorSignature& of(const std::string& name) const {
        return *std::ranges::find(signatures, name, &ErrorSignature::name);
    }
};

TEST(ErrorSignatures, ConfoundFocalLengthWithTheScaleOfTheDepthAxis) {
    const Study study;
    EXPECT_THAT(study.of("focal length").confounded_with, Contains("stage scale z"));
    EXPECT_THAT(study.of("stage scale z").confounded_with, Contains("focal length"));
    EXPECT_THAT(study.of("focal length").confounded_with, Not(Contains("stage scale x")));
    EXPECT_TRUE(study.of("focal length").observable);
}

// A larger marker and a stage that moves less look the same: both scale the whole scene.
TEST(ErrorSignatures, ConfoundPrintSizeWithTheScaleOfAllAxesExactly) {
    const Study study;
    const Eigen::VectorXd& print = study.of("marker print size").after;
    const Eigen::VectorXd& scale = study.of("stage scale, all linear axes").after;
    EXPECT_LT((print + scale).norm(), 1e-3 * print.norm());
}

TEST(ErrorSignatures, FindAConstantOffsetNotObservable) {
    const Study study;
    const ErrorSignature& offset = study.of("constant pose offset");
    EXPECT_NEAR(offset.before_rms_mm, 0.1, 1e-6);
    EXPECT_LT(offset.after_rms_mm, 1e-8);
    EXPECT_FALSE(offset.observable);
}

TEST(ErrorSignatures, SeeMostOfThePrincipalPointAbsorbed) {
    const Study study;
    for (const char* name : {"c_x", "c_y", "half pixel"})
        EXPECT_LT(study.of(name).after_rms_mm, 0.15 * study.of(name).before_rms_mm) << name;
}

// The whole chain without noise, not linearised, against the signature: 0.2 % in focal length is
// second order to 1 %.
TEST(ErrorSignatures, AgreeWithTheWholeChain) {
    Study study;
    SimulatedRun run = without_noise(study.run);
    run.true_camera.intrinsics.zoom(1.002);
    const Qualification result = qualify(input_of(run, 3));
    const ErrorSignature& expected = study.of("focal length");
    Eigen::Index k = 0;
    double difference2 = 0.0, power = 0.0;
    for (const AnalysedPose& pose : result.poses)
        if (pose.hold_out) {
            const Eigen::Vector3d signature =
                2e-3 / expected.size * expected.after.segment<3>(3 * k++);
            difference2 += (pose.bias.b3->translation_mm - signature).squaredNorm();
            power += signature.squaredNorm();
        }
    EXPECT_LT(std::sqrt(difference2 / power), 0.1);
}

}  // namespace
}  // namespace etalon
