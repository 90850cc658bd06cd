// Small studies from the file to the report, with what must not change them: shards, interruptions,
// threads; and classes of marker sizes.
#include <tbb/global_control.h>

#include <sstream>

#include "core/statistics/random.h"
#include "sim/marker/stag_pattern.h"
#include "study/study_report.h"
#include "study/study_run.h"
#include "study/study_summary.h"
#include "tests/loopback/program.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr const char* camera_text = R"(etalon: camera/1
serial: "S7"
image: {width: 320, height: 240}
intrinsics: {fx: 300, fy: 300, cx: 161.5, cy: 118.25}
distortion: {k1: -0.05}
lens: {f_number: 2, focus_distance_mm: 400, wavelength_nm: 550, psf: ideal}
sensor: {pixel_pitch_um: 6, bits: 8, transfer: linear, black: 0, gain_e_per_dn: 100,
         read_noise_e: 10, illumination: {cos4: false}}
)";

constexpr const char* study_text = R"(etalon: study/1
id: small
camera: camera.yml
white_level: 0.9
poses:
  count: 13
  seed: 3
  z_mm: [300, 420]
  roll_deg: [-30, 30]
  pitch_deg: [-30, 30]
  yaw_deg: [-180, 180]
detectors:
  - {detector: apriltag, marker: "apriltag:36h11:5@50mm"}
  - {name: other, detector: aruco, refinement: none, marker: "aruco:4X4_50:7@45mm"}
)";

class StudyTest : public testing::Test {
protected:
    StudyTest() {
        write_text(folder_ / "camera.yml", camera_text);
        write_text(folder_ / "study.yaml", study_text);
    }

    void replace(const std::string& what, const std::string& by) {
        std::string text = read_text(folder_ / "study.yaml");
        ASSERT_NE(text.find(what), std::string::npos) << what;
        write_text(folder_ / "study.yaml", text.replace(text.find(what), what.size(), by));
    }

    // Runs what is missing in OUT; whether it is complete.
    bool run(const std::string& out, const Shard& shard = {},
             const std::vector<std::string>& ablations = {}) {
        const StudyFile study = read_study(folder_ / "study.yaml");
        const StudyOptics optics(study, study_variants(study, ablations));
        StudyRecord record(folder_ / out,
                           describe(study, folder_ / "study.yaml", optics.variants(), shard));
        SteadyClock clock;
        std::FILE* nowhere = std::fopen("/dev/null", "w");
        Progress progress(nowhere, false, clock);
        const StudyRun result = run_study(optics, shard, record, {}, progress);
        std::fclose(nowhere);
        return result.complete;
    }

    StudyResults results(const std::string& out) { return read_results(folder_ / out); }
    std::string csv(const std::string& out) { return read_text(folder_ / out / "results.csv"); }

    std::string error_of_file() {
        return config_error_of([&] { read_study(folder_ / "study.yaml"); });
    }

    TemporaryFolder folder_;
};

double mean(const DetectorErrors& errors, std::size_t measure) {
    double sum = 0.0, count = 0.0;
    for (const auto& error : errors)
        if (error) {
            sum += error->measures[measure];
            ++count;
        }
    return sum / count;
}

// In this process as in another: the lock belongs to who opened the file.
TEST_F(StudyTest, IsNotWrittenByTwoAtOnce) {
    const StudyFile study = read_study(folder_ / "study.yaml");
    const StudyOptics optics(study, study_variants(study, {}));
    const auto description = describe(study, folder_ / "study.yaml", optics.variants(), {});
    const StudyRecord first(folder_ / "out", description);
    EXPECT_EQ(config_error_of([&] { StudyRecord(folder_ / "out", description); }),
              (folder_ / "out").string() + ": is in use: another etalon is writing to this folder");
}

