// `etalon compare` and `etalon detect` on photographs that were rendered from the same calibration.
#include <tbb/global_control.h>

#include <nlohmann/json.hpp>

#include "calib/files/camera_file.h"
#include "sim/marker/marker.h"
#include "sim/render/renderer.h"
#include "station/compare/commands.h"
#include "station/compare/compare_baseline.h"
#include "tests/station/stations.h"

namespace etalon {
namespace {

namespace fs = std::filesystem;

constexpr const char* tag_camera_text =
    "etalon: camera/1\n"
    "image: {width: 320, height: 240}\n"
    "intrinsics: {fx: 400, fy: 402, cx: 161, cy: 118}\n"
    "distortion: {k1: -0.1}\n";
constexpr const char* tag_name = "apriltag:36h11:5@50mm";

class CompareCommand : public testing::Test {
protected:
    void SetUp() override {
        write_text(folder_ / "camera.yml", tag_camera_text);
        camera_ = read_camera(folder_ / "camera.yml");
    }

    fs::path photo_of_tag(const std::string& name, double x_mm) {
        const Marker tag = parse_marker(tag_name, "test");
        const Rigid pose{rotation_from_vector({0.2, -0.15, 0.1}), {x_mm, 5.0, 210.0}};
        const Renderer renderer(camera_);
        const fs::path path = folder_ / name;
        // Neither end of the scale is reached.
        const cv::Mat exposed = 0.08 + 0.75 * renderer.render({{{tag.grid, pose}}, 1.0}).radiance;
        write_image(path, SensorModel(camera_).expose(exposed));
        return path;
    }
    fs::path empty_photo(const std::string& name, int width, int height) {
        const fs::path path = folder_ / name;
        write_image(path, {cv::Mat(height, width, CV_8UC1, cv::Scalar(128)), 8});
        return path;
    }
    CompareArguments arguments(std::vector<fs::path> photos) const {
        return {.camera = folder_ / "camera.yml",
                .out = folder_ / "out",
                .marker = tag_name,
                .photos = std::move(photos)};
    }
    // Of run_compare() or run_detect(), which must succeed.
    template <class Arguments>
    static std::string printed(int (*run)(const Arguments&), const Arguments& wanted) {
        testing::internal::CaptureStdout();
        EXPECT_EQ(run(wanted), 0);
        return testing::internal::GetCapturedStdout();
    }
    static nlohmann::json json_of(const CompareArguments& wanted) {
        return nlohmann::json::parse(read_text(wanted.out / "comparison.json"));
    }
    fs::path poses(const std::string& rows) const {
        write_text(folder_ / "poses.csv", "rx,ry,rz,tx,ty,tz\n" + rows);
        return folder_ / "poses.csv";
    }
    std::string message_of(const CompareArguments& wrong) const {
        const std::string text = text_of_error<Error>([&] { run_compare(wrong); });
        EXPECT_FALSE(fs::exists(wrong.out)) << "nothing half-written";
        return text;
    }

