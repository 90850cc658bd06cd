// Lenses that see more than a plane, sharp and blurred, to the side and behind the camera's plane:
// against the reference integrator, and against rays traced to the marker in space.

#include "tests/calib/synthetic_views.h"
#include "tests/sim/edge_scenes.h"

namespace etalon {
namespace {

// A grid of 4 x 3 cells of 21 x 17 mm whose middle lies `angle` from the axis, 150 mm away.
PlacedMarker marker_beside(double angle, double azimuth, const Eigen::Vector3d& tilt) {
    const Eigen::Vector3d sight(std::sin(angle) * std::cos(azimuth),
                                std::sin(angle) * std::sin(azimuth), std::cos(angle));
    return twelve_cells(
        {21.0, 17.0}, {-42.0, -25.5},
        {rotation_between(Eigen::Vector3d::UnitZ(), sight) * rotation_from_vector(tilt),
         150.0 * sight});
}

// The last two lie across 90 degrees and behind the camera's plane.
const std::vector<PlacedMarker>& markers() {
    static const std::vector<PlacedMarker> all{
        marker_beside(0.2, 0.7, {0.5, -0.3, 0.4}), marker_beside(0.8, -2.1, {-0.4, 0.5, 1.1}),
        marker_beside(1.0, 0.3, {0.3, 0.2, -0.6}), marker_beside(1.55, 3.0, {0.2, -0.4, 0.5}),
        marker_beside(1.8, -0.4, {-0.3, 0.3, 2.1})};
    return all;
}

// The pixel's mean over 200 x 200 rays, one at chance in each part: an edge that crosses 200 of
// them errs by sqrt(200 / 6) / 200^2 of its step, 1.4e-4, four of which are 0.15 gray.
double traced(const Projector& projector, const PlacedMarker& marker, double background,
              const cv::Point& pixel) {
    constexpr int n = 200;
    RandomStream random(7, 3);
    const Rigid marker_from_camera = marker.camera_from_marker.inverse();
    double sum = 0.0;
    for (int i = 0; i < n * n; ++i) {
        const double across = (i % n + random.uniform()) / n;
        const double down = (i / n + random.uniform()) / n;
        const auto ray = projector.ray({pixel.x - 0.5 + across, pixel.y - 0.5 + down});
        if (!ray)
            return std::nan("");
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

// Pixels across the marker that have rays: some on edges, some within cells.
std::vector<cv::Point> pixels_of(const Projector& projector, const PlacedMarker& marker) {
    const cv::Rect image(0, 0, projector.camera().width, projector.camera().height);
    std::vector<cv::Point> pixels;
    for (int i = 0; i <= 5; ++i)
        for (int j = 0; j <= 4; ++j) {
            const auto pixel = projector.project(marker.camera_from_marker *
                                                 marker.grid.point_mm(0.8 * i, 0.75 * j));
            if (!pixel)
                continue;
            const cv::Point nearest(static_cast<int>(std::lround(pixel->x())),
                                    static_cast<int>(std::lround(pixel->y())));
            if (image.contains(nearest) && projector.ray({nearest.x, nearest.y}))
                pixels.push_back(nearest);
        }
    return pixels;
}

// f/0.6 focused at 210 mm: markers 150 mm away are blurred by some px.
CameraModel with_lens(CameraModel camera, double f_number, double focus_mm) {
    camera.sensor = Sensor{.pixel_pitch_um = 30.0};
    camera.lens = Lens{f_number, focus_mm, 550.0, {}};
    return camera;
}

void expect_reference(const std::string& what, const CameraModel& camera, const Scene& scene,
                      const std::vector<cv::Point>& pixels) {
    SCOPED_TRACE(what);
    test::expect_reference(Renderer(camera).render(scene).radiance, camera, scene, pixels,
                           {.samples_per_scramble = 1024});
}

TEST(WideLens, IsRenderedAsRaysMeetTheMarker) {
    int compared = 0;
    for (const auto& [name, camera] : wide_models()) {
        const Projector projector(camera);
        Renderer renderer(camera);
        for (const PlacedMarker& marker : markers()) {
            const RenderedImage image = renderer.render({{marker}, 0.35});
            for (const cv::Point& pixel : pixels_of(projector, marker)) {
                const double expected = traced(projector, marker, 0.35, pixel);
                if (std::isnan(expected))
                    continue;
                ++compared;
                EXPECT_NEAR(image.radiance.at<float>(pixel), expected, 0.25 * gray)
                    << name << " " << pixel;
            }
        }
    }
    EXPECT_GT(compared, 500);
}

// The reference sends its rays from a disc that faces each of them through a point of the focus
// sphere, in space.
TEST(WideLens, IsBlurredAsRaysFromItsPupilMeetTheMarker) {
    for (const WideModel& model : wide_models()) {
        const Projector projector(model.truth);
        for (const auto& [f_number, focus_mm] : {std::pair{0.6, 210.0}, {1.2, 150.0}})
            for (const PlacedMarker& marker : {markers()[2], markers()[4]})
                expect_reference(fmt::format("{} f/{}", model.name, f_number),
                                 with_lens(model.truth, f_number, focus_mm), {{marker}, 0.35},
                                 pixels_of(projector, marker));
    }
}

// A marker of 300 x 240 mm 60 mm from the lens: 130 degrees from corner to corner.
TEST(WideLens, SeesAMarkerThatSpansMoreThan90Degrees) {
    PlacedMarker marker = marker_beside(0.9, 2.2, {0.15, -0.1, 0.3});
    marker.grid.cell_mm = {70.0, 65.0};
    marker.grid.corner_mm = {-140.0, -97.5};
    marker.camera_from_marker.translation *= 0.4;
    const CameraModel camera = with_lens(
        wide_truth({Projection::equidistant}, 150.0, {.k1 = 0.012, .k2 = -0.003}), 1.1, 300.0);
    const Projector projector(camera);
    const std::vector<cv::Point> pixels = pixels_of(projector, marker);
    ASSERT_GT(pixels.size(), 25u);
    expect_reference("large", camera, {{marker}, 0.35}, pixels);
}

// Around the direction from which a lens of 280 degrees sees nothing, a marker behind it is a ring.
TEST(WideLens, SeesAMarkerAllAroundWhereItIsBlind) {
    const CameraModel camera = wide_truth({Projection::double_sphere, -0.2, 0.58}, 110.0);
    const Projector projector(camera);
    PlacedMarker marker = marker_beside(3.05, 0.4, {0.05, -0.1, 0.2});
    marker.grid.cell_mm = {150.0, 170.0};
    marker.grid.corner_mm = {-300.0, -255.0};
    const std::vector<cv::Point> pixels = pixels_of(projector, marker);
    ASSERT_FALSE(projector.project(-Eigen::Vector3d::UnitZ()));
    ASSERT_GT(pixels.size(), 10u);
    expect_reference("ring", camera, {{marker}, 0.35}, pixels);
}

TEST(WideLens, RefusesAMarkerThatReaches80DegreesFromItsOwnMiddle) {
    const CameraModel camera = wide_truth({Projection::equidistant}, 181.0);
    PlacedMarker marker = marker_beside(0.3, 0.0, {0, 0, 0});
    marker.camera_from_marker.translation *= 0.05;
    EXPECT_THROW(Renderer(camera).render({{marker}, 0.35}), NumericalError);
}

// Two markers side by side in the picture, and one behind the other, far from the axis.
TEST(WideLens, TellsMarkersThatHideEachOther) {
    const CameraModel camera = with_lens(wide_truth({Projection::equidistant}, 181.0), 1.2, 200.0);
    const PlacedMarker near = marker_beside(1.7, 0.3, {0, 0, 0});
    PlacedMarker behind = near;
    behind.camera_from_marker.translation *= 1.5;
    EXPECT_THROW(check_no_occlusion({{near, behind}, 0.35}, camera), NumericalError);
    const PlacedMarker beside = marker_beside(1.7, 1.1, {0, 0, 0});
    const PlacedMarker opposite = marker_beside(1.7, 3.4, {0, 0, 0});
    EXPECT_NO_THROW(check_no_occlusion({{near, beside, opposite}, 0.35}, camera));
}

}  // namespace
}  // namespace etalon
