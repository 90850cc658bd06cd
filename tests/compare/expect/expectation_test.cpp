#include "compare/expect/expectation.h"

#include "compare/make_detector.h"
#include "core/geometry/units.h"
#include "core/statistics/random.h"
#include "station/planning/expectation_report.h"
#include "station/qualify/run_analysis.h"
#include "station/setup/station_file.h"
#include "tests/calib/cameras.h"
#include "tests/station/stations.h"

namespace etalon {
namespace {

// By hand, for a marker on the camera's right that faces the camera's own z.
TEST(Expectation, ComponentsAreAlongTheSightAndTheTilt) {
    const Rigid pose{Eigen::Quaterniond::Identity(), {300.0, 0.0, 400.0}};  // 3-4-5: 500 mm away
    const auto of = [&](const Eigen::Vector3d& mm, const Eigen::Vector3d& rad) {
        return components_of({mm, rad}, pose);
    };
    const auto near = [](const SixErrors& found, const SixErrors& expected) {
        for (std::size_t k = 0; k < 6; ++k)
            EXPECT_NEAR(found[k], expected[k], 1e-12) << error_components[k].name;
    };
    near(of({0.6, 0.0, 0.8}, {0, 0, 0}), {1, 0, 0, 0, 0, 0});
    near(of({0.8, 0.0, -0.6}, {0, 0, 0}), {0, 1, 0, 0, 0, 0});
    near(of({0.0, 1.0, 0.0}, {0, 0, 0}), {0, 0, 1, 0, 0, 0});
    near(of({0, 0, 0}, {0, 0, 1e-3}), {0, 0, 0, 1, 0, 0});
    // The sight leans to +x: turning the normal to -x, about -y, tilts it farther.
    near(of({0, 0, 0}, {0, -1e-3, 0}), {0, 0, 0, 0, 1, 0});
    near(of({0, 0, 0}, {1e-3, 0, 0}), {0, 0, 0, 0, 0, 1});
}

// The third component of rotation is the derivative of the tilt itself.
TEST(Expectation, TheTiltErrorIsTheChangeOfTheTilt) {
    const Projector projector(camera_with(640, 480, {540, 540, 320, 240}));
    const Rigid pose{rotation_from_vector({0.4, -0.3, 1.1}), {60.0, -45.0, 500.0}};
    const Eigen::Vector3d w(2e-6, -3e-6, 1e-6);
    const Rigid turned{pose.rotation * rotation_from_vector(w), pose.translation};
    const double change = place_of(projector, turned).tilt_rad - place_of(projector, pose).tilt_rad;
    EXPECT_NEAR(components_of({Eigen::Vector3d::Zero(), w}, pose)[4], 1000.0 * change, 1e-6);
}

std::vector<MarkerPlace> places(int count) {
    std::vector<MarkerPlace> all;
    for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(count); ++i) {
        RandomStream random(3, 1, i);
        all.push_back({300.0 + 300.0 * random.uniform(), 200.0 * random.uniform(),
                       45.0 * rad_per_deg * random.uniform()});
    }
    return all;
}

TEST(ExpectationMap, IsExactForWhatItCanRepresent) {
    const std::vector<MarkerPlace> all = places(50);
    const auto truth = [](const MarkerPlace& p) {
        const double z = p.depth_mm / 100.0, r = p.radius_px / 100.0;
        return 0.7 - 0.2 * z + 0.05 * z * z + 0.3 * r * r - 1.1 * p.tilt_rad * p.tilt_rad +
               0.01 * z * r;
    };
    std::vector<double> values;
    for (const MarkerPlace& place : all)
        values.push_back(truth(place));
    const ExpectationMap map(all, values, 1);
    const MarkerPlace elsewhere{431.0, 77.0, 0.3};
    const MapValue found = map.at(elsewhere);
    EXPECT_NEAR(found.value, truth(elsewhere), 1e-9);
    EXPECT_NEAR(found.low, found.high, 1e-9);  // nothing scatters
    EXPECT_LT(map.scatter(), 1e-9);
    EXPECT_NEAR(std::abs(values[map.worst()]),
                Eigen::Map<Eigen::VectorXd>(values.data(), 50).cwiseAbs().maxCoeff(), 1e-9);
}

// 95 % intervals of the average, of 100 maps of skewed noise (exponential, mean 1) around zero,
// 60 poses each. The bootstrap of 60 values is a little narrow: 92 to 94 % are known for it. A
// share of 0.93 over 100 runs has a deviation of 0.026; 3.5 of these below it are 0.84.
TEST(ExpectationMap, HasIntervalsThatHoldTheTruth) {
    const std::vector<MarkerPlace> all = places(60);
    int inside = 0;
    for (std::uint64_t run = 0; run < 100; ++run) {
        std::vector<double> values;
        for (std::uint64_t i = 0; i < all.size(); ++i)
            values.push_back(-std::log(RandomStream(50 + run, 1, i).uniform()));
        const MapValue mean = ExpectationMap(all, values, run).mean();
        inside += mean.low <= 1.0 && 1.0 <= mean.high;
    }
    EXPECT_GE(inside, 84);
    EXPECT_LE(inside, 99);
}

TEST(ExpectationMap, RefusesTooFewPosesAndNumbersWithoutAMeaning) {
    EXPECT_THROW(ExpectationMap(places(19), std::vector<double>(19), 1), NumericalError);
    std::vector<double> values(30);
    values[4] = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(ExpectationMap(places(30), values, 1), NumericalError);
}

ExpectationRequest small_request() {
    return {.scene = {.camera = camera_with(240, 180, {210, 210, 121, 88}, {},
                                            Sensor{.gain_e_per_dn = 40.0, .read_noise_e = 12.0}),
                      .marker = parse_marker("apriltag:36h11:5@60mm", "test"),
                      .white_level = 0.8},
            .volume = {160.0, 260.0, 40.0 * rad_per_deg},
            .poses = 24,
            .frames = 4,
            .seed = 2};
}

// Independent corner noise s at a frontal square of half side a at depth z moves it by s z / (2 f)
// across the line of sight and by s z^2 / (2 sqrt(2) a f) along it: the ratio is z / (sqrt(2) a), 5
// here. Corners that are where fitted edges meet are correlated and the markers tilted: a factor of
// 3 either way.
TEST(Expectation, MeasuresBiasAndNoiseOfACoupleOfCameraAndMarker) {
    const ExpectationRequest request = small_request();
    const Expectation found = expect_errors(request);
    EXPECT_EQ(found.detected(), 24);
    EXPECT_GT(found.detection_rate(), 0.95);
    ASSERT_TRUE(found.bias_maps && found.noise_maps);
    const std::vector<double> along = found.values(&ExpectedPose::noise, 0),
                              across = found.values(&ExpectedPose::noise, 1);
    double squares_along = 0.0, squares_across = 0.0;
    for (std::size_t i = 0; i < along.size(); ++i) {
        squares_along += along[i] * along[i];
        squares_across += across[i] * across[i];
    }
    const double ratio = std::sqrt(squares_along / squares_across);
    EXPECT_GT(ratio, 5.0 / 3.0);
    EXPECT_LT(ratio, 5.0 * 3.0);
    for (const double deviation : across) {
        EXPECT_GT(deviation, 1e-4);  // mm; a thousandth of a pixel would be 5e-4
        EXPECT_LT(deviation, 0.1);
    }
}

TEST(Expectation, DoesNotDependOnTheThreadsAndIsWrittenInFull) {
    ExpectationRequest request = small_request();
    request.frames = 1;
    const Expectation once = expect_errors(request), again = expect_errors(request);
    const std::string json = expectation_json(request, once);
    EXPECT_EQ(json, expectation_json(request, again));
    EXPECT_THAT(json, HasSubstr("\"etalon\": \"expectation/1\""));
    const std::string csv = expectation_csv(once);
    EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 25);
    HtmlPage page("test", "");
    add_expectation(page, once);
    EXPECT_THAT(page.finish(), HasSubstr("along the line of sight"));
}

