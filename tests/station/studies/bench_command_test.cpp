// `etalon bench` at its smallest: what it writes and what it refuses. Its figures are for
// docs/performance.md; only their plausibility is tested here.

#include <nlohmann/json.hpp>

#include "bench/bench_report.h"
#include "sim/scene/pose_volume.h"
#include "station/studies/commands.h"
#include "tests/test.h"

namespace etalon {
namespace {

TEST(BenchCommand, QuickWritesEveryMethodWithOneDefaultRowPerScene) {
    const TemporaryFolder folder;
    const BenchArguments arguments{.scenes = {"webcam-1500"},
                                   .out = folder / "bench",
                                   .poses = 2,
                                   .throughput = 10,
                                   .quick = true};
    EXPECT_EQ(run_bench(arguments), 0);

    const std::vector<std::string> lines =
        split(trimmed(read_text(folder / "bench" / "bench.csv")), '\n');
    EXPECT_EQ(lines.front(),
              "scene,method,setting,cpu_ms,rms,p99,max,edge_shift_px,ns_per_pixel,"
              "corrected_rms,reference_se");
    std::map<std::string, int> rows;
    for (std::size_t i = 1; i < lines.size(); ++i) {
        const std::vector<std::string> cells = split(lines[i], ',');
        ASSERT_EQ(cells.size(), 11u) << lines[i];
        for (std::size_t c = 3; c < cells.size(); ++c)
            EXPECT_GE(parse_number(cells[c]).value(), 0.0) << lines[i];
        ++rows[cells[0] + " " + cells[1]];
    }
    EXPECT_EQ(rows["webcam-1500 default"], 1);
    EXPECT_EQ(rows["cloud default"], 1);
    for (const char* method : {"E", "C", "published", "published-linearised", "qmc"})
        EXPECT_GE(rows[std::string("webcam-1500 ") + method], 1) << method;

    EXPECT_THAT(read_text(folder / "bench" / "bench.svg"), HasSubstr("webcam-1500: RMS"));
    EXPECT_THAT(read_text(folder / "bench" / "table.md"), HasSubstr("| webcam-1500 | default |"));
    const auto json = nlohmann::json::parse(read_text(folder / "bench" / "bench.json"));
    EXPECT_EQ(json["etalon"], "bench/1");
    EXPECT_EQ(json["rows"].size() + 1, lines.size());
    EXPECT_GT(json["throughput"]["frames_per_s"], 0.0);
}

TEST(BenchCommand, RefusesAnUnknownSceneWithAListOfThem) {
    BenchArguments arguments;
    arguments.scenes = {"sharp-500", "webcam-501"};
    const std::string error = config_error_of([&] { run_bench(arguments); });
    EXPECT_THAT(error, HasSubstr("webcam-501"));
    for (const BenchmarkScene& scene : benchmark_scenes())
        EXPECT_THAT(error, HasSubstr(scene.name));
}

TEST(BenchCommand, RefusesSampleCountsThatTheReferenceCannotTake) {
    BenchArguments arguments;
    arguments.reference_samples = 1000;
    EXPECT_THROW(run_bench(arguments), ConfigError);
}

BenchRow made_row(const std::string& method, const std::string& setting, double ms, double rms) {
    BenchRow row{"webcam-500", method, setting, ms, {}};
    row.error.rms_gray = rms;
    row.error.reference_rms_gray = 0.02;
    return row;
}

TEST(BenchReport, TheFrontIsWhatNothingBeatsInTimeAndError) {
    BenchScene scene;
    scene.name = "webcam-500";
    scene.rows = {made_row("default", "0.1", 2.0, 0.04), made_row("E", "k1", 1.0, 0.5),
                  made_row("E", "k8", 9.0, 0.021),  // as far as the reference can tell, exact
                  made_row("published", "n256", 30.0, 1.5)};
    EXPECT_EQ(pareto_words(scene),
              "webcam-500: default is on the front: nothing is both faster and more exact\n"
              "  front: default, E k1, E k8\n");
    scene.rows.push_back(made_row("E", "k2", 1.5, 0.03));
    EXPECT_THAT(pareto_words(scene), HasSubstr("default is not on the front: E k2 is faster"));
}

TEST(BenchReport, ChecksFailBelowThePromisedRatio) {
    BenchResult result;
    result.scenes.resize(1);
    BenchScene& scene = result.scenes.front();
    scene.name = "webcam-500";
    scene.rows = {made_row("default", "0.1", 2.0, 0.03), made_row("published", "n256", 29.0, 1.5)};
    const auto failed = [&] {
        std::string names;
        for (const BenchCheck& check : bench_checks(result))
            names += check.reached ? "" : check.what + ";";
        return names;
    };
    EXPECT_EQ(failed(), "webcam-500: time of published n256 over default's;");  // 14.5
    scene.rows[1].cpu_ms = 31.0;
    EXPECT_EQ(failed(), "");
    scene.rows[0].error.max_sigmas = 4.1;
    scene.ns_per_ray = 9.5;
    EXPECT_EQ(failed(), "webcam-500: max <= 0.1 gray + 4 s.e.;webcam-500: baseline, ns per ray;");
}

// A ratio of 16 with 1 % of error each time: a fall by a tenth is told from noise, one by 3 % not.
TEST(BenchAgainst, NamesWhatFellBeyondMarginAndNoise) {
    BenchResult result;
    result.scenes.resize(2);
    const auto measured = [&](double first_ms, double second_ms) -> const BenchResult& {
        for (std::size_t i = 0; i < 2; ++i) {
            BenchScene& scene = result.scenes[i];
            scene.name = i == 0 ? "webcam-500" : "sharp-500";
            scene.rows = {made_row("default", "0.1", i == 0 ? first_ms : second_ms, 0.03),
                          made_row("published", "n256", 32.0, 1.5)};
            scene.ratio_error = 0.01;
        }
        return result;
    };
    const TemporaryFolder folder;
    write_text(folder / "bench.json", bench_json(measured(2.0, 4.0)));
    const BenchBefore before = read_bench(folder / "bench.json");
    EXPECT_THAT(before.machine, HasSubstr("processors"));
    EXPECT_THAT(before.compiler, testing::AnyOf(HasSubstr("GNU"), HasSubstr("Clang")));
    const auto slower = [&](double first_ms, double second_ms, double margin) {
        std::string names;
        for (const SpeedChange& each : speed_changes(before, measured(first_ms, second_ms), margin))
            names += each.is_slower ? each.now.name + ";" : "";
        return names;
    };
    EXPECT_EQ(slower(2.0, 4.0, 0.05), "");
    EXPECT_EQ(slower(2.0, 4.0 / 0.94, 0.05), "sharp-500;");
    EXPECT_EQ(slower(2.0 / 0.94, 4.0 / 0.96, 0.1), "");
    EXPECT_EQ(slower(2.0 / 0.97, 4.0, 0.01), "");  // three errors of both are 4.2 %
    result.scenes[1].rows.pop_back();              // not measured: nothing to judge
    const auto changes = speed_changes(before, result, 0.1);
    EXPECT_FALSE(changes[1].is_slower);
    EXPECT_FALSE(changes[1].now.row("published", published_setting));
    EXPECT_THAT(against_text(before, changes), HasSubstr("sharp-500"));
    write_text(folder / "bench.json", R"({"etalon": "bench/1", "machine": "", "compiler": ""})");
    EXPECT_THROW(read_bench(folder / "bench.json"), ConfigError);
}

TEST(SpreadPoses, ShowTheWholeMarkerFromItsFront) {
    const BenchmarkScene webcam = benchmark_scene("webcam-500");
    const CellGrid& grid = webcam.scene.markers.front().grid;
    const auto poses = volume_poses(webcam.camera, grid, 60, 3);
    ASSERT_EQ(poses.size(), 60u);
    const Projector projector(webcam.camera);
    double nearest = 1e9, farthest = 0.0, steepest = 0.0;
    for (const Rigid& pose : poses) {
        const Eigen::Vector3d centre = pose * grid.point_mm(5.0, 5.0);
        nearest = std::min(nearest, centre.z());
        farthest = std::max(farthest, centre.z());
        const Eigen::Vector3d inward = pose.rotation * Eigen::Vector3d::UnitZ();
        EXPECT_GT(inward.dot(centre), 0.0);
        steepest = std::max(steepest, std::acos(inward.z()));
        for (const int u : {0, 10})
            for (const int v : {0, 10}) {
                const auto pixel = projector.project(pose * grid.point_mm(u, v));
                ASSERT_TRUE(pixel.has_value());
                EXPECT_TRUE(cv::Rect(20, 20, 600, 440)
                                .contains(cv::Point(static_cast<int>(std::floor(pixel->x())),
                                                    static_cast<int>(std::floor(pixel->y())))));
            }
    }
    EXPECT_GE(nearest, 150.0);
    EXPECT_LE(farthest, 1500.0);
    EXPECT_LT(nearest, 350.0);
    EXPECT_GT(farthest, 1300.0);
    EXPECT_LE(steepest, 70.01 * 3.14159 / 180.0);
    EXPECT_GT(steepest, 55.0 * 3.14159 / 180.0);
}

}  // namespace
}  // namespace etalon