TEST_F(StudyTest, FindsTheMarkersWhereTheyAre) {
    ASSERT_TRUE(run("out"));
    const StudyResults found = results("out");
    ASSERT_EQ(found.truth.size(), 13u);
    EXPECT_EQ(found.refused, 0u);
    // Distances in mm. ArUco's unrefined corners lie 0.5 px inside: 0.5 / 20 of 420 mm and noise.
    for (std::size_t pose = 0; pose < 13; ++pose) {
        ASSERT_TRUE(found.errors[0][0][pose] && found.errors[0][1][pose]);
        EXPECT_LT(found.errors[0][0][pose]->measures[6], 3.0);
        EXPECT_LT(found.errors[0][1][pose]->measures[6], 25.0);
    }
    for (const PoseComponents& truth : found.truth) {
        EXPECT_GE(truth[2], 300.0);
        EXPECT_LE(truth[2], 420.0);
        EXPECT_LE(std::abs(truth[3]), 30.0);
    }
    // 50 mm and 45 mm, tilted by up to 40 degrees, at 420 to 300 mm: 300 px * 45 / 420 at most *
    // cos.
    for (const double size : found.sizes_px[1]) {
        EXPECT_GT(size, 300.0 * 45.0 / 420.0 * 0.8);
        EXPECT_LT(size, 300.0 * 45.0 / 300.0 * 1.2);
    }
}

TEST_F(StudyTest, TakesAWideLens) {
    write_text(folder_ / "camera.yml", R"(etalon: camera/1
image: {width: 640, height: 480}
projection: equidistant
intrinsics: {fx: 180, fy: 180, cx: 316.5, cy: 243.25}
distortion: {k1: 0.03}
)");
    replace("z_mm: [300, 420]", "z_mm: [110, 140]");
    replace("count: 13", "count: 40");
    ASSERT_TRUE(run("out"));
    const StudyResults found = results("out");
    EXPECT_EQ(found.refused, 0u);
    double widest_deg = 0.0;
    std::size_t accurate = 0;
    for (std::size_t pose = 0; pose < 40; ++pose) {
        if (!found.errors[0][0][pose])
            continue;
        accurate += found.errors[0][0][pose]->measures[6] < 3.0;  // mm; a few are nearly edge-on
        const PoseComponents& truth = found.truth[pose];
        widest_deg =
            std::max(widest_deg, 57.3 * std::atan2(std::hypot(truth[0], truth[1]), truth[2]));
    }
    EXPECT_GT(accurate, 20u);
    EXPECT_GT(widest_deg, 50.0);
    EXPECT_THAT(read_text(folder_ / "out" / "study.json"), HasSubstr("fx 180 px, equidistant"));
}

TEST_F(StudyTest, IsTheSameInOnePieceAndInShards) {
    ASSERT_TRUE(run("whole", {}, {"tone"}));
    std::vector<std::filesystem::path> shards;
    for (const std::size_t i : {3, 1, 2}) {
        ASSERT_TRUE(run("part-" + std::to_string(i), {i, 3}, {"tone"}));
        shards.push_back(folder_ / ("part-" + std::to_string(i)));
    }
    merge_shards(shards, folder_ / "merged");
    EXPECT_EQ(csv("merged"), csv("whole"));
    for (const char* out : {"merged", "whole"}) {
        const StudyResults read = results(out);
        write_study_report(read, summarise(read), folder_ / out);
    }
    for (const auto& entry : std::filesystem::directory_iterator(folder_ / "whole"))
        EXPECT_EQ(read_text(folder_ / "merged" / entry.path().filename()), read_text(entry.path()))
            << entry.path();
}

