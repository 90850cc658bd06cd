#include "sim/scene/scene.h"

#include "core/statistics/random.h"
#include "sim/render/renderer.h"
#include "sim/scene/marker_view.h"
#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

using testing::ThrowsMessage;

// One pixel per mm at 100 mm.
CameraModel scene_pinhole() {
    return test::camera_with(120, 90, {100.0, 100.0, 59.5, 44.5}, {});
}

// The same with an aperture of 5 mm (f = 9.09 mm), focused at 100 mm.
CameraModel scene_lens() {
    return test::camera_with(120, 90, {100.0, 100.0, 59.5, 44.5}, {},
                             Sensor{.pixel_pitch_um = 100.0},
                             Lens{2.0 * 100.0 / 110.0, 100.0, 550.0, {}});
}

CellGrid grid(int columns, int rows, double cell_mm, double radiance = 0.0) {
    return {cv::Mat(rows, columns, CV_32FC1, cv::Scalar(radiance)),
            {-columns * cell_mm / 2.0, -rows * cell_mm / 2.0},
            {cell_mm, cell_mm}};
}

Rigid at(double x, double y, double z, const Eigen::Vector3d& turn = Eigen::Vector3d::Zero()) {
    return {rotation_from_vector(turn), {x, y, z}};
}

const std::string no_error = "no error";

std::string complaint(const Scene& scene, const CameraModel& camera) {
    return text_of_error<NumericalError>([&] { check_no_occlusion(scene, camera); });
}

TEST(SceneOcclusion, RefusesMarkersThatOverlapAtDifferentDepthsByNumber) {
    // 20 mm at 100 mm and 40 mm at 200 mm are 20 px each, here 19 px apart.
    const PlacedMarker near{grid(4, 4, 5.0), at(0, 0, 100)}, far{grid(4, 4, 10.0), at(38, 3, 200)};
    const PlacedMarker away{grid(2, 2, 5.0), at(-40, -20, 100)};
    EXPECT_THAT(complaint({{away, near, far}}, scene_pinhole()),
                HasSubstr("markers 2 and 3 overlap"));
}

TEST(SceneOcclusion, RefusesWhereTheLensSeesBehindAnEdge) {
    // 21 px between the centres leave 1 px. A lens of 2.5 mm radius sees 100 px/mm * 2.5 mm *
    // (1/100 - 1/200) = 1.25 px behind the edge of the nearer one.
    const Scene scene{{{grid(4, 4, 5.0), at(0, 0, 100)}, {grid(4, 4, 10.0), at(42, 3, 200)}}};
    EXPECT_EQ(complaint(scene, scene_pinhole()), no_error);
    EXPECT_NE(complaint(scene, scene_lens()), no_error);
    const Scene wider{{scene.markers[0], {grid(4, 4, 10.0), at(42.6, 3, 200)}}};
    EXPECT_EQ(complaint(wider, scene_lens()), no_error);
}

TEST(SceneOcclusion, DoesNotMindBlurThatMarkersShare) {
    // 0.1 px apart and both blurred by 1.25 px, but at nearly the same depth.
    const Scene scene{{{grid(4, 4, 10.0), at(0, 0, 200)}, {grid(4, 4, 10.0), at(40.4, 3, 201)}}};
    ASSERT_NEAR(blur_radius_px(scene_lens(), 200.0), 1.25, 1e-9);
    EXPECT_EQ(complaint(scene, scene_lens()), no_error);
}

TEST(SceneOcclusion, FindsTheSlantedLineBetweenTwoDiamonds) {
    // Squares of 20 px turned by 45 degrees: their bounding boxes overlap, they do not.
    const Eigen::Vector3d turn(0, 0, std::numbers::pi / 4.0);
    const PlacedMarker one{grid(4, 4, 5.0), at(0, 0, 100, turn)};
    const auto other = [&](double shift) {
        return PlacedMarker{grid(4, 4, 10.0), at(2 * shift, 2 * shift, 200, turn)};
    };
    EXPECT_EQ(complaint({{one, other(14.2)}}, scene_pinhole()), no_error);
    EXPECT_NE(complaint({{one, other(14.1)}}, scene_pinhole()), no_error);
}