    CameraModel camera_;
    TemporaryFolder folder_;
};

TEST_F(CompareCommand, WritesAReportAndPrintsTheMeanResidual) {
    const auto wanted = arguments({photo_of_tag("a.png", 7.0), photo_of_tag("b.png", -9.0)});
    const std::string text = printed(run_compare, wanted);
    EXPECT_THAT(text, HasSubstr(" gray over 2 photos\n"));
    EXPECT_THAT(text, HasSubstr("report " + (wanted.out / "report.html").string() + "\n"));
    const std::string report = read_text(wanted.out / "report.html");
    EXPECT_THAT(report, HasSubstr("a.png"));
    EXPECT_THAT(report, HasSubstr("data:image/"));
    expect_readable_page(report);
    EXPECT_THAT(report, HasSubstr("Not seen by this comparison"));
    EXPECT_THAT(report, HasSubstr("prefers-reduced-motion"));
    for (const char* file : {"photometry.csv", "edges.csv", "profiles.csv", "comparison.json",
                             "residual-by-photo.svg", "01-a-edges.svg", "02-b-significance.png"})
        EXPECT_TRUE(fs::exists(wanted.out / file)) << file;
    EXPECT_EQ(read_image(wanted.out / "01-a-overlay.png").pixels.size(), cv::Size(320, 240));
    EXPECT_EQ(read_image(wanted.out / "02-b-residual.png").pixels.size(), cv::Size(320, 240));
    EXPECT_EQ(split(std::string(trimmed(read_text(wanted.out / "comparison.csv"))), '\n').size(),
              3u);
}

// The detector's own error moves the rendering by a few hundredths of a pixel, which on edges of
// 255 gray leaves a gray or two; a wrong half pixel would leave tens.
TEST_F(CompareCommand, FindsAlmostNothingBetweenTwoRenderings) {
    auto wanted = arguments({photo_of_tag("a.png", 7.0)});
    wanted.json = true;
    const auto json = nlohmann::json::parse(printed(run_compare, wanted));
    EXPECT_LT(json.at("mean_residual_gray").get<double>(), 4.0);
}

// A board tilted through focus, photographed at 303 mm by a lens whose file says 299.
TEST_F(CompareCommand, SaysWhereATiltedBoardIsSharpest) {
    const auto camera_at = [](double focus_mm) {
        return fmt::format(
            "etalon: camera/1\nimage: {{width: 260, height: 170}}\n"
            "intrinsics: {{fx: 900, fy: 905, cx: 128, cy: 86}}\n"
            "lens: {{f_number: 1.4, focus_distance_mm: {}, wavelength_nm: 550,"
            " psf: {{gaussian: {{sigma_px: 0.5}}}}}}\n"
            "sensor: {{pixel_pitch_um: 17, bits: 12, black: 64, gain_e_per_dn: 0.8,"
            " read_noise_e: 7}}\n",
            focus_mm);
    };
    write_text(folder_ / "true.yml", camera_at(303.0));
    write_text(folder_ / "camera.yml", camera_at(299.0));
    const CameraModel lens = read_camera(folder_ / "true.yml");
    const Marker board = parse_marker("chessboard:8x5@10mm", "test");
    const Rigid pose{rotation_from_vector({0.25, -0.8, 0.12}), {-26.0, -22.0, 273.0}};
    const cv::Mat exposed =
        0.08 + 0.7 * Renderer(lens).render({{{board.grid, pose}}, 1.0}).radiance;
    write_image(folder_ / "tilted.png", SensorModel(lens).expose(exposed, NoiseKey{7, 5}));
    auto wanted = arguments({folder_ / "tilted.png"});
    wanted.marker = "chessboard:8x5@10mm";
    wanted.poses = poses("0.25,-0.8,0.12,-26,-22,273\n");
    wanted.json = true;
    const auto json = nlohmann::json::parse(printed(run_compare, wanted));
    const auto& defocus = json.at("photos").at(0).at("defocus");
    // Five standard uncertainties of 0.1 mm.
    EXPECT_NEAR(defocus.at("photograph").at("focus_distance_mm").get<double>(), 303.0, 0.5);
    EXPECT_NEAR(defocus.at("rendering").at("focus_distance_mm").get<double>(), 299.0, 0.5);
    EXPECT_THAT(read_text(wanted.out / "defocus.csv"), HasSubstr("tilted.png"));
    EXPECT_THAT(read_text(wanted.out / "report.html"), HasSubstr("Photograph sharpest at 30"));
    EXPECT_TRUE(fs::exists(wanted.out / "edge-width-by-depth.svg"));
}

TEST_F(CompareCommand, TakesPosesFromAFileInsteadOfADetector) {
    auto wanted = arguments({photo_of_tag("a.png", 7.0)});
    wanted.poses = poses("0.2,-0.15,0.1,7,5,210\n");
    EXPECT_THAT(printed(run_compare, wanted),
                StartsWith("mean residual 0."));  // rounding of the photo, 0.3 gray
}

TEST_F(CompareCommand, CountsAPhotographWithoutItsMarker) {
    const auto wanted =
        arguments({photo_of_tag("a.png", 7.0), empty_photo("nothing.png", 320, 240)});
    testing::internal::CaptureStderr();
    EXPECT_THAT(printed(run_compare, wanted), HasSubstr("over 1 photos"));
    const std::string notes = testing::internal::GetCapturedStderr();
    EXPECT_THAT(notes, HasSubstr("nothing.png: marker not found"));
    EXPECT_THAT(notes, HasSubstr("1 of 2 photographs could not be compared"));
    EXPECT_THAT(read_text(wanted.out / "report.html"), HasSubstr("marker not found"));
    EXPECT_THAT(read_text(wanted.out / "comparison.csv"), HasSubstr("nothing.png,refused,"));
}

TEST_F(CompareCommand, FailsWhenNoPhotographShowsTheMarker) {
    const auto hopeless = arguments({empty_photo("nothing.png", 320, 240)});
    EXPECT_THROW(run_compare(hopeless), NumericalError);
    EXPECT_THAT(message_of(hopeless), HasSubstr("nothing.png: marker not found"));
}

TEST_F(CompareCommand, NamesPhotographAndCalibrationWhenTheirSizesDiffer) {
    const auto wrong = arguments({photo_of_tag("a.png", 7.0), empty_photo("large.png", 640, 480)});
    EXPECT_THROW(run_compare(wrong), ConfigError);
    const std::string message = message_of(wrong);
    EXPECT_THAT(message, HasSubstr("large.png: is 640 x 480 px"));
    EXPECT_THAT(message, HasSubstr("camera.yml is for 320 x 240 px"));
}

TEST_F(CompareCommand, RefusesContradictoryArgumentsBeforeItWritesAnything) {
    const auto good = arguments({photo_of_tag("a.png", 7.0)});
    const auto refused = [&](auto change, const std::string& why) {
        auto wrong = good;
        change(wrong);
        EXPECT_THAT(message_of(wrong), HasSubstr(why));
    };
    using Arguments = CompareArguments;
    refused([](Arguments& a) { a.board = "9x6"; }, "--board");
    refused([](Arguments& a) { a.marker.clear(), a.board = "9x6"; }, "--square-mm");
    refused([](Arguments& a) { a.score_margin = "0.3,0.3"; }, "--score-margin");
    refused([&](Arguments& a) { a.photos = {folder_ / "missing.png"}; },
            "missing.png: no such file");
    refused([&](Arguments& a) { a.poses = poses("0,0,0,7,5,-210\n"); },
            "pose 1: the marker is behind the camera");
    refused([&](Arguments& a) { a.poses = poses("0,0,0,7,5,210\n0,0,0,7,5,220\n"); },
            "holds 2 poses for 1 photographs");
    auto onto_a_file = good;
    onto_a_file.out = folder_ / "camera.yml";
    EXPECT_THROW(run_compare(onto_a_file), ConfigError);
}

TEST_F(CompareCommand, ReplacesAnEarlierReportAndLeavesNothingOfIt) {
    auto wanted = arguments({photo_of_tag("a.png", 7.0), photo_of_tag("b.png", -9.0)});
    printed(run_compare, wanted);
    EXPECT_TRUE(fs::exists(wanted.out / "02-b-overlay.png"));
    write_text(wanted.out / "notes.txt", "mine");
    wanted.photos.pop_back();
    printed(run_compare, wanted);
    for (const auto& entry : fs::directory_iterator(wanted.out))
        EXPECT_THAT(entry.path().filename().string(), Not(StartsWith("02-")));
    EXPECT_TRUE(fs::exists(wanted.out / "01-a-overlay.png"));
    EXPECT_EQ(read_text(wanted.out / "notes.txt"), "mine");
}

std::map<std::string, std::string> contents(const fs::path& folder) {
    std::map<std::string, std::string> files;
    for (const auto& entry : fs::directory_iterator(folder))
        files[entry.path().filename().string()] = read_bytes(entry.path());
    return files;
}

TEST_F(CompareCommand, GivesTheSameBytesForAnyNumberOfThreads) {
    auto one = arguments({photo_of_tag("a.png", 7.0), photo_of_tag("b.png", -9.0)});
    auto two = one;
    two.out = folder_ / "again";
    {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
        printed(run_compare, one);
    }
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 2);
    printed(run_compare, two);
    const auto first = contents(one.out), second = contents(two.out);
    EXPECT_GT(first.size(), 15u);
    ASSERT_EQ(first.size(), second.size());
    for (const auto& [name, bytes] : first)
        EXPECT_TRUE(second.contains(name) && second.at(name) == bytes) << name;
}

TEST_F(CompareCommand, ComparesWithAnEarlierComparisonOfTheSameCamera) {
    const auto then = arguments({photo_of_tag("a.png", 7.0), photo_of_tag("b.png", -9.0)});
    auto now = then;
    now.out = folder_ / "now";
    now.baseline = then.out;
    printed(run_compare, then);
    const std::string text = printed(run_compare, now);
    EXPECT_THAT(text, HasSubstr("2 photos paired"));
    EXPECT_THAT(text, Not(HasSubstr("changed"))) << "the same photographs";
    const auto json = json_of(now);
    for (const auto& quantity : json.at("baseline").at("quantities"))
        EXPECT_NEAR(quantity.at("change").get<double>(), 0.0, 1e-9) << quantity.at("quantity");
    EXPECT_THAT(read_text(now.out / "baseline.csv"), HasSubstr("\na.png,matched,matched,"));
    EXPECT_THAT(read_text(now.out / "report.html"), HasSubstr("Change since the baseline"));

    auto other = now;
    other.marker = "apriltag:36h11:5@49mm";
    EXPECT_THROW(run_compare(other), ConfigError);
    auto onto_itself = now;
    onto_itself.out = now.baseline;
    EXPECT_THROW(run_compare(onto_itself), ConfigError);
}

// The pose says that a marker is there; the photograph is evenly gray.
TEST_F(CompareCommand, NamesWhatStandsInTheWayOfAMatch) {
    auto wanted = arguments({photo_of_tag("a.png", 7.0), empty_photo("gray.png", 320, 240)});
    wanted.poses = poses("0.2,-0.15,0.1,7,5,210\n0.2,-0.15,0.1,7,5,210\n");
    EXPECT_THAT(printed(run_compare, wanted), HasSubstr("matched 1 of 2 photos"));
    const auto refused = json_of(wanted).at("photos").at(1);
    EXPECT_EQ(refused.at("outcome"), "refused");
    EXPECT_FALSE(refused.at("findings").empty());
    EXPECT_FALSE(refused.contains("calibrated")) << "its figures would mean nothing";
    const std::string name = refused.at("findings").at(0).at("name");
    EXPECT_THAT(read_text(wanted.out / "comparison.csv"), HasSubstr("refused," + name));
    EXPECT_THAT(read_text(wanted.out / "report.html"), HasSubstr("<strong>" + name));
}

TEST_F(CompareCommand, DetectPrintsThePoseOfEachPhotograph) {
    DetectArguments wanted{
        .marker = tag_name,
        .camera = folder_ / "camera.yml",
        .photos = {photo_of_tag("a.png", 7.0), empty_photo("nothing.png", 320, 240)}};
    const std::string table = printed(run_detect, wanted);
    EXPECT_THAT(table, HasSubstr("a.png"));
    EXPECT_THAT(table, HasSubstr("nothing.png marker not found"));
    wanted.json = true;
    EXPECT_THAT(printed(run_detect, wanted), HasSubstr("\"reprojection_rms_px\""));
}

class PhotometricDetect : public CompareCommand {
protected:
    // The photograph of photo_of_tag("a.png", 7.0) and where the marker is found in it.
    nlohmann::json found(const std::string& starts) {
        DetectArguments wanted{.marker = tag_name,
                               .camera = folder_ / "camera.yml",
                               .photos = {photo_of_tag("a.png", 7.0)},
                               .detector = "photometric",
                               .json = true};
        if (!starts.empty())
            wanted.poses = poses(starts + "\n");
        return nlohmann::json::parse(printed(run_detect, wanted)).at("photos").at(0);
    }
};

// Without noise but rounding, 0.3 gray on a tag of 95 px: some um across, ten times that along.
void expect_true_pose(const nlohmann::json& photo) {
    const auto pose = photo.at("camera_from_marker").get<std::vector<double>>();
    const std::vector<double> truth = {0.2, -0.15, 0.1, 7.0, 5.0, 210.0};
    for (std::size_t i = 0; i < 3; ++i)
        EXPECT_NEAR(pose[i], truth[i], 1e-3) << i;
    for (std::size_t i = 3; i < 6; ++i)
        EXPECT_NEAR(pose[i], truth[i], i < 5 ? 0.01 : 0.05) << i;
}

TEST_F(PhotometricDetect, StartsFromTheMarkersOwnDetector) {
    const nlohmann::json photo = found("");
    expect_true_pose(photo);
    ASSERT_EQ(photo.at("covariance").size(), 6u);
    EXPECT_GT(photo.at("covariance")[5][5].get<double>(), 0.0);
}

// 3 px and half a degree away.
TEST_F(PhotometricDetect, StartsFromAPoseThatIsAboutRight) {
    expect_true_pose(found("0.205,-0.145,0.105,8.5,4.2,211"));
}

// ---- compare baseline

// Two comparisons of one camera against each other: pairing, intervals, and files that cannot be
// trusted.

PhotoSummary photo(const std::string& name, double residual_gray) {
    return {.name = name, .outcome = "matched", .residual_gray = residual_gray};
}

ComparisonSummary comparison(std::vector<PhotoSummary> photos) {
    return {"SN-7", 640, 480, "chessboard:9x6@25mm", std::move(photos)};
}

TEST(CompareBaseline, PairsPhotographsByNameAndListsTheRest) {
    const auto change =
        compare_with_baseline(comparison({photo("a.png", 5), photo("twice.png", 5),
                                          photo("then.png", 7), photo("b.png", 5)}),
                              comparison({photo("b.png", 7), photo("now.png", 5), photo("a.png", 5),
                                          photo("twice.png", 5), photo("twice.png", 7)}),
                              "then");
    ASSERT_EQ(change.pairs.size(), 2u);
    EXPECT_EQ(change.pairs[0].now.name, "b.png");
    EXPECT_EQ(change.pairs[1].earlier.name, "a.png");
    EXPECT_THAT(change.only_now, ElementsAre("now.png"));
    EXPECT_THAT(change.only_earlier, ElementsAre("then.png"));
    EXPECT_THAT(change.ambiguous, ElementsAre("twice.png"));
    ASSERT_EQ(change.quantities.size(), 1u) << "only the residual has figures";
    EXPECT_EQ(change.quantities[0].pairs, 2);
    EXPECT_DOUBLE_EQ(change.quantities[0].mean, 1.0);
}

// Differences 1 2 3 4 5: mean 3, standard deviation sqrt(2.5); Student's t for 4 degrees of freedom
// is 2.7764 at 97.5 % (any table), so the half width is 2.7764 sqrt(2.5 / 5) = 1.9632.
TEST(CompareBaseline, GivesThePairedIntervalOfATable) {
    std::vector<PhotoSummary> earlier, now;
    for (int i = 1; i <= 5; ++i) {
        earlier.push_back(photo(std::to_string(i), 7.0 * i));
        now.push_back(photo(std::to_string(i), 7.0 * i + i));
    }
    const auto change = compare_with_baseline(comparison(earlier), comparison(now), "then");
    ASSERT_EQ(change.quantities.size(), 1u);
    const PairedChange& residual = change.quantities[0];
    EXPECT_NEAR(residual.mean, 3.0, 1e-12);
    EXPECT_NEAR(residual.half_width.value(), 1.9632, 1e-4);
    EXPECT_TRUE(residual.changed());
}

// Two quantities: each interval may miss with 2.5 % only. For 1 degree of freedom Student's t is
// Cauchy's: its quantile is tan(pi (p - 1/2)).
TEST(CompareBaseline, WidensIntervalsForTheNumberOfQuantities) {
    std::vector<PhotoSummary> earlier{photo("a", 5), photo("b", 5)},
        now{photo("a", 6), photo("b", 8)};
    for (auto* photos : {&earlier, &now})
        for (PhotoSummary& each : *photos)
            each.psf_sigma_px = 0.7;
    const auto change = compare_with_baseline(comparison(earlier), comparison(now), "then");
    ASSERT_EQ(change.quantities.size(), 2u);
    const double t = std::tan(M_PI * (0.5 - 0.05 / 4));
    EXPECT_NEAR(change.quantities[0].half_width.value(), t * 1.0, 1e-9);
    EXPECT_FALSE(change.quantities[0].changed());
    EXPECT_DOUBLE_EQ(change.quantities[1].half_width.value(), 0.0);
    EXPECT_FALSE(change.quantities[1].changed()) << "equal is not changed";
}

TEST(CompareBaseline, OnePairHasNoInterval) {
    const auto change =
        compare_with_baseline(comparison({photo("a", 5)}), comparison({photo("a", 7)}), "then");
    EXPECT_FALSE(change.quantities.at(0).half_width);
    EXPECT_FALSE(change.quantities.at(0).changed());
}

// A marker moved by (7, -5, 3) mm in the camera frame and turned by 0.02 rad about its own y axis.
TEST(CompareBaseline, ReportsAPoseInMillimetresOfTheCameraAndMilliradiansOfTheMarker) {
    const Rigid earlier{rotation_from_vector({0.3, -0.2, 0.9}), {10, 20, 400}};
    const Rigid now{earlier.rotation * rotation_from_vector({0, 0.02, 0}), {17, 15, 403}};
    const Vector6d change = pose_change(earlier, now);
    EXPECT_TRUE(change.isApprox((Vector6d() << 7, -5, 3, 0, 20, 0).finished(), 1e-9)) << change;
}

TEST(CompareBaseline, RefusesAnotherCameraByName) {
    const ComparisonSummary now = comparison({});
    const auto message = [&](const ComparisonSummary& earlier) {
        return config_error_of([&] { require_same_camera(earlier, now); });
    };
    EXPECT_EQ(message(now), "no error");
    ComparisonSummary other = now;
    other.serial = "SN-5";
    EXPECT_THAT(message(other), AllOf(HasSubstr("SN-5"), HasSubstr("SN-7")));
    other.serial = "";
    EXPECT_EQ(message(other), "no error") << "not known is not another one";
    other = now;
    other.height = 470;
    EXPECT_THAT(message(other), HasSubstr("640 x 470 px"));
    other = now;
    other.marker = "chessboard:9x6@24mm";
    EXPECT_THAT(message(other), HasSubstr("chessboard:9x6@24mm"));
}

constexpr const char* good_file = R"json({
  "etalon": "comparison/1", "serial": "SN-7", "image": {"width": 640, "height": 480},
  "marker": "chessboard:9x6@25mm", "mean_residual_gray": 5.5,
  "photos": [
    {"photo": "shots/a.png", "outcome": "matched",
     "calibrated": {"camera_from_marker": [0.1, 0.2, 0.3, 7, 5, 400],
                    "scored": {"rms_gray": 5.5}, "photometric_model": {"psf_sigma_px": 0.7},
                    "edges": {"shift_rms_px": 0.125}},
     "refined": {"camera_from_marker": [0.1, 0.2, 0.3, 7, 5, 401], "scored": {"rms_gray": 5.25}}},
    {"photo": "shots/b.png", "outcome": "refused", "failure": "marker not found"}
  ]})json";