TEST_F(StudyTest, IsNotMergedFromShardsThatDoNotFit) {
    for (const std::size_t i : {1, 2})
        ASSERT_TRUE(run("part-" + std::to_string(i), {i, 2}));
    const auto refusal = [&](const std::vector<std::filesystem::path>& shards) {
        return config_error_of([&] { merge_shards(shards, folder_ / "merged"); });
    };
    const std::filesystem::path one = folder_ / "part-1", two = folder_ / "part-2";
    EXPECT_THAT(refusal({one}), HasSubstr("shard 2/2 is missing"));
    EXPECT_THAT(refusal({two, two}), HasSubstr("the same shard"));
    replace("seed: 3", "seed: 4");
    ASSERT_TRUE(run("other", {2, 2}));
    EXPECT_THAT(refusal({one, folder_ / "other"}), HasSubstr("'volume' differs"));
    std::filesystem::resize_file(two / "results.csv",
                                 std::filesystem::file_size(two / "results.csv") - 5);
    EXPECT_THAT(refusal({one, two}), HasSubstr("pose 11 is missing"));
    EXPECT_FALSE(std::filesystem::exists(folder_ / "merged" / "report.html"));
}

// A killed study leaves any beginning of the file.
TEST_F(StudyTest, GoesOnWhereItWasKilled) {
    ASSERT_TRUE(run("whole"));
    const std::string text = csv("whole");
    const std::size_t header = text.find('\n') + 1;
    for (const std::size_t kept :
         {header, header + 3, text.size() / 3, text.size() / 2 + 1, text.size() - 1, text.size()}) {
        write_text(folder_ / "whole" / "results.csv", text.substr(0, kept));
        ASSERT_TRUE(run("whole"));
        EXPECT_EQ(csv("whole"), text) << kept;
    }
}

// Killed before study.json is there.
TEST_F(StudyTest, BeginsAnewWhereItHadHardlyBegun) {
    ASSERT_TRUE(run("whole"));
    const std::string text = csv("whole"), header = text.substr(0, text.find('\n') + 1);
    const auto folder = folder_ / "begun";
    std::filesystem::create_directory(folder);
    write_text(folder / "results.csv.part", header.substr(0, 9));
    ASSERT_TRUE(run("begun"));
    EXPECT_EQ(csv("begun"), text);
    std::filesystem::remove(folder / "study.json");
    EXPECT_THROW(run("begun"), ConfigError) << "results of nobody knows what";
    write_text(folder / "results.csv", header);
    write_text(folder / "study.json.part", "{");
    ASSERT_TRUE(run("begun"));
    EXPECT_EQ(csv("begun"), text);
}

// A marker's own file is as much of the study as its description.
TEST_F(StudyTest, NamesTheMarkersFileThatHasChanged) {
    const std::string table = (folder_ / "words.txt").string();
    std::string words;
    for (const StagCode code : stag_codes("HD23")) {
        for (int i = 0; i < stag_bits; ++i)
            words += (code >> i & 1) != 0 ? '1' : '0';
        words += '\n';
    }
    write_text(table, words);
    replace("{detector: apriltag, marker: \"apriltag:36h11:5@50mm\"}",
            "{detector: stag, marker: \"stag:" + table + ":2@50mm\"}");
    // Renders nothing: study.json is compared before anything else.
    const auto begin = [&](const std::string& out, const Shard& shard) {
        const StudyFile study = read_study(folder_ / "study.yaml");
        StudyRecord(folder_ / out,
                    describe(study, folder_ / "study.yaml", study_variants(study, {}), shard));
    };
    begin("part-1", {1, 2});
    begin("part-1", {1, 2});

    write_text(table, words + "# and a word\n");
    const std::string differs = "'made_from.marker_files_sha256." + table + "' differs";
    EXPECT_THAT(config_error_of([&] { begin("part-1", {1, 2}); }), HasSubstr(differs));
    begin("part-2", {2, 2});
    EXPECT_THAT(config_error_of([&] {
                    merge_shards({folder_ / "part-1", folder_ / "part-2"}, folder_ / "merged");
                }),
                HasSubstr(differs));
}

