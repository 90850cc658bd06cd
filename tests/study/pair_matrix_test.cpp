#include "study/pair_matrix.h"

#include <numeric>

#include "core/statistics/random.h"
#include "study/external_detector.h"
#include "study/study_report.h"
#include "tests/test.h"

namespace etalon {
namespace {

using std::chrono::milliseconds;

constexpr std::size_t columns = PairMatrix::columns, rows = PairMatrix::rows;

// ---- a marker study without images: poses as in the published one, and errors of the kinds that
// detectors show there (growing with distance and tilt, biased in depth, flipped, missed)

// z from 500 to 1500 mm within +-21 by +-16 degrees, roll and pitch +-45, yaw +-180 degrees.
std::vector<Rigid> study_poses(std::size_t count) {
    std::vector<Rigid> poses;
    for (std::size_t i = 0; i < count; ++i) {
        RandomStream random(23, 1, i);
        const auto within = [&](double reach) { return reach * (2.0 * random.uniform() - 1.0); };
        const double z = 1000.0 + within(500.0), x = within(0.38 * z), y = within(0.28 * z);
        const double rad = std::numbers::pi / 180.0;
        poses.push_back({rotation_from_roll_pitch_yaw(
                             {within(45.0 * rad), within(45.0 * rad), within(180.0 * rad)}),
                         {x, y, z}});
    }
    return poses;
}

// What a detector does: errors scale with `noise`, depth comes out too large by `bias` of itself.
struct SyntheticDetector {
    double noise = 1.0, bias = 0.0, flip_rate = 0.0, missed_when_far = 0.0;
};

DetectorErrors synthetic_errors(const SyntheticDetector& detector, const std::vector<Rigid>& poses,
                                std::uint32_t stream) {
    DetectorErrors errors;
    for (std::size_t i = 0; i < poses.size(); ++i) {
        RandomStream random(29, stream, i);
        const Rigid& truth = poses[i];
        const double z = truth.translation.z(), far = (z - 500.0) / 1000.0;
        if (random.uniform() < detector.missed_when_far * far * far) {
            errors.push_back(std::nullopt);
            continue;
        }
        const double depth_noise = detector.noise * 2e-6 * z * z, shift = random.normal();
        const double depth = depth_noise * shift + detector.bias * z * (0.4 + far);
        const Eigen::Vector3d ray = truth.translation / z, angles = roll_pitch_yaw(truth.rotation);
        const bool flip = random.uniform() < detector.flip_rate * (0.3 + far);
        const double tilt_noise =
            detector.noise * 0.004 * (0.4 + far) / (0.3 + std::abs(angles.x()));
        Eigen::Vector3d turned =
            angles + tilt_noise * Eigen::Vector3d{random.normal(), random.normal(), 0.0};
        turned.z() += detector.noise * 0.0009 * (0.3 + far) * random.normal();
        if (flip)
            turned.head<2>() = -turned.head<2>();
        const Eigen::Vector3d side{random.normal(), random.normal(), 0.0};
        const Rigid estimated{rotation_from_roll_pitch_yaw(turned),
                              truth.translation + depth * ray + 4e-5 * detector.noise * z * side};
        errors.push_back(detected_error(estimated, truth, flip));
    }
    return errors;
}

std::vector<PoseComponents> components(const std::vector<Rigid>& poses) {
    std::vector<PoseComponents> rows;
    for (const Rigid& pose : poses)
        rows.push_back(pose_components(pose));
    return rows;
}

// ---- the tests

std::size_t occurrences(const std::string& text, const std::string& part) {
    std::size_t count = 0;
    for (auto at = text.find(part); at != std::string::npos; at = text.find(part, at + 1))
        ++count;
    return count;
}

// Pictures in base64 hold any letters.
std::string without_pictures(std::string text) {
    const std::string begin = "base64,";
    for (auto at = text.find(begin); at != std::string::npos; at = text.find(begin, at + 1))
        text.erase(at + begin.size(), text.find('\'', at) - at - begin.size());
    return text;
}

std::uint32_t sum(const PairPanel& panel, std::size_t first_row, std::size_t rows_counted) {
    const auto begin =
        panel.counts.begin() + static_cast<std::ptrdiff_t>(first_row * PairMatrix::columns);
    return std::accumulate(
        begin, begin + static_cast<std::ptrdiff_t>(rows_counted * PairMatrix::columns), 0u);
}

TEST(PairMatrix, CountsEveryDetectedPoseOnceInEveryPanel) {
    const auto poses = study_poses(3000);
    const PairMatrix matrix =
        pair_matrix("tag", components(poses), synthetic_errors({1.0, 0.01, 0.1, 0.5}, poses, 1));
    EXPECT_EQ(matrix.poses, 3000u);
    EXPECT_LT(matrix.detected, 2900u);
    EXPECT_GT(matrix.above[3] + matrix.below[3], 100u);  // flips
    for (std::size_t e = 0; e < 6; ++e)
        for (std::size_t f = 0; f < 6; ++f) {
            const PairPanel& panel = matrix.panels[e][f];
            EXPECT_EQ(sum(panel, 0, rows + 2), matrix.detected);
            EXPECT_EQ(sum(panel, 0, 1), matrix.above[e]);
            EXPECT_EQ(sum(panel, rows + 1, 1), matrix.below[e]);
            std::size_t all = 0, inside = 0;
            for (const PairBin& bin : panel.bins) {
                all += bin.all.count();
                inside += bin.inside.count();
            }
            EXPECT_EQ(all, matrix.detected);
            EXPECT_EQ(inside, sum(panel, 1, rows));
        }
}

// Z errors of 1 % of z on a grid of z: a straight line of bin means, and cells on a diagonal.
TEST(PairMatrix, ShowsAnErrorThatGrowsWithDepth) {
    std::vector<PoseComponents> truth;
    DetectorErrors errors;
    for (int i = 0; i <= 1800; ++i) {
        truth.push_back({7.0, 5.0, 600.0 + 0.5 * i, 0.0, 0.0, 0.0});
        errors.emplace_back().emplace().measures[2] = 0.01 * truth.back()[2];
    }
    const PairMatrix matrix = pair_matrix("tag", truth, errors);
    const PairPanel& panel = matrix.panels[2][2];
    const Interval& z = matrix.freedoms[2];
    const double width = (z.high - z.low) / PairMatrix::bins;
    for (std::size_t i = 0; i < PairMatrix::bins; ++i)
        EXPECT_NEAR(*panel.bins[i].inside.mean(),
                    0.01 * (z.low + (static_cast<double>(i) + 0.5) * width), 0.01);
    for (std::size_t r = 1; r <= rows; ++r)
        for (std::size_t c = 0; c < columns; ++c)
            if (panel.counts[r * columns + c] > 0) {
                const double up = static_cast<double>(rows - r) + 0.5, height = rows;
                const double along = (static_cast<double>(c) + 0.5) / columns;
                EXPECT_NEAR(up / height, 0.5 + (along - 0.5) / 1.08, 0.03);  // 4 % room each way
            }
}

TEST(PairMatrix, KeepsWhatLiesBeyondAnAxis) {
    auto poses = study_poses(500);
    DetectorErrors errors = synthetic_errors({1.0, 0.0, 0.0, 0.0}, poses, 1);
    for (std::size_t i = 0; i < errors.size(); ++i)
        errors[i]->measures[0] = 0.1 * static_cast<double>(i % 7);
    errors[7]->measures[0] = 4000.0;
    errors[8]->measures[0] = errors[9]->measures[0] = -4000.0;
    const PairMatrix matrix = pair_matrix("tag", components(poses), errors);
    EXPECT_EQ(matrix.above[0], 1u);
    EXPECT_EQ(matrix.below[0], 2u);
    EXPECT_LT(matrix.errors[0].high, 10.0);
    const Interval& yaw = matrix.freedoms[5];
    const double along = (pose_components(poses[7])[5] - yaw.low) / (yaw.high - yaw.low);
    const auto column = static_cast<std::size_t>(along * columns);
    EXPECT_EQ(matrix.panels[0][5].counts[column], 1u);
    const std::string svg = pair_matrix_svg(matrix);
    EXPECT_NE(svg.find("▲ 1<"), std::string::npos);
    EXPECT_NE(svg.find("▼ 2<"), std::string::npos);
}

TEST(PairMatrix, IsAPictureOfItsOwnForPapers) {
    const auto poses = study_poses(2000);
    const std::string svg = pair_matrix_svg(pair_matrix(
        "<tag> & co", components(poses), synthetic_errors({1.0, 0.01, 0.05, 0.3}, poses, 1)));
    EXPECT_EQ(svg.find("<svg"), 0u);
    EXPECT_NE(svg.find("xmlns='http://www.w3.org/2000/svg'"), std::string::npos);
    EXPECT_EQ(occurrences(svg, "<image "), 36u);
    EXPECT_EQ(occurrences(svg, "xlink:href='data:image/png;base64,"), 36u);
    EXPECT_NE(svg.find("&lt;tag&gt; &amp; co"), std::string::npos);
    for (const char* unwanted : {"var(", "nan", "inf<", "<title"})
        EXPECT_EQ(without_pictures(svg).find(unwanted), std::string::npos) << unwanted;
}

TEST(PairMatrix, OfManyPosesIsNoLargerThanAMegabyte) {
    const auto poses = study_poses(100000);
    const auto matrix =
        pair_matrix("tag", components(poses), synthetic_errors({1.0, 0.01, 0.05, 0.3}, poses, 1));
    EXPECT_LT(pair_matrix_svg(matrix).size(), 1000000u);
    HtmlPage page("study", "");
    add_pair_matrices(page, {&matrix, 1});
    EXPECT_LT(page.finish().size(), 1000000u);
}

TEST(PairMatrix, IsChosenByTabsInAReportThatNeedsNothingFromOutside) {
    const auto poses = study_poses(300);
    const auto truth = components(poses);
    const DetectorErrors errors = synthetic_errors({}, poses, 1);
    const std::vector<PairMatrix> matrices{pair_matrix("one", truth, errors),
                                           pair_matrix("<b>", truth, errors)};
    HtmlPage page("study", "");
    add_pair_matrices(page, matrices);
    const std::string html = page.finish();
    EXPECT_EQ(occurrences(html, "<input type=\"radio\""), 2u);
    EXPECT_EQ(occurrences(html, "<image "), 72u);
    EXPECT_EQ(occurrences(html, "<rect class='bin'"), 2u * 36u * PairMatrix::bins);
    const std::string words = without_pictures(html);
    EXPECT_EQ(words.find("<b>"), std::string::npos);
    EXPECT_EQ(words.find("http"), std::string::npos);
    EXPECT_EQ(words.find("%RIM%"), std::string::npos);
}

TEST(PairMatrix, IsDrawnOfNothingOfOnePoseAndOfFixedAxes) {
    const PairMatrix none = pair_matrix("tag", {}, {});
    EXPECT_NE(pair_matrix_svg(none).find("0 of 0 poses detected"), std::string::npos);
    const std::vector<PoseComponents> truth(2, PoseComponents{7.0, 5.0, 600.0, 1.0, 2.0, 3.0});
    EXPECT_EQ(pair_matrix("tag", truth, {std::nullopt, std::nullopt}).detected, 0u);
    DetectorErrors errors(2);
    errors[0].emplace().measures[2] = 1.5;
    const std::string svg = pair_matrix_svg(pair_matrix("tag", truth, errors));
    EXPECT_EQ(without_pictures(svg).find("nan"), std::string::npos);
    EXPECT_EQ(occurrences(svg, "<image "), 36u);
    EXPECT_THROW(pair_matrix("tag", truth, {}), NumericalError);
}

std::vector<BinnedDetector> against_noise() {
    DetectorErrors good, poor;
    std::vector<double> noise;
    for (int i = 0; i < 400; ++i) {
        noise.push_back(i % 4);
        good.emplace_back().emplace().measures[2] = 0.1 + 0.001 * i;
        poor.push_back(i % 4 == 3 ? std::nullopt : good.back());
        if (poor.back())
            poor.back()->measures[2] *= 50.0;
    }
    return {{"good", binned_statistics(good, noise)}, {"<poor>", binned_statistics(poor, noise)}};
}

TEST(StudyPlots, ShowEveryDetectorsBins) {
    const auto detectors = against_noise();
    const std::string rate = detection_rate_plot("noise / gray", detectors).svg();
    EXPECT_EQ(occurrences(rate, "<circle"), 8u);
    EXPECT_NE(rate.find("&lt;poor&gt; at 3: 0 of 100 detected"), std::string::npos);
    const std::string error = median_error_plot("noise / gray", 2, detectors).svg();
    EXPECT_EQ(occurrences(error, "<circle"), 7u);  // nothing detected in one bin
    EXPECT_NE(error.find("median |Z error| / mm"), std::string::npos);
    for (const std::string& svg : {rate, error})
        for (const char* unwanted : {"nan", "inf"})
            EXPECT_EQ(svg.find(unwanted), std::string::npos) << unwanted;
}

// ---- external detector

// Small shell programs that answer, crash, hang and talk nonsense.

constexpr const char* good_answer = R"({"camera_from_marker":[0.1,-0.2,0.3,4,-5,600],"more":[1]})";

class ExternalDetectorTest : public testing::Test {
protected:
    // A program that has the two paths in $image and $camera; $pose is a good answer.
    ExternalDetector running(const std::string& each_line,
                             milliseconds time_out = milliseconds(20000)) {
        std::ofstream(folder_ / "program") << "pose='" << good_answer << "'\n"
                                           << "tab=$(printf '\\t')\n"
                                           << "while IFS=$tab read -r image camera; do\n"
                                           << each_line << "\ndone\n";
        return {{"sh", (folder_ / "program").string()}, time_out, "--detector"};
    }

