#include "station/planning/operating_characteristic.h"

#include <tbb/task_arena.h>

#include <numeric>

#include "tests/station/stations.h"

namespace etalon {
namespace {

constexpr const char* mounts =
    R"(camera_mount: {rotation_deg: [1, -2, 0.5], translation_mm: [3, -2, 380]}
marker_mount: )";

StationFile station() {
    static const TemporaryFolder folder;
    return read_station(write_station(folder, replaced(station_text, "marker_mount: ", mounts)));
}

// A detector that is off by much, differently at every pose, and has little noise.
DetectorStudy made_up_study(std::size_t poses, double bias_px, double noise_px) {
    DetectorStudy study;
    for (std::size_t i = 0; i < poses; ++i) {
        DetectorStatistics pose;
        pose.bias.resize(8);
        for (Eigen::Index k = 0; k < 8; ++k)
            pose.bias[k] =
                bias_px * std::sin(7.0 * static_cast<double>(i) + 5.0 * static_cast<double>(k));
        pose.noise_bias = Eigen::VectorXd::Zero(8);
        pose.noise_factor = noise_px * Eigen::MatrixXd::Identity(8, 8);
        pose.frames = 24;
        study.poses.push_back(pose);
    }
    return study;
}

class SimulatedRun : public testing::Test {
protected:
    SimulatedRun()
        : station_(station()),
          plan_(plan_of(station_)),
          simulator_(station_, plan_, made_up_study(plan_.poses.size(), 0.2, 0.01)) {}