TEST_F(StudyTest, ReportsCornersBySizeAndWhyPosesWereMissed) {
    replace("z_mm: [300, 420]", "z_mm: [300, 2000]");
    ASSERT_TRUE(run("out"));
    StudyResults found = results("out");
    const StudySummary summary = summarise(found);
    const auto& sizes = summary.detectors[0][0].sizes;
    std::size_t poses = 0, missed = 0;
    for (std::size_t k = 0; k < 5; ++k)
        poses += sizes[k].poses;
    EXPECT_EQ(poses, 13u);
    EXPECT_EQ(sizes.back().poses, 13u);
    for (const auto& [reason, count] : found.failures[0])
        missed += count;
    EXPECT_EQ(sizes.back().detected->count + missed, 13u);
    ASSERT_GT(missed, 0u);
    const std::string csv = summary_csv(found.description, summary);
    for (const std::string& line : split(csv.substr(0, csv.size() - 1), '\n'))
        EXPECT_EQ(std::count(line.begin(), line.end(), ','), 21) << line;
    EXPECT_THAT(csv, HasSubstr(fmt::format("as is,apriltag,size,{},", sizes[0].poses)));
    EXPECT_THAT(csv, HasSubstr(",25,40,"));
    const std::string page = study_html(found, summary);
    EXPECT_THAT(page, HasSubstr(">25 to 40</td>"));
    expect_readable_page(page);
    EXPECT_THAT(page, HasSubstr("not detected"));
    EXPECT_THAT(page, HasSubstr(escape_html(found.failures[0].begin()->first)));
}

TEST_F(StudyTest, DoesNotDependOnThreads) {
    ASSERT_TRUE(run("many"));
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    ASSERT_TRUE(run("one"));
    EXPECT_EQ(csv("one"), csv("many"));
}

TEST_F(StudyTest, DoesNotGoOnWithAnother) {
    ASSERT_TRUE(run("out"));
    EXPECT_THROW(run("out", {}, {"noise"}), ConfigError);
    EXPECT_THROW(run("out", {1, 2}), ConfigError);
    replace("count: 13", "count: 14");
    EXPECT_THROW(run("out"), ConfigError);
    EXPECT_THROW(run("."), ConfigError);  // a folder that holds no study
}

// AprilTag's pixels counted from the corner of the first one: corners 0.5 px off both ways are a
// marker that is moved by 0.5 Z / f.
TEST_F(StudyTest, ShowsWhatHalfAPixelMakes) {
    ASSERT_TRUE(run("out", {}, {"half-pixel"}));
    const StudyResults found = results("out");
    double expected_mm = 0.0;
    for (const PoseComponents& truth : found.truth)
        expected_mm += 0.5 * truth[2] / 300.0 / 13.0;
    for (const std::size_t k : {0u, 1u})
        EXPECT_NEAR(mean(found.errors[1][0], k) - mean(found.errors[0][0], k), expected_mm,
                    0.1 * expected_mm);
    EXPECT_EQ(mean(found.errors[1][1], 0), mean(found.errors[0][1], 0)) << "ArUco's needs none";
}

// The curve brightens the blur: a dark marker on white shrinks, and seems farther away.
TEST_F(StudyTest, ShowsWhatTheToneCurveMakes) {
    ASSERT_TRUE(run("out", {}, {"tone"}));
    const StudyResults found = results("out");
    EXPECT_GT(mean(found.errors[1][0], 2) - mean(found.errors[0][0], 2), 0.5);
}

TEST_F(StudyTest, HasVariantsOfWhatTheCameraStates) {
    const StudyFile study = read_study(folder_ / "study.yaml");
    EXPECT_EQ(study_variants(study, study_switch_names()).size(), 6u);
    EXPECT_THROW(study_variants(study, {"tone", "tone"}), ConfigError);
    EXPECT_THROW(study_variants(study, {"colour"}), ConfigError);
    std::string without_lens = camera_text;
    const std::size_t from = without_lens.find("lens:"), to = without_lens.find("sensor:");
    write_text(folder_ / "camera.yml", without_lens.erase(from, to - from));
    const StudyFile sharp = read_study(folder_ / "study.yaml");
    EXPECT_THROW(study_variants(sharp, {"blur"}), ConfigError);
    EXPECT_EQ(study_variants(sharp, {"noise"}).size(), 2u);
}

