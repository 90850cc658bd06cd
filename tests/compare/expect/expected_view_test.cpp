#include "compare/expect/expected_view.h"

#include "compare/make_detector.h"
#include "station/setup/station_file.h"
#include "tests/station/stations.h"

namespace etalon {
namespace {

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