// Two frames 0.01 mm to either side of the truth have the deviation 0.01 sqrt(2).
TEST(RunExpectation, TakesBiasAndNoiseFromTheRun) {
    const ExpectationRequest request = small_request();
    const Projector projector(request.scene.camera);
    QualifyResult result;
    result.station.camera.model = request.scene.camera;
    result.station.marker = request.scene.marker;
    result.station.plan.frames = 2;
    result.analysis.emplace();
    for (const Rigid& pose : volume_poses(request.scene.camera, request.scene.marker.grid, 25, 4,
                                          {160.0, 260.0, 40.0 * rad_per_deg})) {
        const Eigen::Vector3d sight = pose.translation.normalized();
        AnalysedPose record;
        record.hold_out = true;
        record.bias.predicted = pose;
        record.bias.b1 = PoseError{0.3 * sight, {0.0, 0.0, 2e-3}};
        for (const double side : {-0.01, 0.01}) {
            Rigid moved = pose;
            moved.translation += side * sight.cross(Eigen::Vector3d(0, 0, 1)).normalized();
            record.frames.emplace_back().corners =
                corners_at(projector, request.scene.marker.points_mm, moved);
        }
        record.detections = 2;
        result.poses.push_back(record);
    }
    const Expectation found = run_expectation(result);
    ASSERT_TRUE(found.bias_maps && found.noise_maps);
    EXPECT_NEAR((*found.bias_maps)[0].mean().value, 0.3, 1e-9);
    EXPECT_NEAR((*found.bias_maps)[1].mean().value, 0.0, 1e-9);
    EXPECT_NEAR((*found.bias_maps)[3].mean().value, 2.0, 1e-9);
    for (const double deviation : found.values(&ExpectedPose::noise, 2))
        EXPECT_NEAR(deviation, 0.01 * std::sqrt(2.0), 1e-5);
    for (const double deviation : found.values(&ExpectedPose::noise, 0))
        EXPECT_LT(deviation, 1e-3);
    HtmlPage page("test", "");
    add_run_expectation(page, result);
    EXPECT_THAT(page.finish(), HasSubstr("What to expect"));
}