TEST_F(StudyTest, CountsAProgramsCrashAsNotDetected) {
    std::ofstream(folder_ / "program")
        << "n=0; while read -r image camera; do n=$((n + 1)); test -s \"$image\" || exit 9\n"
        << "[ $n = 2 ] && exit 3; echo '{\"camera_from_marker\":[0.1,0,0,1,2,350]}'; done\n";
    replace("  - {name: other", "  - {name: theirs, detector: external, command: [sh, \"" +
                                    (folder_ / "program").string() +
                                    "\"], marker: \"aruco:4X4_50:7@45mm\"}\n  - {name: other");
    ASSERT_TRUE(run("out"));
    const StudyResults found = results("out");
    const DetectorErrors& theirs = found.errors[0][1];
    const auto detected = std::count_if(theirs.begin(), theirs.end(),
                                        [](const auto& error) { return error.has_value(); });
    EXPECT_GE(detected, 6);
    EXPECT_LT(detected, 13);
    EXPECT_THAT(csv("out"), HasSubstr("the program ended with exit code 3"));
    EXPECT_FALSE(std::filesystem::exists(folder_ / "out" / "scratch"));
}

TEST_F(StudyTest, DrawsDisturbancesAlongWithThePoses) {
    replace("detectors:", "disturbances: {exposure: [0.5, 0.7], focus-mm: [300, 600]}\ndetectors:");
    ASSERT_TRUE(run("out"));
    const StudyResults found = results("out");
    ASSERT_EQ(found.axes.size(), 2u);
    for (const double exposure : found.axes[0]) {
        EXPECT_GE(exposure, 0.5);
        EXPECT_LE(exposure, 0.7);
    }
    EXPECT_GT(std::count(found.axes[1].begin(), found.axes[1].end(), 300.0), 3);
    EXPECT_GT(std::count(found.axes[1].begin(), found.axes[1].end(), 600.0), 3);
}

TEST_F(StudyTest, TakesItsPosesFromAFile) {
    write_text(folder_ / "poses.csv",
               "rx,ry,rz,tx,ty,tz\n0.1,-0.2,0.3,5,-7,330\n0,0,1.5,-11,3,390\n0,0,0,0,0,-100\n");
    std::string text = read_text(folder_ / "study.yaml");
    const std::size_t from = text.find("  count:"), to = text.find("detectors:");
    write_text(folder_ / "study.yaml", text.replace(from, to - from, "  file: poses.csv\n"));
    ASSERT_TRUE(run("out"));
    const StudyResults found = results("out");
    ASSERT_EQ(found.truth.size(), 3u);
    EXPECT_EQ(found.truth[1][0], -11.0);
    EXPECT_TRUE(found.errors[0][0][1]);
    EXPECT_FALSE(found.errors[0][0][2]) << "behind the camera";
    EXPECT_EQ(found.refused, 1u);
    EXPECT_THAT(csv("out"), HasSubstr("not rendered: "));
}

TEST_F(StudyTest, RefusesResultsThatAreNotWhatWasWritten) {
    ASSERT_TRUE(run("out"));
    const std::string text = csv("out");
    const auto refusal = [&](const std::string& changed) {
        write_text(folder_ / "out" / "results.csv", changed);
        return config_error_of([&] { results("out"); });
    };
    EXPECT_EQ(refusal(text), "no error");
    EXPECT_THAT(refusal(text.substr(0, text.size() - 9)), HasSubstr("not finished"));
    EXPECT_THAT(refusal(text + "13,as is,apriltag\n"), HasSubstr("one too many"));
    std::string odd = text;
    odd.replace(odd.find("\n1,as is,apriltag"), 3, "\n7,");
    EXPECT_THAT(refusal(odd), HasSubstr("results.csv:4"));
    odd = text;
    odd.replace(odd.find("apriltag,1,"), 13, "apriltag,1,x,");
    EXPECT_THAT(refusal(odd), HasSubstr("results.csv:2"));
}