    StationFile station_;
    Plan plan_;
    RunSimulator simulator_;
};

// The detector's bias is the same in photo and render: nothing of it may be left.
TEST_F(SimulatedRun, LeavesNothingWhenAllIsAsTold) {
    const Qualification run = qualify(simulator_.exact(simulator_.as_told()));
    ASSERT_FALSE(run.quantities.empty());
    for (const JudgedQuantity& quantity : run.quantities)
        EXPECT_LT(quantity.value, 1e-4 * quantity.limit) << quantity.name;
}

Eigen::VectorXd hold_out_errors(const Qualification& run) {
    std::vector<double> errors;
    for (const AnalysedPose& pose : run.poses)
        if (pose.is_judged())
            errors.insert(errors.end(), pose.bias.b3->translation_mm.begin(),
                          pose.bias.b3->translation_mm.end());
    return Eigen::Map<Eigen::VectorXd>(errors.data(), std::ssize(errors));
}

// The whole chain with its iterations against the one Gauss-Newton step of the signatures. The
// registration's robust loss holds back the largest of residuals that have no noise, which the
// signatures do not know: up to 5 % of the field for most errors, 29 % for k3. Without a detector
// bias, whose correction stops at 0.002 px.
TEST_F(SimulatedRun, EveryErrorLeavesTheFieldThatItsSignatureSays) {
    const RunSimulator unbiased(station_, plan_, made_up_study(plan_.poses.size(), 0.0, 0.01));
    const Qualification told = qualify(unbiased.exact(unbiased.as_told()));
    const Eigen::VectorXd zero = hold_out_errors(told);
    std::vector<std::string> names;
    for (const InjectedError& error : unbiased.errors()) {
        names.push_back(error.name);
        const auto signature =
            std::ranges::find(told.signatures, error.name, &ErrorSignature::name);
        ASSERT_NE(signature, told.signatures.end()) << error.name;
        RunTruth truth = unbiased.as_told();
        error.change(truth, error.size);
        QualificationInput input = unbiased.exact(truth);
        input.options.known_run = &told;
        const Eigen::VectorXd left = hold_out_errors(qualify(input)) - zero;
        const Eigen::VectorXd expected = error.size / signature->size * signature->after;
        const double allowed = 0.35 * expected.norm() + 1e-4 * signature->before.norm();
        EXPECT_LT((left - expected).norm(), allowed) << error.name;
    }
    EXPECT_EQ(names.size(), told.signatures.size());
}

TEST_F(SimulatedRun, DrawsTheSameRunForTheSameNumberAndAnotherForAnother) {
    const RunTruth truth = simulator_.as_told();
    const QualificationInput one = simulator_.draw(truth, 5, 7),
                             again = simulator_.draw(truth, 5, 7),
                             other = simulator_.draw(truth, 5, 8);
    EXPECT_EQ(one.poses[3].corners, again.poses[3].corners);
    EXPECT_NE(one.poses[3].corners, other.poses[3].corners);
}

// A detector that slips at a pose is one of the things that a run has: the stage stood where it
// said, which the photograph's pixels show.
TEST_F(SimulatedRun, LeavesNoPoseOutWhereTheDetectorSlips) {
    QualificationInput input = simulator_.draw(simulator_.as_told(), 5, 7);
    const auto slipped = std::ranges::find(input.poses, true, &VisitedPose::hold_out);
    for (Eigen::Vector2d& corner : slipped->corners)
        corner += Eigen::Vector2d(2.4, -1.8);
    EXPECT_TRUE(qualify(input).outlying.empty());
    slipped->seen_at.reset();
    EXPECT_EQ(qualify(input).outlying.size(), 1u);
}

TEST_F(SimulatedRun, NeedsToKnowWhereTheCameraIs) {
    station_.camera_from_base_nominal.reset();
    EXPECT_THROW(expected_poses(station_, plan_), ConfigError);
}

OperatingCharacteristic of_one_process(const RunSimulator& simulator,
                                       const CharacteristicRequest& request) {
    const CharacteristicRuns runs(simulator, request);
    OperatingCharacteristic result = runs.planned();
    std::vector<std::size_t> all(static_cast<std::size_t>(request.runs));
    std::iota(all.begin(), all.end(), std::size_t{0});
    runs.simulate(all,
                  [&](std::size_t, std::span<const PointRun> points) { add_run(result, points); });
    return result;
}

class Characteristic : public SimulatedRun {
protected:
    OperatingCharacteristic study(const std::vector<std::string>& errors, int runs) const {
        return of_one_process(simulator_, {.runs = runs, .errors = errors});
    }
};

// In proportion to the size, and 1x is where the exact value meets the limit.
TEST_F(Characteristic, FindsTheSizeThatReachesEachLimit) {
    const OperatingCharacteristic result = study({"focal length"}, 2);
    ASSERT_EQ(result.errors.size(), 1u);
    for (std::size_t k = 0; k < result.quantities.size(); ++k) {
        ASSERT_TRUE(result.errors[0].limit_size[k]);
        RunTruth truth = simulator_.as_told();
        const double f = 1.0 + *result.errors[0].limit_size[k];
        CameraModel camera = station_.camera.model;
        camera.intrinsics.fx *= f;
        camera.intrinsics.fy *= f;
        truth.camera = Projector(camera);
        const Qualification run = qualify(simulator_.exact(truth));
        EXPECT_NEAR(run.quantities[k].value / run.quantities[k].limit, 1.0, 2e-3);
        EXPECT_NE(point_at(result.errors[0], k, 2.0), nullptr);
    }
}

TEST_F(Characteristic, GivesTheSameCountsOnOneThread) {
    const OperatingCharacteristic all = study({"focal length"}, 6);
    tbb::task_arena single(1);
    const OperatingCharacteristic one = single.execute([&] { return study({"focal length"}, 6); });
    ASSERT_EQ(all.errors[0].points.size(), one.errors[0].points.size());
    for (std::size_t i = 0; i < one.errors[0].points.size(); ++i) {
        EXPECT_EQ(all.errors[0].points[i].verdict.pass, one.errors[0].points[i].verdict.pass);
        EXPECT_EQ(all.errors[0].points[i].quantities[0].mean_value,
                  one.errors[0].points[i].quantities[0].mean_value);
    }
}

TEST_F(Characteristic, HasNoPointOfAnErrorThatCannotBeSeen) {
    const OperatingCharacteristic result = study({"constant pose offset"}, 1);
    ASSERT_EQ(result.errors.size(), 1u);
    EXPECT_FALSE(result.errors[0].observable);
    EXPECT_THAT(result.errors[0].points, IsEmpty());
    EXPECT_THAT(result.errors[0].reason, HasSubstr("absorbs"));
}

TEST_F(Characteristic, RefusesAnErrorThatNobodyKnows) {
    EXPECT_THROW(study({"focal lenght"}, 1), ConfigError);
}

class ShardedCharacteristic : public Characteristic {
protected:
    void SetUp() override {
        request_.runs = 5;
        request_.errors = {"focal length"};
        planned_.station = "test";
        planned_.made_from = R"({"version": "7"})";
        planned_.detector = {0.01, 0.2, 0.003, 24, 23, 25};
        runs_.emplace(simulator_, request_);
        planned_.result = runs_->planned();
        for (const std::size_t i : {1, 2})
            simulate(folder_ / fmt::format("part-{}", i), {i, 2}, planned_);
    }

