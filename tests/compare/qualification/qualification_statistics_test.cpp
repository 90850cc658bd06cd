// How often the verdict is right, over seeds of the noise, with the demo's plan. 100 runs: a case
// that must come out in 99 % of runs does so at least 96 times in all but 0.4 % of such tests
// (binomial).
#include <gtest/gtest.h>

#include "compare/qualification/qualification.h"
#include "tests/compare/qualification/simulated_run.h"

namespace etalon {
namespace {

constexpr int runs = 100;

int count(const SimulatedRun& run, Outcome outcome) {
    int found = 0;
    for (std::uint64_t seed = 1; seed <= runs; ++seed)
        found += qualify(input_of(run, seed)).verdict == outcome ? 1 : 0;
    return found;
}

TEST(QualificationStatistics, PerfectCamerasPass) {
    EXPECT_GE(count(demo_run(), Outcome::pass), 96);
}

TEST(QualificationStatistics, FocalLengthsOffByHalfAPercentFail) {
    SimulatedRun run = demo_run();
    run.true_camera.intrinsics.fx *= 0.995;
    run.true_camera.intrinsics.fy *= 0.995;
    EXPECT_GE(count(run, Outcome::fail), 96);
}

TEST(QualificationStatistics, DistortionsOffByTenPercentFail) {
    SimulatedRun run = demo_run();
    run.true_camera.distortion.k1 *= 0.9;
    EXPECT_GE(count(run, Outcome::fail), 96);
}

TEST(QualificationStatistics, StagesWithTheDepthScaleOffNeverPass) {
    SimulatedRun run = demo_run();
    run.true_scale[2] = 1.002;
    EXPECT_EQ(count(run, Outcome::pass), 0);
}

TEST(QualificationStatistics, StagesWithTheHeightScaleOffNeverPass) {
    SimulatedRun run = demo_run();
    run.true_scale[1] = 0.998;
    EXPECT_EQ(count(run, Outcome::pass), 0);
}

}  // namespace
}  // namespace etalon
