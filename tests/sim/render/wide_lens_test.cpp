// Lenses that see more than a plane, sharp, up to 80 degrees from the axis: against the reference
// integrator, and against rays traced to the marker in space, which know of no plane before them.
#include <gtest/gtest.h>

#include "calib/camera/projector.h"
#include "core/errors.h"
#include "sim/render/reference_integrator.h"
#include "sim/render/renderer.h"
#include "tests/calib/wide_views.h"
#include "tests/gray.h"

namespace etalon {
namespace {

// A grid of 4 x 3 cells of 21 x 17 mm whose middle lies `angle` from the axis, 150 mm away.
PlacedMarker marker_beside(double angle, double azimuth, const Eigen::Vector3d& tilt) {
    PlacedMarker marker;
    marker.grid.cells = (cv::Mat_<float>(3, 4) << 0, 0.8, 0.2, 1, 1, 0, 0.6, 0, 0.3, 1, 0, 0.9);
    marker.grid.cell_mm = {21.0, 17.0};
    marker.grid.corner_mm = {-42.0, -25.5};
    const Eigen::Vector3d sight(std::sin(angle) * std::cos(azimuth),
                                std::sin(angle) * std::sin(azimuth), std::cos(angle));
    marker.camera_from_marker = {
        Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), sight) *
            rotation_from_vector(tilt),
        150.0 * sight};
    return marker;
}

const std::vector<PlacedMarker>& markers() {
    static const std::vector<PlacedMarker> all{marker_beside(0.2, 0.7, {0.5, -0.3, 0.4}),
                                               marker_beside(0.8, -2.1, {-0.4, 0.5, 1.1}),
                                               marker_beside(1.0, 0.3, {0.3, 0.2, -0.6})};
    return all;
}

// The pixel's mean over 200 x 200 rays.
double traced(const Projector& projector, const PlacedMarker& marker, double background,
              const cv::Point& pixel) {
    constexpr int n = 200;
    const Rigid marker_from_camera = marker.camera_from_marker.inverse();
    double sum = 0.0;
    for (int i = 0; i < n * n; ++i) {
        const auto ray =
            projector.ray({pixel.x - 0.5 + (i % n + 0.5) / n, pixel.y - 0.5 + (i / n + 0.5) / n});
        const Eigen::Vector3d along = marker_from_camera.rotation * *ray;
        const Eigen::Vector3d hit = marker_from_camera.translation -
                                    along * (marker_from_camera.translation.z() / along.z());
        const Eigen::Vector2d cell =
            (hit.head<2>() - marker.grid.corner_mm).cwiseQuotient(marker.grid.cell_mm);
        const cv::Point at(static_cast<int>(std::floor(cell.x())),
                           static_cast<int>(std::floor(cell.y())));
        const bool inside = cv::Rect(0, 0, 4, 3).contains(at);
        sum += inside ? marker.grid.cells.at<float>(at) : background;
    }
    return sum / (n * n);
}

// Pixels across the marker: some on edges, some within cells.
std::vector<cv::Point> pixels_of(const Projector& projector, const PlacedMarker& marker) {
    std::vector<cv::Point> pixels;
    for (int i = 0; i <= 8; ++i)
        for (int j = 0; j <= 6; ++j) {
            const Eigen::Vector2d pixel = *projector.project(
                marker.camera_from_marker * marker.grid.point_mm(i / 2.0, j / 2.0));
            pixels.emplace_back(static_cast<int>(std::lround(pixel.x())),
                                static_cast<int>(std::lround(pixel.y())));
        }
    return pixels;
}

// 200 x 200 points err by some 1e-4 of a step at an edge: 0.05 gray.
TEST(WideLens, IsRenderedAsRaysMeetTheMarker) {
    for (const auto& [name, camera] : test::wide_models()) {
        const Projector projector(camera);
        Renderer renderer(camera);
        for (const PlacedMarker& marker : markers()) {
            const RenderedImage image = renderer.render({{marker}, 0.35});
            for (const cv::Point& pixel : pixels_of(projector, marker)) {
                if (!cv::Rect(0, 0, camera.width, camera.height).contains(pixel))
                    continue;
                const double expected = traced(projector, marker, 0.35, pixel);
                EXPECT_NEAR(image.radiance.at<float>(pixel), expected, 0.15 * gray)
                    << name << " " << pixel;
            }
        }
    }
}

TEST(WideLens, AgreesWithTheReference) {
    for (const auto& [name, camera] : test::wide_models()) {
        const Projector projector(camera);
        const Scene scene{{markers()[1]}, 0.35};
        const RenderedImage image = Renderer(camera).render(scene);
        std::vector<cv::Point> pixels = pixels_of(projector, markers()[1]);
        std::erase_if(pixels, [&](const cv::Point& pixel) {
            return !cv::Rect(0, 0, camera.width, camera.height).contains(pixel);
        });
        const auto truth = integrate_reference(camera, scene, pixels);
        ASSERT_GT(pixels.size(), 20u);
        for (std::size_t i = 0; i < pixels.size(); ++i)
            EXPECT_NEAR(image.radiance.at<float>(pixels[i]), truth[i].mean,
                        0.1 * gray + 4.0 * truth[i].standard_error)
                << name << " " << pixels[i];
    }
}

// Beyond 80 degrees there is background, and a marker that reaches there is refused.
TEST(WideLens, EndsAt80Degrees) {
    const CameraModel camera = test::wide_truth({Projection::equidistant}, 181.0);
    const Scene far{{marker_beside(1.25, 0.0, {0, 0, 0})}, 0.35};
    EXPECT_THROW(Renderer(camera).render(far), NumericalError);
    EXPECT_THROW(Renderer(camera).render({{marker_beside(1.8, 0.0, {0, 0, 0})}, 0.35}),
                 NumericalError);
    const RenderedImage image = Renderer(camera).render({{markers()[0]}, 0.35});
    EXPECT_EQ(image.radiance.at<float>(240, 639), 0.35f);  // at 97 degrees
    const Projector projector(camera);
    const double edge = 181.0 * 80.0 * std::numbers::pi / 180.0;
    EXPECT_TRUE(projector.unproject({331.0 + edge - 0.1, 243.0}));
    EXPECT_FALSE(projector.unproject({331.0 + edge + 0.1, 243.0}));
}

}  // namespace
}  // namespace etalon