class BaselineFile : public testing::Test {
protected:
    std::string message_with(const std::string& text, const std::string& replacement) {
        return message_of(replaced(good_file, text, replacement));
    }
    std::string message_of(const std::string& file) {
        write_text(folder_ / "comparison.json", file);
        return config_error_of([&] { read_comparison(folder_.path()); });
    }
    TemporaryFolder folder_;
};

TEST_F(BaselineFile, ReadsWhatIsCompared) {
    ASSERT_EQ(message_of(good_file), "no error");
    const ComparisonSummary summary = read_comparison(folder_.path());
    EXPECT_EQ(summary.serial, "SN-7");
    EXPECT_EQ(summary.height, 480);
    ASSERT_EQ(summary.photos.size(), 2u);
    EXPECT_EQ(summary.photos[0].name, "a.png");
    EXPECT_EQ(summary.photos[0].residual_gray, 5.5);
    EXPECT_EQ(summary.photos[0].refined_residual_gray, 5.25);
    EXPECT_EQ(summary.photos[0].edge_shift_px, 0.125);
    EXPECT_EQ(summary.photos[0].psf_sigma_px, 0.7);
    EXPECT_EQ(summary.photos[0].refined_from_marker->translation.z(), 401);
    EXPECT_FALSE(summary.photos[1].residual_gray);
}

