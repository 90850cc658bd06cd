// What holds for every scene, on a few dozen random ones of the fuzzer's kinds. `render_fuzz` looks
// at as many as there is time for.
#include <tbb/global_control.h>

#include "tests/fuzz/random_scenes.h"
#include "tests/test.h"

namespace etalon::test {
namespace {

void expect_clean(const SceneCheck& check, std::uint64_t seed) {
    for (const Violation& violation : check.violations)
        ADD_FAILURE() << "seed " << seed << ": " << violation.rule << ": " << violation.details;
}

// E, C and the automatic plan agree, no pixel is beyond the scene's radiances or not finite.
TEST(RandomScenes, OrdinaryOnesAreRenderedAlikeByAllMethods) {
    KeptRenderer kept;
    for (std::uint64_t seed = 0; seed < 64; seed += 4) {
        const SceneCheck check = check_scene_of(kept, ordinary_input(seed), 0, {});
        EXPECT_EQ(check.refusal, "") << "seed " << seed;
        expect_clean(check, seed);
    }
}

TEST(RandomScenes, OrdinaryOnesAgreeWithTheReference) {
    KeptRenderer kept;
    for (std::uint64_t seed = 32; seed < 37; ++seed) {
        const SceneCheck check = check_scene_of(kept, ordinary_input(seed), 8,
                                                {.samples_per_scramble = 512, .rounds = 3});
        ASSERT_TRUE(check.reference_gray) << check.refusal;
        expect_clean(check, seed);
    }
}

TEST(RandomScenes, HostileOnesEndInARightImageOrARefusal) {
    KeptRenderer kept;
    int refused = 0, poisoned = 0;
    for (std::uint64_t seed = 16; seed < 32; ++seed) {
        const RandomInput input = hostile_input(seed);
        const SceneCheck check = check_scene_of(kept, input, 0, {});
        expect_clean(check, seed);
        refused += !check.refusal.empty();
        poisoned += !input.poison.empty();
    }
    EXPECT_GT(refused, 0);
    EXPECT_LT(refused, 12);
    EXPECT_GT(poisoned, 0);
}

// A marker blurred by 133 px, of whose image one point a pixel says all but beside the fold of the
// distortion, where the image ends sharply.
TEST(RandomScenes, TheBorderOfTheValidRegionIsSharpInABlurredImage) {
    KeptRenderer kept;
    constexpr std::uint64_t seed = 1140007441;
    const SceneCheck check =
        check_scene_of(kept, hostile_input(seed), 6, {.samples_per_scramble = 256, .rounds = 4});
    EXPECT_EQ(check.refusal, "");
    expect_clean(check, seed);
}

TEST(RandomScenes, AreTheSameBytesForAnyNumberOfThreads) {
    for (std::uint64_t seed = 302; seed <= 308; seed += 2) {
        const RandomInput input = ordinary_input(seed);
        const Renderer renderer(input.camera);
        const cv::Mat many = renderer.render(input.scene).radiance;
        const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
        const cv::Mat alone = renderer.render(input.scene).radiance;
        EXPECT_EQ(std::memcmp(many.data, alone.data, many.total() * many.elemSize()), 0)
            << "seed " << seed;
    }
}

// The checks themselves: a render of another scene is seen as wrong.
TEST(RandomScenes, AWrongRenderIsNoticed) {
    const RandomInput input = ordinary_input(104);
    Scene moved = input.scene;  // by a third of a pixel
    moved.markers[0].camera_from_marker.translation.x() +=
        0.33 * moved.markers[0].camera_from_marker.translation.z() / input.camera.intrinsics.fx;
    const ReferenceCheck check = check_against_reference(
        Renderer(input.camera).render(moved).radiance, input.camera, input.scene,
        probe_pixels(input.camera, input.scene, 12, 3), 0.1, {.samples_per_scramble = 256});
    EXPECT_FALSE(check.within());
}

}  // namespace
}  // namespace etalon::test