TEST(RunExpectation, SaysNothingWithoutAnAnalysis) {
    HtmlPage page("test", "");
    add_run_expectation(page, QualifyResult{});
    EXPECT_THAT(page.finish(), Not(HasSubstr("What to expect")));
}

// Poses aside that are not rendered are not among them, and others are in their place.
TEST(Expectation, TakesAWideLensAsFarAsItIsRendered) {
    ExpectationRequest request = small_request();
    request.scene.camera.projection.kind = Projection::equidistant;
    request.scene.camera.intrinsics = {70, 70, 121, 88};
    request.volume = {60.0, 110.0, 40.0 * rad_per_deg};
    request.poses = 40;
    request.frames = 0;
    const Expectation found = expect_errors(request);
    ASSERT_EQ(found.poses.size(), 40u);
    EXPECT_GE(found.detected(), 20);  // those nearly edge-on are not
    double widest = 0.0;
    for (const ExpectedPose& pose : found.poses) {
        const Eigen::Vector3d& p = pose.camera_from_marker.translation;
        EXPECT_NEAR(pose.place.depth_mm, p.norm(), 1e-9);
        widest = std::max(widest, std::acos(p.normalized().z()));
    }
    EXPECT_GT(widest, 45.0 * rad_per_deg);
    EXPECT_LT(widest, 80.0 * rad_per_deg);
}

TEST(Expectation, SaysWhyThereIsNoNoise) {
    ExpectationRequest request = small_request();
    request.scene.camera.sensor.reset();
    request.poses = 20;
    const Expectation found = expect_errors(request);
    EXPECT_EQ(found.frames, 0);
    EXPECT_THAT(found.no_noise, HasSubstr("no sensor noise"));
    EXPECT_FALSE(found.noise_maps);
    EXPECT_EQ(summary_rows(found)[0].back(), "unknown");
}

TEST(Expectation, RefusesAVolumeThatTheMarkerDoesNotFit) {
    ExpectationRequest request = small_request();
    request.volume = {20.0, 30.0, 0.1};
    EXPECT_THROW(expect_errors(request), NumericalError);
    request.scene.detector = "chessboard";
    EXPECT_THROW(expect_errors(request), ConfigError);
}