TEST(SceneOcclusion, AcceptsPiecesOfOnePlaneThatTouchAndRefusesThoseThatOverlap) {
    const Rigid board = at(3, -5, 150, {0.5, -0.3, 0.2});
    const auto piece = [&](double x, double y) {
        return PlacedMarker{grid(4, 3, 5.0), board * at(x, y, 0)};
    };
    EXPECT_EQ(complaint({{piece(0, 0), piece(20, 0), piece(0, 15), piece(20, 15)}}, scene_lens()),
              no_error);
    EXPECT_NE(complaint({{piece(0, 0), piece(19.99, 0)}}, scene_lens()), no_error);
    PlacedMarker lifted = piece(20, 0);
    lifted.camera_from_marker = board * at(20, 0, 0.01);
    EXPECT_NE(complaint({{piece(0, 0), lifted}}, scene_lens()), no_error);
}

TEST(SceneOcclusion, FollowsTheConeOfATelecentricLens) {
    CameraModel camera = scene_lens();
    camera.projection.kind = Projection::telecentric;
    camera.intrinsics.fx = camera.intrinsics.fy = 2.0;
    camera.lens->object_na = 0.06;  // tangent 0.0601: 0.601 mm from 10 mm away
    const auto beside = [](double x) {
        return Scene{{{grid(4, 4, 2.5), at(0, 0, 100)}, {grid(4, 4, 2.5), at(x, 1, 110)}}};
    };
    EXPECT_EQ(complaint(beside(10.61), camera), no_error);
    EXPECT_NE(complaint(beside(10.59), camera), no_error);
}

TEST(SceneOcclusion, RefusesAMarkerBehindTheLensByNumber) {
    EXPECT_THAT(complaint({{{grid(4, 4, 5.0), at(0, 0, 100)}, {grid(4, 4, 5.0), at(0, 0, -9)}}},
                          scene_pinhole()),
                HasSubstr("marker 2 reaches behind the lens"));
}

// Whether some ray through the lens, aimed at the first marker, meets both. Independent of the test
// under trial: points on the first marker and on the lens, the ray between them followed on.
bool some_ray_meets_both(const Scene& scene, const Aperture& aperture, RandomStream& random) {
    const auto& [a, b] = std::pair(scene.markers[0], scene.markers[1]);
    const Rigid b_from_camera = b.camera_from_marker.inverse();
    for (int i = 0; i < 3000; ++i) {
        const double column = random.uniform() * a.grid.columns();
        const double row = random.uniform() * a.grid.rows();
        const Eigen::Vector3d p = a.camera_from_marker * a.grid.point_mm(column, row);
        const double radius = aperture.radius_mm * std::sqrt(random.uniform());
        const double angle = 2.0 * std::numbers::pi * random.uniform();
        const Eigen::Vector3d l(radius * std::cos(angle), radius * std::sin(angle), 0.0);
        const Eigen::Vector3d from = b_from_camera * l, along = b_from_camera * p - from;
        const Eigen::Vector3d hit = from - from.z() / along.z() * along;
        const Eigen::Vector2d cell =
            (hit.head<2>() - b.grid.corner_mm).cwiseQuotient(b.grid.cell_mm);
        if (cell.minCoeff() >= 0.0 && cell.x() < b.grid.columns() && cell.y() < b.grid.rows())
            return true;
    }
    return false;
}

// Accepted are only scenes without such a ray, and few are refused without one.
TEST(SceneOcclusion, AgreesWithRaysThroughTheLensOfATiltedSensor) {
    CameraModel camera = scene_lens();
    camera.distortion.tau_x = 0.15;
    camera.distortion.tau_y = -0.1;
    const Aperture aperture = aperture_of(camera);
    RandomStream random(7, 5);
    const auto between = [&](double low, double high) {
        return low + (high - low) * random.uniform();
    };
    int accepted = 0, refused = 0, refused_in_vain = 0;
    for (int i = 0; i < 200; ++i) {
        Scene scene;
        for (int m = 0; m < 2; ++m)
            scene.markers.push_back({grid(3, 2, between(2.0, 8.0)),
                                     at(between(-20, 20), between(-20, 20), between(60, 200),
                                        {between(-0.8, 0.8), between(-0.8, 0.8), between(-3, 3)})});
        const bool meets_both = some_ray_meets_both(scene, aperture, random);
        if (complaint(scene, camera) == no_error) {
            ++accepted;
            EXPECT_FALSE(meets_both) << "scene " << i;
        } else {
            ++refused;
            refused_in_vain += !meets_both;
        }
    }
    EXPECT_GT(accepted, 50);
    EXPECT_GT(refused, 50);
    EXPECT_LT(refused_in_vain, refused / 5);
}

// Cells of every radiance, asymmetric.
CellGrid pattern() {
    CellGrid cells = grid(7, 5, 4.0);
    for (int j = 0; j < 5; ++j)
        for (int i = 0; i < 7; ++i)
            cells.cells.at<float>(j, i) = static_cast<float>((3 * i + 5 * j) % 11) / 10.0f;
    return cells;
}

