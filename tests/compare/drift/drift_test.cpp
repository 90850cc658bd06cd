#include "core/statistics/distributions.h"
#include "tests/compare/drift/simulated_drift.h"
#include "tests/test.h"

namespace etalon {
namespace {

TEST(Median, IsTheMiddleAndItsDeviationThatOfNormalValues) {
    EXPECT_EQ(median({7.0, 5.0, 100.0}), 7.0);
    EXPECT_EQ(median({7.0, 5.0, 100.0, 1.0}), 6.0);
    EXPECT_NEAR(median_deviation({1, 2, 3, 4, 500}), 1.4826, 1e-12);
}

TEST(TargetMovement, IsShiftGrowthAndTurnAboutTheMiddleOfThePoints) {
    const TargetReference reference(grid_of_points(7, 5, 100, 200, 20));
    EXPECT_NEAR(reference.centre().x(), 160.0, 1e-12);
    EXPECT_NEAR(reference.centre().y(), 240.0, 1e-12);
    // Mean squares of -3..3 and -2..2 times 20 px: 4 and 2 times 400.
    EXPECT_NEAR(reference.radius(), std::sqrt(6.0 * 400.0), 1e-12);
    TargetPoints moved;
    for (const auto& [id, pixel] : reference.points()) {
        const Eigen::Vector2d arm = pixel - reference.centre();
        moved[id] = pixel + Eigen::Vector2d(0.3, -0.7) + 1e-3 * arm +
                    2e-3 * Eigen::Vector2d(-arm.y(), arm.x());
    }
    const auto look = reference.look(moved);
    ASSERT_TRUE(look);
    const Movement expected(0.3, -0.7, 1e-3 * reference.radius(), 2e-3 * reference.radius());
    EXPECT_LT((look->movement - expected).norm(), 1e-12);
    EXPECT_LT(misfit(look->residuals), 1e-12);
    // What the movement does at a point is how far that point went.
    EXPECT_LT((reference.at({100, 200}) * look->movement - (moved.at(0) - reference.points().at(0)))
                  .norm(),
              1e-12);
    double farthest = 0.0;
    for (const auto& [id, pixel] : moved)
        farthest = std::max(farthest, (pixel - reference.points().at(id)).norm());
    EXPECT_NEAR(reference.largest(look->movement), farthest, 1e-12);
}

TEST(TargetMovement, IsTheSameFromAPartOfThePoints) {
    const TargetReference reference(grid_of_points(7, 5, 100, 200, 20));
    TargetPoints part;
    for (const auto& [id, pixel] : reference.points())
        if (id % 2 == 0)
            part[id] = pixel + Eigen::Vector2d(0.3, 0.0);
    part[1000] = {5, 5};  // unknown points say nothing
    const auto look = reference.look(part);
    ASSERT_TRUE(look);
    EXPECT_LT((look->movement - Movement(0.3, 0, 0, 0)).norm(), 1e-12);
    EXPECT_EQ(look->residuals.size(), 18u);
}

TEST(TargetMovement, NeedsHalfOfThePointsAndFourThatAreApart) {
    const TargetReference reference(grid_of_points(4, 2, 100, 200, 20));
    const auto first = [&](int count) {
        TargetPoints points;
        for (int id = 0; id < count; ++id)
            points[id] = reference.points().at(id);
        return points;
    };
    EXPECT_TRUE(reference.look(first(4)));
    EXPECT_FALSE(reference.look(first(3)));
    EXPECT_FALSE(reference.look({}));
    TargetPoints not_finite = first(8);
    not_finite[2].x() = std::nan("");
    EXPECT_FALSE(reference.look(not_finite));
    EXPECT_THROW(TargetReference(first(3)), NumericalError);
    EXPECT_THROW(TargetReference({{0, {5, 5}}, {1, {5, 5}}, {2, {5, 5}}, {3, {5, 5}}}),
                 NumericalError);
    not_finite.erase(0);
    EXPECT_THROW(TargetReference{not_finite}, NumericalError);
}

std::vector<DriftBlock> blocks_of(int count, const std::function<Movement(double)>& movement) {
    std::vector<DriftBlock> blocks;
    for (int i = 0; i < count; ++i)
        blocks.push_back({Minutes(0.25 * i), movement(0.25 * i), {}});
    return blocks;
}

TEST(DriftRate, OfALineIsItsSlopeAndIsWorstWhereTheImageEnds) {
    const TargetReference reference(grid_of_points(7, 5, 40, 50, 20));
    const double radius = reference.radius();
    // A growth of 100 ppm per minute about (100, 90) and nothing else.
    const auto rate = estimate_drift(
        blocks_of(20, [&](double t) { return Movement(7, 5, 1e-4 * radius * t, 0); }), reference,
        {640, 480}, 0.01);
    ASSERT_TRUE(rate);
    EXPECT_LT((rate->per_min - Movement(0, 0, 1e-4 * radius, 0)).norm(), 1e-12);
    EXPECT_EQ(rate->worst_pixel, Eigen::Vector2d(639.5, 479.5));
    EXPECT_NEAR(rate->worst_px_per_min, 1e-4 * std::hypot(539.5, 389.5), 1e-12);
    EXPECT_NEAR(rate->expanded_uncertainty_px_per_min, 0.0, 1e-10);
    EXPECT_EQ(rate->shape_px_per_min, 0.0);
    EXPECT_NEAR(rate->to.count() - rate->from.count(), 4.75, 1e-12);
}

// Residuals of one component that alternate, +-a: the textbook's standard error of a slope, and no
// widening, as neighbours differ.
TEST(DriftRate, HasTheUncertaintyOfALeastSquaresLine) {
    const TargetReference reference(grid_of_points(7, 5, 40, 50, 20));
    int i = 0;
    const auto blocks = blocks_of(
        16, [&](double t) { return Movement(0.01 * t + (i++ % 2 ? 0.1 : -0.1), 0, 0, 0); });
    const auto rate = estimate_drift(blocks, reference, {640, 480}, 0.025);
    ASSERT_TRUE(rate);
    double st = 0, sx = 0, stt = 0, stx = 0;
    for (const DriftBlock& block : blocks) {
        st += block.time.count() / 16;
        sx += block.movement[0] / 16;
    }
    for (const DriftBlock& block : blocks) {
        stt += std::pow(block.time.count() - st, 2);
        stx += (block.time.count() - st) * (block.movement[0] - sx);
    }
    double squares = 0;
    for (const DriftBlock& block : blocks)
        squares += std::pow(block.movement[0] - sx - stx / stt * (block.time.count() - st), 2);
    EXPECT_NEAR(rate->per_min[0], stx / stt, 1e-12);
    EXPECT_NEAR(rate->standard_uncertainty[0], std::sqrt(squares / 14 / stt), 1e-12);
    EXPECT_EQ(rate->block_correlation, 0.0);
    EXPECT_NEAR(rate->coverage_factor, 2.144787, 1e-6);  // Student, 97.5 %, 14 degrees of freedom
    EXPECT_NEAR(rate->bound_px_per_min,
                rate->worst_px_per_min + rate->expanded_uncertainty_px_per_min, 1e-12);
}

// A slow swing about the line: neighbours are alike, and the uncertainty is widened by it.
TEST(DriftRate, IsLessCertainWhereNeighboursAreAlike) {
    const TargetReference reference(grid_of_points(7, 5, 40, 50, 20));
    const auto swing = [&](double period) {
        return *estimate_drift(
            blocks_of(
                20,
                [=](double t) { return Movement(0.1 * std::sin(6.283 * t / period), 0, 0, 0); }),
            reference, {640, 480}, 0.01);
    };
    EXPECT_GT(swing(2.5).block_correlation, 0.7);  // cos(36 deg) = 0.81, less the ends
    EXPECT_EQ(swing(0.61).block_correlation, 0.0);
    EXPECT_GT(swing(2.5).standard_uncertainty[0], 2.0 * swing(0.61).standard_uncertainty[0]);
}

// The points go apart in a way that is no similarity: every second one outwards, the others in.
TEST(DriftRate, SeesPointsDriftAgainstEachOther) {
    const TargetReference reference(grid_of_points(4, 2, 100, 200, 20));
    std::vector<DriftBlock> blocks = blocks_of(20, [](double) { return Movement::Zero(); });
    for (DriftBlock& block : blocks)
        for (const auto& [id, pixel] : reference.points())
            block.residuals[id] = {0.0, (id % 2 ? 0.05 : -0.05) * block.time.count()};
    const auto rate = estimate_drift(blocks, reference, {640, 480}, 0.01);
    ASSERT_TRUE(rate);
    EXPECT_NEAR(rate->shape_px_per_min, 0.05 * std::sqrt(8.0 / 6.0), 1e-12);
    EXPECT_LT(rate->bound_px_per_min, 1e-9);
    EXPECT_FALSE(rate->below(0.02));
    EXPECT_TRUE(rate->below(0.06));
}

TEST(DriftRate, NeedsFifteenBlocksAtDifferentTimes) {
    const TargetReference reference(grid_of_points(4, 2, 100, 200, 20));
    const auto still = [](double) { return Movement::Zero(); };
    EXPECT_FALSE(estimate_drift(blocks_of(14, still), reference, {640, 480}, 0.01));
    EXPECT_TRUE(estimate_drift(blocks_of(15, still), reference, {640, 480}, 0.01));
    std::vector<DriftBlock> at_once(20, DriftBlock{Minutes(1), Movement::Zero(), {}});
    EXPECT_FALSE(estimate_drift(at_once, reference, {640, 480}, 0.01));
}

TEST(DriftMonitor, SaysThatAStillCameraIsStableAsSoonAsItCanKnow) {
    const DriftMonitor monitor = SimulatedDrift{}.watch(7);
    ASSERT_TRUE(monitor.stable());
    // 15 blocks of a quarter of a minute.
    EXPECT_NEAR(monitor.frames().back().time.count(), 3.75, 0.02);
    EXPECT_TRUE(monitor.jumps().empty());
    // 225 frames; the median of frames' standard deviations is known to about 1 %.
    EXPECT_NEAR(*monitor.point_noise_px(), 0.05, 0.002);
    // The noise of the whole target is that of a point over sqrt(54), known to 8 %.
    EXPECT_NEAR(*monitor.shake_px(), 0.05 / std::sqrt(54.0), 0.0017);
}

// d(t) = A (1 - exp(-t / T)): what a line through a window sees is the mean rate over it, and no
// window may be called stable whose line is steeper than the limit.
TEST(DriftMonitor, WaitsForTheEndOfAWarmUp) {
    SimulatedDrift warm_up;
    constexpr double amplitude = 3.0, time_constant = 6.0;
    warm_up.moved = [](const Eigen::Vector2d& pixel, double t) -> Eigen::Vector2d {
        return pixel + Eigen::Vector2d(0, amplitude * (1.0 - std::exp(-t / time_constant)));
    };
    const DriftMonitor monitor = warm_up.watch(7);
    ASSERT_TRUE(monitor.stable());
    const double end = monitor.rates().back().to.count();
    const auto rate_at = [](double t) {
        return amplitude / time_constant * std::exp(-t / time_constant);
    };
    // Below the limit now, and at the middle of the window too (the window is short against T).
    EXPECT_LT(rate_at(end - 2.5), 0.02);
    // U is below 0.01 px/min (0.006 by noise; the curvature counts as scatter), so that a line of
    // 0.01 is called stable: half a window after the rate itself, and a block or two by the noise.
    EXPECT_LT(end, time_constant * std::log(amplitude / time_constant / 0.010) + 2.5 + 0.5);
    EXPECT_TRUE(monitor.jumps().empty());
    // Early on the rate is the rate of the warm-up: A / T exp(-t / T) averaged over the line.
    const DriftRate& first = monitor.rates().front();
    EXPECT_GT(first.worst_px_per_min, rate_at(first.to.count()));
    EXPECT_LT(first.worst_px_per_min, rate_at(0.0));
    EXPECT_GT(first.bound_px_per_min, 0.3);
}

TEST(DriftMonitor, NamesAJumpWithItsTimeAndJudgesAnew) {
    SimulatedDrift bumped;
    bumped.moved = [](const Eigen::Vector2d& pixel, double t) -> Eigen::Vector2d {
        return t < 3.0 ? pixel : pixel + Eigen::Vector2d(0.12, -0.05);
    };
    const DriftMonitor monitor = bumped.watch(7);
    ASSERT_EQ(monitor.jumps().size(), 1u);
    const DriftJump& jump = monitor.jumps().front();
    EXPECT_NEAR(jump.time.count(), 3.0, 1e-9);
    // Medians of a few frames whose noise is 0.0068 px: 5 sd of their difference.
    EXPECT_NEAR(jump.movement[0], 0.12, 0.03);
    EXPECT_NEAR(jump.movement[1], -0.05, 0.03);
    EXPECT_NEAR(jump.size_px, 0.13, 0.04);
    ASSERT_TRUE(monitor.stable());
    EXPECT_NEAR(monitor.frames().back().time.count(), 3.0 + 3.75, 0.3);
    EXPECT_EQ(monitor.frames().front().part, 0);
    EXPECT_EQ(monitor.frames().back().part, 1);
    EXPECT_LT(std::abs(monitor.frames().back().movement[0]), 0.05);
}

TEST(DriftMonitor, IsNotStableWhileTheTargetTilts) {
    SimulatedDrift tilting;
    // Perspective: lines converge; no similarity, and none of the image's corners tells.
    tilting.moved = [](const Eigen::Vector2d& pixel, double t) -> Eigen::Vector2d {
        const Eigen::Vector2d arm = pixel - Eigen::Vector2d(310, 200);
        return pixel + 4e-6 * t * arm.x() * arm;
    };
    tilting.minutes = 20.0;
    const DriftMonitor monitor = tilting.watch(7);
    EXPECT_FALSE(monitor.stable());
    EXPECT_GT(monitor.rates().back().shape_px_per_min, 0.02);
}

TEST(DriftMonitor, IsNotMovedByFramesThatAreWildOrMissing) {
    DriftMonitor monitor(drift_plan({640, 480}, Minutes(1.0 / 60.0), Minutes(10)));
    RandomStream random(7, 5);
    const TargetPoints target = grid_of_points(4, 3, 100, 150, 90);
    for (int frame = 0; frame < 300; ++frame) {
        TargetPoints points;
        for (const auto& [id, pixel] : target)
            points[id] = pixel + 0.01 * Eigen::Vector2d{random.normal(), random.normal()} +
                         (frame % 7 == 5 ? Eigen::Vector2d(3, 2) : Eigen::Vector2d(0, 0));
        if (frame % 5 == 2)
            points.clear();
        monitor.add(Minutes(frame / 60.0), points);
    }
    EXPECT_TRUE(monitor.jumps().empty());
    ASSERT_FALSE(monitor.rates().empty());
    EXPECT_LT(monitor.rates().back().bound_px_per_min, 0.02);
    EXPECT_FALSE(monitor.frames()[2].seen);
    EXPECT_TRUE(monitor.frames()[3].seen);
}

TEST(DriftMonitor, HasNoRateWithoutATarget) {
    DriftMonitor monitor(drift_plan({640, 480}, Minutes(1.0 / 60.0), Minutes(10)));
    for (int frame = 0; frame < 600; ++frame)
        monitor.add(Minutes(frame / 60.0), frame % 2 ? TargetPoints{} : TargetPoints{{3, {5, 7}}});
    EXPECT_TRUE(monitor.rates().empty());
    EXPECT_FALSE(monitor.stable());
    EXPECT_FALSE(monitor.point_noise_px());
    EXPECT_FALSE(monitor.shake_px());
}

TEST(DriftMonitor, SharesTheChanceOfErrorAmongAllJudgements) {
    // 60 min have 240 blocks; from the 15th on each is judged over three windows.
    EXPECT_EQ(drift_plan({640, 480}, Minutes(1.0 / 60.0), Minutes(60)).judgements, 3 * 226);
    EXPECT_EQ(drift_plan({640, 480}, Minutes(1.0 / 60.0), Minutes(1)).judgements, 1);
    // Blocks are no shorter than the interval between frames.
    EXPECT_EQ(drift_plan({640, 480}, Minutes(2.0), Minutes(60)).judgements, 3 * 16);
}

}  // namespace
}  // namespace etalon
