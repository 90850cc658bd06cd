#include "compare/diagnosis/image_coherence.h"

#include "core/statistics/random.h"
#include "tests/test.h"

namespace etalon {
namespace {

// Four corners of each pose over an image of 512 x 384; `left_at` beside noise of 1, and as much as
// `common` of each pose in all its corners.
template <class LeftAt>
std::vector<PoseResiduals> poses_with(std::uint64_t seed, double common, const LeftAt& left_at) {
    std::vector<PoseResiduals> poses;
    for (std::uint64_t i = 0; i < 70; ++i) {
        RandomStream random(seed, 1, i);
        PoseResiduals pose{Eigen::VectorXd(8), Eigen::VectorXd(8)};
        const double x = 450.0 * random.uniform(), y = 320.0 * random.uniform();
        const Eigen::Vector2d shift = common * Eigen::Vector2d(random.normal(), random.normal());
        for (Eigen::Index k = 0; k < 4; ++k) {
            const Eigen::Vector2d place(x + (k % 2) * 61.0, y + (k / 2) * 57.0);
            pose.place_px.segment<2>(2 * k) = place;
            pose.left.segment<2>(2 * k) =
                shift + Eigen::Vector2d(random.normal(), random.normal()) + left_at(place);
        }
        poses.push_back(pose);
    }
    return poses;
}

Eigen::Vector2d nothing(const Eigen::Vector2d&) {
    return Eigen::Vector2d::Zero();
}

TEST(ImageCoherence, SeesWhatDependsOnThePlaceAlone) {
    const auto ripple = [](const Eigen::Vector2d& place) {
        return Eigen::Vector2d(3.0 * std::sin(place.x() / 11.0), 3.0 * std::sin(place.y() / 11.0));
    };
    const ImageCoherence found = image_coherence(poses_with(1, 0.0, ripple), 512, 384);
    EXPECT_GT(found.deviations, 1.3 * coherence_deviations);
    // 9 of 9 + 2, less by what it changes within a bin of 27 px: sinc(27 / 22)^2.
    EXPECT_NEAR(found.share, 9.0 / 11.0 * std::pow(std::sin(27.0 / 22.0) / (27.0 / 22.0), 2), 0.15);
    EXPECT_NEAR(found.bin_px, 640.0 / 24.0, 1e-9);
}

// Poses that scatter as a whole: their corners agree with each other, poses do not.
TEST(ImageCoherence, TakesNoScatterOfPosesForADistortion) {
    for (const double common : {0.0, 5.0}) {
        int found = 0;
        for (std::uint64_t seed = 1; seed <= 200; ++seed)
            found += image_coherence(poses_with(seed, common, nothing), 512, 384).deviations >
                             coherence_deviations
                         ? 1
                         : 0;
        EXPECT_LE(found, 2) << common;  // of 0.2 that 0.1 % make, 3 come in 1 test of 1000
    }
}

TEST(ImageCoherence, RefusesWhatDoesNotAgree) {
    std::vector<PoseResiduals> poses = poses_with(1, 0.0, nothing);
    poses[3].left.conservativeResize(6);
    EXPECT_THROW(image_coherence(poses, 512, 384), NumericalError);
    poses = poses_with(1, 0.0, nothing);
    poses[3].left[0] = NAN;
    EXPECT_THROW(image_coherence(poses, 512, 384), NumericalError);
}

}  // namespace
}  // namespace etalon
