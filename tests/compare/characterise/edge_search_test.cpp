#include "compare/characterise/slanted_edge.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/statistics/random.h"

namespace etalon {
namespace {

constexpr double sigma_px = 0.8;

// A light quadrilateral: the product of four half planes behind a Gaussian, turned by `degrees`.
LinearPhoto photo_of_a_square(double degrees, double noise) {
    const double angle = degrees * std::numbers::pi / 180.0, half_side = 61.3;
    const auto half_plane = [](double distance) {
        return 0.5 * std::erfc(-distance / sigma_px / std::numbers::sqrt2);
    };
    LinearPhoto photo;
    photo.radiance.create(190, 230, CV_32FC1);
    photo.clipped = cv::Mat::zeros(photo.radiance.size(), CV_8UC1);
    RandomStream random(3, 1);
    for (int y = 0; y < photo.radiance.rows; ++y)
        for (int x = 0; x < photo.radiance.cols; ++x) {
            const double u = (x - 113.4) * std::cos(angle) + (y - 96.8) * std::sin(angle),
                         v = (y - 96.8) * std::cos(angle) - (x - 113.4) * std::sin(angle);
            const double inside = half_plane(half_side - u) * half_plane(half_side + u) *
                                  half_plane(half_side - v) * half_plane(half_side + v);
            photo.radiance.at<float>(y, x) =
                static_cast<float>(0.12 + 0.55 * inside + noise * random.normal());
        }
    return photo;
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
    LinearPhoto flat;
    flat.radiance = cv::Mat(60, 80, CV_32FC1, cv::Scalar(0.4));
    flat.clipped = cv::Mat::zeros(60, 80, CV_8UC1);
    EXPECT_TRUE(find_slanted_edges(flat).edges.empty());
}

}  // namespace
}  // namespace etalon
