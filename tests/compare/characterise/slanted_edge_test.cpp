#include "compare/characterise/slanted_edge.h"

#include "tests/compare/edges/edge_scenes.h"
#include "tests/image_of.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr int width = 40, height = 64;

// Of a radiance by pixel, nothing clipped.
LinearPhoto photo_of(cv::Size size, double noise, const auto& radiance) {
    RandomStream random(5, 1);
    return {image_of(size, radiance) + normal_noise(size, noise, random),
            cv::Mat::zeros(size, CV_8UC1),
            {}};
}

LinearPhoto edge_photo(double degrees, double noise = 0.0) {
    const double angle = degrees * std::numbers::pi / 180.0;
    const Eigen::Vector2d normal(std::cos(angle), std::sin(angle));
    return photo_of({width, height}, noise, [&](int x, int y) {
        const double distance = normal.dot(Eigen::Vector2d(x - 19.3, y - 31.6));
        return 0.1 + 0.7 * gaussian_edge(distance, normal, 0.5);
    });
}

LinearPhoto flat(cv::Size size) {
    return photo_of(size, 0.0, [](int, int) { return 0.4; });
}

SlantedEdge measure(const LinearPhoto& photo) {
    return slanted_edge(photo, {0, 0, photo.radiance.cols, photo.radiance.rows});
}

TEST(SlantedEdge, FindsAngleLevelsAndModulation) {
    const SlantedEdge edge = measure(edge_photo(5.0));
    EXPECT_NEAR(edge.angle_deg, 5.0, 0.02);
    EXPECT_NEAR(edge.dark, 0.1, 1e-4);
    EXPECT_NEAR(edge.light, 0.8, 1e-4);
    EXPECT_DOUBLE_EQ(edge.modulation.front().modulation, 1.0);
    for (const ModulationRow& row : edge.modulation) {
        const double f = row.cycles_per_px;
        EXPECT_NEAR(row.modulation, pixel_transfer_across(5.0, f) * gaussian_transfer(0.5, f),
                    0.004)
            << f;
    }
}

// Mirrored, upside down, turned by a quarter, bright and dark exchanged: the same edge.
TEST(SlantedEdge, DoesNotDependOnWhichWayTheEdgeRuns) {
    const LinearPhoto photo = edge_photo(7.0);
    const SlantedEdge first = measure(photo);
    const auto expect_same = [&](const cv::Mat& radiance) {
        const SlantedEdge edge =
            measure({radiance.clone(), cv::Mat::zeros(radiance.size(), CV_8UC1), {}});
        EXPECT_NEAR(edge.angle_deg, first.angle_deg, 1e-3);
        EXPECT_NEAR(edge.at_nyquist, first.at_nyquist, 0.003);
        EXPECT_NEAR(edge.mtf50_cycles_per_px, first.mtf50_cycles_per_px, 0.003);
    };
    cv::Mat turned;
    for (const int code : {-1, 0, 1}) {
        cv::flip(photo.radiance, turned, code);
        expect_same(turned);
    }
    expect_same(photo.radiance.t());
    expect_same(0.9 - photo.radiance);
}

TEST(SlantedEdge, RefusesRegionsThatHoldNoSlantedEdge) {
    LinearPhoto photo = edge_photo(5.0);
    EXPECT_THROW(slanted_edge(photo, {0, 0, 15, 64}), NumericalError);
    EXPECT_THROW(slanted_edge(photo, {8, 0, 40, 64}), NumericalError);   // outside
    EXPECT_THROW(slanted_edge(photo, {16, 0, 20, 64}), NumericalError);  // too near to a side
    EXPECT_THROW(measure(edge_photo(0.0)), NumericalError);
    EXPECT_THROW(measure(edge_photo(5.0, 0.5)), NumericalError);  // below its noise
    EXPECT_THROW(measure(flat({width, height})), NumericalError);
    photo.clipped.at<uchar>(3, 3) = 255;
    EXPECT_THROW(measure(photo), NumericalError);
}

// How far the band reaches on the side where it reaches less.
double nearer_reach(const StraightEdge& edge) {
    double reach[2] = {};
    for (const EdgePixel& pixel : edge.pixels) {
        double& side = reach[pixel.distance_px > 0.0];
        side = std::max(side, std::abs(pixel.distance_px));
    }
    return std::min(reach[0], reach[1]);
}