TEST_F(BaselineFile, NamesFileAndKeyOfWhatItCannotTrust) {
    const struct {
        const char *text, *replacement, *key;
    } cases[] = {
        {"comparison/1", "comparison/2", "comparison/2"},
        {"\"serial\": \"SN-7\"", "\"serial\": [7]", "serial"},
        {"\"width\": 640", "\"width\": -640", "image.width"},
        {"\"width\": 640", "\"width\": 1e300", "image.width"},
        {"\"image\": {\"width\": 640, \"height\": 480}", "\"image\": 5", "image"},
        {"\"marker\": \"chessboard:9x6@25mm\",", "", "marker"},
        {"\"rms_gray\": 5.5}", "\"rms_gray\": -5.5}", "photos[0].calibrated.scored.rms_gray"},
        {"\"rms_gray\": 5.5}", "\"rms_gray\": .nan}", "photos[0].calibrated.scored.rms_gray"},
        {"\"rms_gray\": 5.5}", "\"rms_gray\": 1e200}", "photos[0].calibrated.scored.rms_gray"},
        {"\"rms_gray\": 5.25}", "\"rms_gray\": \"5\"}", "photos[0].refined.scored.rms_gray"},
        {"7, 5, 400]", "7, 5]", "photos[0].calibrated.camera_from_marker"},
        {"7, 5, 400]", "7, 5, 1e308]", "photos[0].calibrated.camera_from_marker"},
        {"\"shift_rms_px\": 0.125", "\"shift_rms_px\": null", "shift_rms_px"},
        {"\"shots/a.png\"", "\"\"", "photos[0].photo"},
        {"\"outcome\": \"matched\",", "", "photos[0].outcome"},
    };
    for (const auto& each : cases) {
        const std::string message = message_with(each.text, each.replacement);
        EXPECT_THAT(message, HasSubstr(each.key)) << each.replacement;
        EXPECT_THAT(message, HasSubstr("comparison.json")) << each.replacement;
    }
    EXPECT_THAT(message_with("\"marker\"", "\"serial\": \"x\", \"marker\""), HasSubstr("serial"));
    for (const std::string& broken : {std::string(), std::string("{\"etalon\": \"comparison/1\""),
                                      std::string("[1, 2, 3]"), std::string("\0\1\2", 3)})
        EXPECT_NE(message_of(broken), "no error") << broken;
}

TEST_F(BaselineFile, NamesAFolderWithoutAComparison) {
    EXPECT_THROW(read_comparison(folder_ / "nothing"), ConfigError);
}

}  // namespace
}  // namespace etalon