double largest_gray(const cv::Mat& a, const cv::Mat& b) {
    return cv::norm(a, b, cv::NORM_INF) * 255.0;
}

TEST(SceneRender, OneMarkerIsTheSumOfItsFourPieces) {
    const Renderer renderer(scene_lens());
    const Rigid pose = at(4, -3, 130, {0.3, 0.2, -0.4});
    const CellGrid whole = pattern();
    Scene pieces{{}, 0.7};
    for (const cv::Rect& part : {cv::Rect(0, 0, 3, 2), {3, 0, 4, 2}, {0, 2, 3, 3}, {3, 2, 4, 3}}) {
        CellGrid piece = whole;
        piece.cells = whole.cells(part).clone();
        piece.corner_mm = whole.point_mm(part.x, part.y).head<2>();
        pieces.markers.push_back({piece, pose});
    }
    const RenderOptions options{.tolerance_gray = 0.02};
    EXPECT_LE(largest_gray(renderer.render({{{whole, pose}}, 0.7}, options).radiance,
                           renderer.render(pieces, options).radiance),
              0.02);
}

TEST(SceneRender, AUniformImageIsTheUniformBackground) {
    const Renderer renderer(scene_lens());
    Scene scene{{{pattern(), at(4, -3, 130, {0.3, 0.2, -0.4})}}, 0.7};
    const RenderOptions options{.tolerance_gray = 0.05,
                                .samples_per_side = 5};  // so that all renders err alike
    const cv::Mat background(90, 120, CV_32FC1, cv::Scalar(0.7));
    const cv::Mat over = render_over(renderer, scene, background, options).radiance;
    EXPECT_LE(largest_gray(over, renderer.render(scene, options).radiance), 0.01);
}

TEST(SceneRender, StripesStayAsTheyAreBesideTheMarkerAndVanishBehindIt) {
    cv::Mat stripes(90, 120, CV_32FC1);
    for (int x = 0; x < 120; ++x)
        stripes.col(x).setTo(x % 5 < 2 ? 0.9 : 0.15);
    const Renderer renderer(scene_pinhole());
    const Scene scene{{{pattern(), at(4, -3, 100)}}};
    const RenderedImage over = render_over(renderer, scene, stripes);
    // 28 x 20 px around (63.5, 41.5): columns 50..77 and rows 32..51 but for the border.
    cv::Mat marker(90, 120, CV_8UC1, cv::Scalar(0));
    marker(cv::Rect(49, 31, 30, 22)).setTo(1);
    const cv::Mat difference = over.radiance - stripes;
    EXPECT_LE(cv::norm(difference, cv::NORM_INF, marker == 0), 1e-6);
    const cv::Rect inside(50, 32, 28, 20);
    EXPECT_LE(largest_gray(over.radiance(inside), renderer.render(scene).radiance(inside)), 0.1);
}

TEST(SceneRender, RefusesABackgroundOfAnotherSizeOrThatIsNotFinite) {
    const Renderer renderer(scene_pinhole());
    const Scene scene{{{pattern(), at(4, -3, 100)}}};
    EXPECT_THAT([&] { render_over(renderer, scene, cv::Mat::zeros(120, 90, CV_32FC1)); },
                ThrowsMessage<NumericalError>(HasSubstr("90 x 120")));
    EXPECT_THROW(render_over(renderer, scene, cv::Mat::zeros(90, 120, CV_8UC1)), NumericalError);
    cv::Mat holed = cv::Mat::zeros(90, 120, CV_32FC1);
    holed.at<float>(7, 5) = std::nanf("");
    EXPECT_THROW(render_over(renderer, scene, holed), NumericalError);
}

TEST(SceneRender, ACodeImageIsExposedToItselfAgain) {
    CameraModel camera = scene_lens();
    camera.sensor->bits = 10;
    camera.sensor->black_dn = 17;
    camera.sensor->transfer.kind = Transfer::Kind::rec709;
    camera.sensor->illumination.kind = Illumination::Kind::cos4;
    const SensorModel sensor(camera);
    cv::Mat codes(90, 120, CV_16UC1);
    for (int y = 0; y < 90; ++y)
        for (int x = 0; x < 120; ++x)
            codes.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>((x * 7 + y * 5) % 1023);
    const Radiance radiance = background_from({codes, 10}, sensor);
    EXPECT_LE(cv::norm(sensor.expose(radiance).pixels, codes, cv::NORM_INF), 1.0);
}

}  // namespace
}  // namespace etalon