TEST_F(StudyTest, NamesTheLineOfWhatCannotBe) {
    struct Case {
        const char *what, *by, *says;
    };
    for (const Case& c : {Case{"z_mm: [300, 420]", "z_mm: [420, 300]", "study.yaml:8"},
                          {"detector: apriltag", "detector: april", "there is no detector 'april'"},
                          {"name: other, ", "", "aruco"},
                          {"aruco:4X4_50:7@45mm", "apriltag:36h11:7@45mm", "cannot see"},
                          {"refinement: none", "refinement: best", "refinement"},
                          {"refinement: none", "decimate: 2", "decimate"},
                          {"refinement: none", "refinement: none, half_window_px: 5",
                           "subpixel_half_window_px: belongs to"},
                          {"seed: 3", "sede: 3", "sede"},
                          {"id: small", "id: small\nswitched: [colour]", "colour"},
                          {"id: small", "id: small\ndisturbances: {fog: 1}", "fog"},
                          {"id: small", "id: small\ndisturbances: {jpeg: [0, 300]}", "jpeg"},
                          {"camera: camera.yml", "camera: none.yml", "none.yml"}}) {
        write_text(folder_ / "study.yaml", study_text);
        if (std::string(c.by).empty())
            replace("detector: apriltag", "name: aruco, detector: apriltag");
        replace(c.what, c.by);
        EXPECT_THAT(error_of_file(), HasSubstr(c.says)) << c.by;
    }
    write_text(folder_ / "study.yaml", study_text);
    EXPECT_EQ(error_of_file(), "no error");
}

struct Sightings {
    DetectorErrors errors;
    std::vector<double> sizes_px;
    std::vector<std::optional<double>> corner_rms_px;

    void add(double size_px, bool detected, std::optional<double> corner_px) {
        errors.push_back(detected ? std::optional(DetectedError{}) : std::nullopt);
        sizes_px.push_back(size_px);
        corner_rms_px.push_back(corner_px);
    }
    std::vector<SizeClass> classes() const { return size_classes(errors, sizes_px, corner_rms_px); }
};

TEST(SizeClasses, HoldEveryPoseOnceAndBoundsBelongToTheUpperOne) {
    Sightings seen;
    for (const double size : {0.0, 24.999, 25.0, 39.0, 40.0, 60.0, 99.0, 100.0, 400.0})
        seen.add(size, true, 0.1);
    std::vector<std::size_t> poses;
    std::vector<std::string> words;
    for (const SizeClass& one : seen.classes()) {
        poses.push_back(one.poses);
        words.push_back(size_words(one));
    }
    EXPECT_EQ(words, (std::vector<std::string>{"below 25", "25 to 40", "40 to 60", "60 to 100",
                                               "from 100", "from 60", "all"}));
    EXPECT_EQ(poses, (std::vector<std::size_t>{2, 2, 1, 2, 2, 4, 9}));
}

// Corner errors 0.01, 0.02 ... 0.40 of markers of 30 px, in a mixed order: the median is the mean
// of the 20th and the 21st, 38 of 40 do not exceed the 38th.
TEST(SizeClasses, HaveTheMedianAndTheQuantileOfTheirOwnPoses) {
    Sightings seen;
    for (int i = 0; i < 40; ++i)
        seen.add(30.0, true, 0.01 * (1 + 27 * i % 40));
    for (int i = 0; i < 10; ++i)
        seen.add(30.0, false, std::nullopt);
    seen.add(80.0, true, 7.0);
    const SizeClass one = seen.classes()[1];
    EXPECT_EQ(one.poses, 50u);
    EXPECT_EQ(one.detected->count, 40u);
    EXPECT_DOUBLE_EQ(one.median_corner_px->value, 0.205);
    EXPECT_DOUBLE_EQ(*one.corner_quantile_px, 0.38);
    // Fewer than 14 of 40 lie below the median with 1.9 %, fewer than 15 with 4.0 %.
    EXPECT_DOUBLE_EQ(one.median_corner_px->interval->low, 0.14);
    EXPECT_DOUBLE_EQ(one.median_corner_px->interval->high, 0.27);
}