// Of a board's long edges, the distances from the projector; sigma 0.55 px behind the pixel box.
// The renderer is right to 0.1 gray of 190, a bin of few pixels passes on a part of that.
TEST(SlantedEdge, TakesTheEdgesOfATarget) {
    EdgeScene scene{edge_camera(220, 170), gray_board("chessboard:3x3@40mm"),
                    pose_of(0.0, 0.0, 0.09, -40.0, -38.0, 500.0)};
    set_gaussian(scene.camera, 0.55);
    const CodeImage photo = SensorModel(scene.camera).expose(scene.rendered());
    int measured = 0;
    for (const StraightEdge& edge : scene.edges(photo, {.half_width_px = 12.0})) {
        if (edge.length_px < 40.0 || nearer_reach(edge) < 9.0)
            continue;
        const SlantedEdge found = slanted_edge(edge);
        EXPECT_NEAR(found.angle_deg, 0.09 * 180.0 / std::numbers::pi, 0.7);
        for (const ModulationRow& row : found.modulation) {
            const double f = row.cycles_per_px;
            if (f <= 0.5) {
                EXPECT_NEAR(row.modulation, sinc(f) * gaussian_transfer(0.55, f), 0.02);
            }
        }
        ++measured;
    }
    EXPECT_GE(measured, 4);
}

// Slanted edges of a picture of which nothing is known.

constexpr double sigma_px = 0.8;  // of the square

// A light quadrilateral: the product of four half planes behind a Gaussian, turned by `degrees`.
LinearPhoto photo_of_a_square(double degrees, double noise) {
    const double angle = degrees * std::numbers::pi / 180.0, half_side = 61.3;
    const auto half_plane = [](double distance) {
        return 0.5 * std::erfc(-distance / sigma_px / std::numbers::sqrt2);
    };
    return photo_of({230, 190}, noise, [&](int x, int y) {
        const double u = (x - 113.4) * std::cos(angle) + (y - 96.8) * std::sin(angle),
                     v = (y - 96.8) * std::cos(angle) - (x - 113.4) * std::sin(angle);
        return 0.12 + 0.55 * half_plane(half_side - u) * half_plane(half_side + u) *
                          half_plane(half_side - v) * half_plane(half_side + v);
    });
}

// exp(-2 (pi sigma f)^2) is one half at sqrt(ln 2 / 2) / (pi sigma).
TEST(EdgeSearch, FindsTheFourSidesOfASquareAndTheirSharpness) {
    const double truth = std::sqrt(std::numbers::ln2 / 2.0) / (std::numbers::pi * sigma_px);
    for (const double degrees : {-7.3, 3.4, 12.1}) {
        const SlantedEdges found = find_slanted_edges(photo_of_a_square(degrees, 0.004));
        EXPECT_EQ(found.edges.size(), 4u) << degrees;
        for (const FoundSlantedEdge& each : found.edges) {
            EXPECT_NEAR(each.edge.angle_deg, std::abs(degrees), 0.2);
            EXPECT_NEAR(each.edge.mtf50_cycles_per_px, truth,
                        0.01 * truth + 4.0 * each.edge.mtf50_standard_uncertainty);
        }
    }
}

TEST(EdgeSearch, TakesNoEdgeAlongThePixelsNorOneFarFromThem) {
    for (const double degrees : {0.0, 31.0}) {
        const SlantedEdges found = find_slanted_edges(photo_of_a_square(degrees, 0.004));
        EXPECT_TRUE(found.edges.empty()) << degrees;
        EXPECT_EQ(found.reason, "");
    }
}

TEST(EdgeSearch, SaysWhyAnEdgeCannotBeMeasured) {
    LinearPhoto photo = photo_of_a_square(5.2, 0.004);
    photo.clipped.setTo(255);
    const SlantedEdges found = find_slanted_edges(photo);
    EXPECT_TRUE(found.edges.empty());
    EXPECT_NE(found.reason.find("clipped pixels"), std::string::npos);
}

TEST(EdgeSearch, FindsNothingInImagesWithoutContent) {
    EXPECT_TRUE(find_slanted_edges(flat({80, 60})).edges.empty());
}

}  // namespace
}  // namespace etalon
