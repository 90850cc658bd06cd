// How often the verdict is right, over seeds of the noise, with the demo's plan. 100 runs: a case
// that must come out in 99 % of runs does so at least 96 times in all but 0.4 % of such tests
// (binomial).
#include <gtest/gtest.h>

#include "compare/qualification/qualification.h"
#include "tests/compare/qualification/simulated_run.h"

namespace etalon {
namespace {

constexpr int runs = 100;

int count(const std::function<void(SimulatedRun&)>& change, Outcome outcome) {
    SimulatedRun run = demo_run();
    change(run);
    int found = 0;
    for (std::uint64_t seed = 1; seed <= runs; ++seed)
        found += qualify(input_of(run, seed)).verdict == outcome ? 1 : 0;
    return found;
}

TEST(QualificationStatistics, PerfectCamerasPass) {
    EXPECT_GE(count([](SimulatedRun&) {}, Outcome::pass), 96);
}

TEST(QualificationStatistics, FocalLengthsOffByHalfAPercentFail) {
    const auto shorter = [](SimulatedRun& run) { run.true_camera.intrinsics.zoom(0.995); };
    EXPECT_GE(count(shorter, Outcome::fail), 96);
}

TEST(QualificationStatistics, DistortionsOffByTenPercentFail) {
    const auto flatter = [](SimulatedRun& run) { run.true_camera.distortion.k1 *= 0.9; };
    EXPECT_GE(count(flatter, Outcome::fail), 96);
}

TEST(QualificationStatistics, StagesWithTheScaleOfDepthOrHeightOffNeverPass) {
    for (const auto& [axis, scale] : {std::pair(2, 1.002), std::pair(1, 0.998)}) {
        const auto stretched = [&](SimulatedRun& run) { run.true_scale.at(axis) = scale; };
        EXPECT_EQ(count(stretched, Outcome::pass), 0) << axis;
    }
}

}  // namespace
}  // namespace etalon