TEST(SizeClasses, SayNothingOfWhatTheyDoNotKnow) {
    Sightings seen;
    for (int i = 0; i < 19; ++i)
        seen.add(30.0, true, 0.3);
    seen.add(50.0, true, std::nullopt);
    seen.add(70.0, false, std::nullopt);
    const auto classes = seen.classes();
    EXPECT_FALSE(classes[0].detected) << "no pose";
    EXPECT_FALSE(classes[0].median_corner_px);
    EXPECT_TRUE(classes[1].median_corner_px);
    EXPECT_FALSE(classes[1].corner_quantile_px) << "of 19 it is the largest";
    EXPECT_EQ(classes[2].detected->value, 1.0);
    EXPECT_FALSE(classes[2].median_corner_px) << "a pose without corners";
    EXPECT_EQ(classes[3].detected->value, 0.0);
    seen.sizes_px.pop_back();
    EXPECT_THROW(seen.classes(), NumericalError);
}

// ---- killed study

// The program `etalon study`, killed with SIGKILL at moments all over its run: the same command
// goes on with the poses that are missing, and the end is the folder of a study that nobody
// disturbed.

constexpr int poses = 40, rows_per_pose = 2;
constexpr int killed = -1;  // the exit code that Program gives to the victim of a signal

// Far enough away that some poses are missed.
constexpr const char* killed_study_text = R"(etalon: study/1
id: killed
camera: camera.yml
poses: {{count: {}, seed: 5, z_mm: [300, 900], roll_deg: [-40, 40], yaw_deg: [-180, 180]}}
detectors:
  - {{detector: apriltag, marker: "apriltag:36h11:5@50mm"}}
  - {{detector: aruco, marker: "aruco:4X4_50:7@45mm"}}
disturbances: {{jpeg: [60, 100]}}
)";

class KilledStudy : public testing::Test {
protected:
    KilledStudy() {
        write_text(folder_ / "camera.yml", camera_text);
        write_study(poses);
    }

    void write_study(int count) const {
        write_text(folder_ / "study.yaml", fmt::format(killed_study_text, count));
    }

    std::unique_ptr<Program> begin(const std::string& out) const {
        return start_program("etalon", {"study", (folder_ / "study.yaml").string(), "--out",
                                        (folder_ / out).string()});
    }

    void finish(const std::string& out) const {
        const auto program = begin(out);
        const std::string text = program->rest();
        ASSERT_EQ(program->exit_code(), 0) << text;
    }

    // Ends the program as soon as the condition holds; whether it has not ended by itself before.
    template <class Condition>
    static bool kill_when(Program& program, Condition holds) {
        while (!holds() && !program.has_ended())
            std::this_thread::yield();
        program.send(SIGKILL);
        const int code = program.exit_code();
        EXPECT_TRUE(code == killed || code == 0) << code;
        return code == killed;
    }

    bool kill_at_file(const std::string& out, const std::string& file) const {
        const auto program = begin(out);
        return kill_when(*program, [&] { return std::filesystem::exists(folder_ / out / file); });
    }

    std::size_t bytes(const std::string& out) const {
        std::error_code error;
        const auto size = std::filesystem::file_size(folder_ / out / "results.csv", error);
        return error ? 0 : static_cast<std::size_t>(size);
    }
    // Of which every row is in the file.
    int whole_poses(const std::string& out) const {
        const std::string text = read_text(folder_ / out / "results.csv");
        return static_cast<int>(std::count(text.begin(), text.end(), '\n') - 1) / rows_per_pose;
    }