    static void expect_pose(const ExternalAnswer& answer) {
        ASSERT_TRUE(answer.camera_from_marker) << answer.failure;
        const Vector6d pose = vector_from_rigid(*answer.camera_from_marker);
        const Vector6d expected{{0.1, -0.2, 0.3, 4, -5, 600}};
        EXPECT_LT((pose - expected).norm(), 1e-12);
        EXPECT_EQ(answer.failure, "");
    }

    // The answer to an image "odd" of a program that does `what` then, and that one pose follows.
    std::string failure_of(const std::string& what, milliseconds time_out = milliseconds(20000)) {
        auto detector =
            running("if [ $image = odd ]; then " + what + "; else echo \"$pose\"; fi", time_out);
        expect_pose(detector.detect("before", "camera.yml"));
        const ExternalAnswer answer = detector.detect("odd", "camera.yml");
        EXPECT_FALSE(answer.camera_from_marker);
        expect_pose(detector.detect("after", "camera.yml"));
        return answer.failure;
    }

    TemporaryFolder folder_;
};

TEST_F(ExternalDetectorTest, GivesItsPoses) {
    auto detector = running("echo \"$pose\"");
    for (int i = 0; i < 5; ++i)
        expect_pose(detector.detect("image.png", "camera.yml"));
}

TEST_F(ExternalDetectorTest, IsToldBothPathsAndTellsItsOwnFailures) {
    auto detector = running("printf '{\"failure\":\"%s and %s\"}\\n' \"$image\" \"$camera\"");
    const ExternalAnswer answer = detector.detect("an image.png", "the camera.yml");
    EXPECT_FALSE(answer.camera_from_marker);
    EXPECT_EQ(answer.failure, "an image.png and the camera.yml");
}

TEST_F(ExternalDetectorTest, IsRunOnceForAllImages) {
    auto detector = running("n=$((n + 1)); echo \"{\\\"failure\\\":\\\"$n\\\"}\"");
    EXPECT_EQ(detector.detect("a", "c").failure, "1");
    EXPECT_EQ(detector.detect("b", "c").failure, "2");
}

TEST_F(ExternalDetectorTest, ThatEndsIsStartedAgain) {
    EXPECT_EQ(failure_of("exit 7"), "the program ended with exit code 7");
    EXPECT_THAT(failure_of("kill -SEGV $$"), StartsWith("the program was ended by signal 11"));
    EXPECT_EQ(failure_of("exec >&- <&-; sleep 60"), "the program has closed its output");
}

// What it has started must end with it: the sleeping child holds the output open.
TEST_F(ExternalDetectorTest, ThatIsSilentForTooLongIsStartedAgain) {
    EXPECT_EQ(failure_of("sleep 60", milliseconds(2000)), "no answer within 2000 ms");
}

TEST_F(ExternalDetectorTest, ThatTalksNonsenseIsStartedAgain) {
    constexpr const char* none = "the answer is neither a pose nor a failure";
    for (const char* answer :
         {"hello", "", "[1,2,3,4,5,6]", "{}", R"({"camera_from_marker":[1,2,3,4,5]})",
          R"({"camera_from_marker":[1,2,3,4,5,"6"]})",
          R"({"camera_from_marker":[1,2,3,4,5,1e999]})", R"({"camera_from_marker":null})",
          R"({"failure":3})", R"({"failure":"cut off)"})
        EXPECT_EQ(failure_of(std::string("echo '") + answer + "'"), none) << answer;
    EXPECT_EQ(failure_of("printf '%s\\n%s\\n' \"$pose\" \"$pose\""),
              "the answer is more than one line");
    EXPECT_THAT(failure_of("head -c 200000 /dev/zero | tr '\\0' x"), HasSubstr("longer than"));
}

// A second line that comes late would be taken for the next image's answer.
TEST_F(ExternalDetectorTest, ThatSaysMoreThanItIsAskedIsStartedAgain) {
    const std::filesystem::path said = folder_ / "said";
    auto detector = running(
        "echo \"$pose\"; [ $image = twice ] && { sleep 0.1; echo '{\"failure\":\"late\"}'; : >" +
        said.string() + "; }");
    expect_pose(detector.detect("twice", "c"));
    for (int i = 0; i < 1000 && !std::filesystem::exists(said); ++i)
        SteadyClock().wait_for(milliseconds(5), {});
    ASSERT_TRUE(std::filesystem::exists(said));
    expect_pose(detector.detect("once", "c"));
}

TEST_F(ExternalDetectorTest, ThatNeverReadsFailsEveryTimeInTime) {
    ExternalDetector detector({"sleep", "60"}, milliseconds(150), "--detector");
    for (int i = 0; i < 2; ++i)
        EXPECT_EQ(detector.detect("a", "c").failure, "no answer within 150 ms");
}

TEST_F(ExternalDetectorTest, ThatDoesNotExistIsAnErrorAtOnce) {
    EXPECT_THROW(ExternalDetector({"/nowhere/detector"}, milliseconds(100), "--detector"),
                 ConfigError);
    EXPECT_THROW(ExternalDetector({}, milliseconds(100), "--detector"), ConfigError);
}

TEST_F(ExternalDetectorTest, RefusesPathsThatNoLineCanTell) {
    auto detector = running("echo \"$pose\"");
    EXPECT_THROW(detector.detect("a\tb", "c"), ConfigError);
    EXPECT_THROW(detector.detect("a", "c\nd"), ConfigError);
    expect_pose(detector.detect("a", "c"));
}

}  // namespace
}  // namespace etalon