// ---- expected view

StationFile noisy_station(const TemporaryFolder& folder) {
    StationFile station = read_station(write_station(folder, station_text));
    station.camera.model.sensor = Sensor{.bits = 8, .gain_e_per_dn = 55.0, .read_noise_e = 12.0};
    return station;
}

class ExpectedViewTest : public testing::Test {
protected:
    ExpectedViewTest() : station_(noisy_station(folder_)), view_(expected_scene(station_)) {}

    // Off the image's centre, turned and tilted.
    Rigid pose(double x, double y, double z) const {
        const Eigen::Quaterniond rotation(
            Eigen::AngleAxisd(0.6, Eigen::Vector3d(0.3, 0.8, 0.2).normalized()));
        return {rotation, {x, y, z}};
    }
    std::unique_ptr<Detector> detector() const {
        return make_detector("auto", station_.marker, "test");
    }

    TemporaryFolder folder_;
    StationFile station_;
    ExpectedView view_;
};

TEST_F(ExpectedViewTest, AreaHoldsTheMarkerAndAMarginOfTwentyFourPixels) {
    const Rigid marker = pose(17, -11, 380);
    const cv::Rect area = view_.area_of(marker);
    const cv::Rect all(0, 0, station_.camera.model.width, station_.camera.model.height);
    EXPECT_LT(area.area(), all.area());
    const Projector projector(station_.camera.model);
    const CellGrid& grid = station_.marker.grid;
    for (const int u : {0, grid.columns()})
        for (const int v : {0, grid.rows()}) {
            const Eigen::Vector2d pixel = *projector.project(marker * grid.point_mm(u, v));
            for (const int x : {-24, 24})
                for (const int y : {-24, 24}) {
                    const cv::Point place(static_cast<int>(pixel.x() + x),
                                          static_cast<int>(pixel.y() + y));
                    EXPECT_TRUE(!all.contains(place) || area.contains(place)) << u << v << x << y;
                }
        }
    EXPECT_EQ(area.x % 16, 0);
    EXPECT_EQ(area.y % 16, 0);
}

TEST_F(ExpectedViewTest, AreaIsTheWholeImageForAMarkerThatIsNotInIt) {
    const cv::Rect all(0, 0, station_.camera.model.width, station_.camera.model.height);
    EXPECT_EQ(view_.area_of(pose(5000, 0, 380)), all);
}

// The same pixels with the same noise: corners agree to what the detector's thresholds near the
// area's border may do, which is nothing, and to single precision, in which AprilTag fits.
TEST_F(ExpectedViewTest, CornersOfTheAreaAreThoseOfTheWholeImage) {
    const auto part = detector(), whole = detector();
    for (const Rigid& marker : {pose(17, -11, 380), pose(-40, 25, 420), pose(3, 7, 350)}) {
        const ExpectedExposures exposures(view_, marker);
        for (std::uint32_t frame = 0; frame < 3; ++frame) {
            const NoiseKey noise{7, frame};
            const auto found = exposures.with_noise(*part, noise);
            const auto expected =
                whole->detect(view_.sensor().expose(view_.radiance_at(marker), noise)).corners;
            ASSERT_TRUE(found && expected);
            for (std::size_t k = 0; k < 4; ++k)
                EXPECT_LT((found->pixels[k] - expected->pixels[k]).norm(), 1e-4) << k;
        }
    }
}

TEST_F(ExpectedViewTest, NoiseMovesTheCornersALittle) {
    const auto tag = detector();
    const ExpectedExposures exposures(view_, pose(17, -11, 380));
    const auto clean = exposures.without_noise(*tag), noisy = exposures.with_noise(*tag, {7, 5});
    ASSERT_TRUE(clean && noisy);
    for (std::size_t k = 0; k < 4; ++k) {
        const double moved = (noisy->pixels[k] - clean->pixels[k]).norm();
        EXPECT_GT(moved, 1e-5);
        EXPECT_LT(moved, 0.5);
    }
}

}  // namespace
}  // namespace etalon