    // Names and content of all files but the times.
    std::map<std::string, std::string> files(const std::string& out) const {
        std::map<std::string, std::string> result;
        for (const auto& entry : std::filesystem::directory_iterator(folder_ / out))
            if (entry.path().filename() != "times.json")
                result[entry.path().filename().string()] = read_text(entry.path());
        return result;
    }

    void expect_like_undisturbed(const std::string& out) const {
        const auto expected = files("undisturbed"), found = files(out);
        for (const auto& [name, content] : expected) {
            ASSERT_TRUE(found.contains(name)) << name << " is missing";
            EXPECT_TRUE(found.at(name) == content) << name << " differs";
        }
        EXPECT_EQ(found.size(), expected.size());
    }

    TemporaryFolder folder_;
};

TEST_F(KilledStudy, GoesOnWithWhatIsMissingAndEndsWithTheSameBytes) {
    finish("undisturbed");
    ASSERT_EQ(whole_poses("undisturbed"), poses);
    RandomStream random(31, 4);
    std::set<std::size_t> moments;  // sizes of results.csv, in order
    while (moments.size() < 8)
        moments.insert(static_cast<std::size_t>(0.95 * random.uniform() *
                                                static_cast<double>(bytes("undisturbed"))));
    int kills = 0;
    for (const std::size_t moment : moments) {
        const int kept = bytes("out") == 0 ? 0 : whole_poses("out");
        const auto program = begin("out");
        if (kept < poses) {
            EXPECT_THAT(program->line(), StartsWith(fmt::format("study: 0 of {}", poses - kept)));
        }
        kills += kill_when(*program, [&] { return bytes("out") >= moment; });
    }
    finish("out");
    expect_like_undisturbed("out");
    // One that the machine holds up for as long as a report takes is too late.
    EXPECT_GE(kills, 5);
}

// What is made of the results, and the first files of a folder: each is there at once or not at
// all, and a folder that has only some of them is gone on with.
TEST_F(KilledStudy, IsNotHarmedWhereItWritesItsOtherFiles) {
    write_study(8);
    finish("undisturbed");
    int kills = 0, folders = 0;
    for (const char* file : {".", "results.csv", "study.json"}) {
        const std::string out = fmt::format("begun-{}", ++folders);
        kills += kill_at_file(out, file);
        finish(out);
        expect_like_undisturbed(out);
    }
    for (const char* file :
         {"pairs-apriltag.svg", "pairs-aruco.svg", "summary.csv", "summary.json"}) {
        for (const auto& [name, content] : files("begun-1"))
            if (name != "study.json" && name != "results.csv")
                std::filesystem::remove(folder_ / "begun-1" / name);
        kills += kill_at_file("begun-1", file);
    }
    finish("begun-1");
    expect_like_undisturbed("begun-1");
    EXPECT_GE(kills, 3);  // of 7, as above
}

// Nothing that is printed gets into a file, which would else take the closed descriptor's number.
TEST_F(KilledStudy, WithoutStandardDescriptorsWritesTheSameFiles) {
    write_study(8);
    finish("undisturbed");
    for (const auto& [closed, exit_code] :
         {std::pair("<&- 2>&-", 0), {"<&- >&- 2>&-", 4}}) {  // 4: nobody got the result
        const std::string out = fmt::format("closed-{}", exit_code);
        const int status =
            std::system(fmt::format("cd '{}' && '{}' study study.yaml --out {} >out.txt {}",
                                    folder_.path().string(), built_program("etalon"), out, closed)
                            .c_str());
        EXPECT_EQ(WEXITSTATUS(status), exit_code);
        expect_like_undisturbed(out);
    }
}

}  // namespace
}  // namespace etalon
