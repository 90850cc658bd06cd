// Two comparisons of one camera against each other: pairing, intervals, and files that cannot be
// trusted.
#include "station/compare/compare_baseline.h"

#include "tests/station/stations.h"

namespace etalon {
namespace {

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