    void simulate(const std::filesystem::path& out, const Shard& shard,
                  const StationCharacteristic& planned) {
        RowRecord record(out, oc_rows(planned, shard));
        std::vector<std::size_t> missing;
        for (std::size_t run = 0, unit = 0; run < 5; ++run)
            if (shard.holds(run) && unit++ >= record.units_done())
                missing.push_back(run);
        runs_->simulate(missing, [&](std::size_t run, std::span<const PointRun> points) {
            record.add(rows_of_run(run, points));
        });
    }
    std::string refusal(const std::vector<std::filesystem::path>& shards) {
        return config_error_of([&] { merged_characteristic(shards); });
    }
    std::filesystem::path one() const { return folder_ / "part-1"; }
    std::filesystem::path two() const { return folder_ / "part-2"; }

    TemporaryFolder folder_;
    CharacteristicRequest request_;
    std::optional<CharacteristicRuns> runs_;
    StationCharacteristic planned_;
};

void expect_same(const CharacteristicPoint& one, const CharacteristicPoint& other) {
    EXPECT_EQ(one.size, other.size);
    EXPECT_EQ(one.verdict.pass, other.verdict.pass);
    EXPECT_EQ(one.verdict.fail, other.verdict.fail);
    EXPECT_EQ(one.verdict.other, other.verdict.other);
    EXPECT_EQ(one.refused, other.refused);
    ASSERT_EQ(one.quantities.size(), other.quantities.size());
    for (std::size_t k = 0; k < one.quantities.size(); ++k) {
        EXPECT_EQ(one.quantities[k].counts.pass, other.quantities[k].counts.pass);
        EXPECT_EQ(one.quantities[k].mean_value, other.quantities[k].mean_value);
        EXPECT_EQ(one.quantities[k].mean_uncertainty, other.quantities[k].mean_uncertainty);
    }
}

TEST_F(ShardedCharacteristic, MergedIsThatOfOneProcess) {
    const OperatingCharacteristic whole = of_one_process(simulator_, request_);
    const StationCharacteristic merged = merged_characteristic({two(), one()});
    EXPECT_EQ(merged.station, "test");
    EXPECT_EQ(merged.detector.seen, 23);
    EXPECT_EQ(merged.detector.noise_bias_px, 0.003);
    EXPECT_EQ(merged.result.runs, 5);
    EXPECT_EQ(whole.without_error.verdict.runs(), 5u);
    expect_same(merged.result.without_error, whole.without_error);
    ASSERT_EQ(merged.result.errors.size(), 1u);
    EXPECT_EQ(merged.result.errors[0].limit_size, whole.errors[0].limit_size);
    ASSERT_EQ(merged.result.errors[0].points.size(), whole.errors[0].points.size());
    for (std::size_t i = 0; i < whole.errors[0].points.size(); ++i)
        expect_same(merged.result.errors[0].points[i], whole.errors[0].points[i]);
}

TEST_F(ShardedCharacteristic, GoesOnWhereItWasKilled) {
    const std::string rows = read_text(one() / "results.csv");
    std::filesystem::resize_file(one() / "results.csv", rows.size() / 2);
    EXPECT_THAT(refusal({one(), two()}), HasSubstr("run 2 is missing: the shard is not"));
    simulate(one(), {1, 2}, planned_);
    EXPECT_EQ(read_text(one() / "results.csv"), rows);
}

TEST_F(ShardedCharacteristic, IsNotMergedFromShardsThatDoNotFit) {
    EXPECT_THAT(refusal({one()}), HasSubstr("oc merge: shard 2/2 is missing"));
    EXPECT_THAT(refusal({two(), two()}), HasSubstr("is the same shard as"));
    StationCharacteristic other = planned_;
    other.made_from = R"({"version": "8"})";
    RowRecord(folder_ / "version", oc_rows(other, {2, 2}));
    EXPECT_THAT(refusal({one(), folder_ / "version"}),
                HasSubstr("its 'made_from.version' differs"));
    other = planned_;
    other.result.runs = 6;
    RowRecord(folder_ / "runs", oc_rows(other, {2, 2}));
    EXPECT_THAT(refusal({one(), folder_ / "runs"}), HasSubstr("its 'runs' differs"));
    const std::string rows = read_text(two() / "results.csv");
    write_text(two() / "results.csv", replaced(rows, ",1,0,", ",1,7,"));
    EXPECT_THAT(refusal({one(), two()}), HasSubstr("results.csv:3: is no line of point 1"));
    const std::string description = read_text(two() / "oc.json");
    write_text(two() / "oc.json", replaced(description, "\"made_from\"", "\"made_of\""));
    EXPECT_THAT(refusal({one(), two()}), HasSubstr("oc.json: made_from: is missing"));
}

}  // namespace
}  // namespace etalon
