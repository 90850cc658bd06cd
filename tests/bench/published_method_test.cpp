#include "bench/published_method.h"

#include <opencv2/calib3d.hpp>

#include "sim/psf/diffraction.h"
#include "sim/render/reference_integrator.h"
#include "sim/scene/pose_sampling.h"
#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Undistortion = PublishedMethod::Undistortion;

// Wide and strongly distorted, so that a fixed-point step more or less shows; blurred by some 2 px;
// infrared, so that the Airy pattern is as wide as a pixel.
CameraModel small_camera() {
    return camera_with(
        61, 47, {60.0, 68.0, 29.0, 25.5},
        // k1, k2, p1, p2, k3 to k6, s1 to s4
        {-0.35, 0.09, 0.003, -0.002, 0.1, 0.01, 0.02, 0.03, 0.002, 0.004, 0.006, -0.01},
        Sensor{.pixel_pitch_um = 40.0}, Lens{0.5, 60.0, 20000.0, {}});
}

PlacedMarker marker(const Eigen::Vector3d& rotation, const Eigen::Vector3d& translation) {
    return {{(cv::Mat_<float>(2, 3) << 0.1f, 0.9f, 0.3f, 0.7f, 0.0f, 0.6f),
             {-42.0, -33.0},
             {27.0, 33.0}},
            {Eigen::Quaterniond(Eigen::AngleAxisd(rotation.norm(), rotation.normalized())),
             translation}};
}

// The first hides a part of the second.
Scene two_markers() {
    Scene scene;
    scene.markers = {marker({-0.2, 0.3, -0.5}, {-32.0, 18.0, 150.0}),
                     marker({0.4, -0.3, 0.2}, {23.0, -12.0, 180.0})};
    scene.background = 0.8;
    return scene;
}

// The method once more, word by word: no vectors, doubles, rays as points and directions.
class Plain {
public:
    Plain(const CameraModel& camera, const Scene& scene, int rays)
        : camera_(camera), scene_(scene), rays_(rays), lens_(thin_lens(camera)) {}

    // A pixel of the finished image.
    double pixel(int x, int y) const {
        const PointSpreadFunction spread = PointSpreadFunction::of(camera_);
        double sum = 0.0, energy = 0.0;
        for (int j = -5; j <= 5; ++j)
            for (int i = -5; i <= 5; ++i) {
                const double weight = weight_of(spread, i, j);
                energy += weight;
                if (weight > 0.0)
                    sum += weight * refined(x + i, y + j);
            }
        return sum / energy;
    }

    double centre_ray(int x, int y) const { return trace(undistorted(x, y), {0.0, 0.0}); }

    bool is_near_edge(int x, int y) const {
        constexpr int far = 14;  // px: more than any 1 + R here
        for (int j = -far; j <= far; ++j)
            for (int i = -far; i <= far; ++i)
                if (is_edge(x + i, y + j) && std::hypot(i, j) <= growth(x + i, y + j))
                    return true;
        return false;
    }

    double refined(int x, int y) const {
        if (!is_near_edge(x, y))
            return centre_ray(x, y);
        const SobolPoints points(rays_);
        double sum = 0.0;
        for (int n = 0; n < rays_; ++n) {
            const auto u = points.point(n, make_scramble(0, 0, 0, 0));
            sum += trace(undistorted(x + u[0] - 0.5, y + u[1] - 0.5), lens_point(u[2], u[3]));
        }
        return sum / rays_;
    }

private:
    Eigen::Vector2d undistorted(double px, double py) const {
        const Intrinsics& in = camera_.intrinsics;
        const Distortion& d = camera_.distortion;
        const Eigen::Vector2d start((px - in.cx) / in.fx, (py - in.cy) / in.fy);
        Eigen::Vector2d p = start;
        for (int n = 0; n < 5; ++n) {
            const double x = p.x(), y = p.y(), r2 = x * x + y * y, r4 = r2 * r2, r6 = r4 * r2;
            const double factor =
                (1 + d.k4 * r2 + d.k5 * r4 + d.k6 * r6) / (1 + d.k1 * r2 + d.k2 * r4 + d.k3 * r6);
            const Eigen::Vector2d shift(
                2 * d.p1 * x * y + d.p2 * (r2 + 2 * x * x) + d.s1 * r2 + d.s2 * r4,
                d.p1 * (r2 + 2 * y * y) + 2 * d.p2 * x * y + d.s3 * r2 + d.s4 * r4);
            p = (start - shift) * factor;
        }
        return p;
    }

    // Concentric map by its definition: squares of side 2r become circles of radius r.
    Eigen::Vector2d lens_point(double u, double v) const {
        const double a = 2 * u - 1, b = 2 * v - 1, r = std::max(std::abs(a), std::abs(b));
        const double along = std::abs(a) > std::abs(b) ? b / a : a / b;
        const double quarter = std::numbers::pi / 4 * along;
        Eigen::Vector2d p(std::cos(quarter), std::sin(quarter));
        if (std::abs(a) <= std::abs(b))
            std::swap(p.x(), p.y());
        const bool negative = (std::abs(a) > std::abs(b) ? a : b) < 0.0;
        return (negative ? -r : r) * lens_.aperture_diameter_mm / 2.0 * p;
    }

    // From the lens point through the point of the plane of focus that the sensor point sees.
    double trace(const Eigen::Vector2d& x, const Eigen::Vector2d& l) const {
        const Eigen::Vector3d from(l.x(), l.y(), 0.0);
        const Eigen::Vector3d focus = x.homogeneous() / lens_.inverse_focus_per_mm;
        double nearest = std::numeric_limits<double>::infinity(), seen = scene_.background;
        for (const PlacedMarker& m : scene_.markers) {
            const Rigid to_marker = m.camera_from_marker.inverse();
            const Eigen::Vector3d a = to_marker * from, b = to_marker * focus;
            const Eigen::Vector3d p = a + (b - a) * (a.z() / (a.z() - b.z()));
            const double depth = (m.camera_from_marker * p).z();
            const double u = (p.x() - m.grid.corner_mm.x()) / m.grid.cell_mm.x();
            const double v = (p.y() - m.grid.corner_mm.y()) / m.grid.cell_mm.y();
            if (depth > 0.0 && depth < nearest && u >= 0 && v >= 0 && u < 3 && v < 2) {
                nearest = depth;
                seen = m.grid.cells.at<float>(static_cast<int>(v), static_cast<int>(u));
            }
        }
        return seen;
    }

    bool is_edge(int x, int y) const {
        const double here = centre_ray(x, y);
        return here != centre_ray(x - 1, y) || here != centre_ray(x + 1, y) ||
               here != centre_ray(x, y - 1) || here != centre_ray(x, y + 1);
    }

    // 1 + ceil(R), R where the centre ray meets the markers' planes.
    double growth(int x, int y) const {
        const Eigen::Vector3d direction = undistorted(x, y).homogeneous();
        double blur = 0.0;
        for (const PlacedMarker& m : scene_.markers) {
            const Eigen::Vector3d normal = m.camera_from_marker.rotation * Eigen::Vector3d::UnitZ();
            const double z = normal.dot(m.camera_from_marker.translation) / normal.dot(direction);
            blur = std::max(blur, camera_.intrinsics.fx * lens_.aperture_diameter_mm / 2.0 *
                                      std::abs(1.0 / z - lens_.inverse_focus_per_mm));
        }
        return 1.0 + std::ceil(blur);
    }

    double weight_of(const PointSpreadFunction& spread, int dx, int dy) const {
        constexpr int steps = 50;
        const double height = camera_.intrinsics.fx / camera_.intrinsics.fy;
        double sum = 0.0;
        for (int j = 0; j < steps; ++j)
            for (int i = 0; i < steps; ++i) {
                const double r = std::hypot(dx + (i + 0.5) / steps - 0.5,
                                            height * (dy + (j + 0.5) / steps - 0.5));
                sum += r < 5.0 ? spread.density(r) : 0.0;
            }
        return sum;
    }

    const CameraModel& camera_;
    const Scene& scene_;
    int rays_;
    ThinLens lens_;
};

// OpenCV stops after five steps too, far from converged in this image's corners.
TEST(PublishedMethod, UndistortsAsOpenCvDoes) {
    const CameraModel camera = small_camera();
    const Intrinsics& in = camera.intrinsics;
    const PublishedMethod method(camera, 64, Undistortion::per_ray);
    const auto k = camera.distortion.in_opencv_order();
    const std::vector<double> coefficients(k.begin(), k.begin() + 12);
    const cv::Matx33d matrix(in.fx, 0, in.cx, 0, in.fy, in.cy, 0, 0, 1);
    std::vector<float> columns(61);
    std::iota(columns.begin(), columns.end(), 0.0f);
    for (const float row : {0.0f, 11.5f, 46.0f}) {
        const auto [x, y] = method.undistorted(columns, row);
        std::vector<cv::Point2d> pixels, expected;
        for (int i = 0; i < 61; ++i)
            pixels.emplace_back(i, row);
        cv::undistortPoints(pixels, expected, matrix, coefficients);
        for (std::size_t i = 0; i < 61; ++i) {
            EXPECT_NEAR(x[i], expected[i].x, 2e-6) << i << ", " << row;
            EXPECT_NEAR(y[i], expected[i].y, 2e-6) << i << ", " << row;
        }
    }
}

// Of 64 rays some meet a cell's border within single precision's error and fall to the other side:
// a pixel may then differ by a 64th. None does here; kernel weights agree to 1e-4.
TEST(PublishedMethod, IsWhatItsDefinitionSaysPixelByPixel) {
    const CameraModel camera = small_camera();
    const Scene scene = two_markers();
    const Plain plain(camera, scene, 64);
    const PublishedImage image = PublishedMethod(camera, 64, Undistortion::per_ray).render(scene);
    std::set<double> values;
    for (const auto& [x, y] : {std::pair{12, 30}, {25, 17}, {33, 22}, {0, 0}, {60, 46}, {20, 35}}) {
        EXPECT_NEAR(image.radiance.at<float>(y, x), plain.pixel(x, y), 2e-4) << x << ", " << y;
        values.insert(plain.pixel(x, y));
    }
    EXPECT_GE(values.size(), 5u);  // not all the same background
}

TEST(PublishedMethod, RefinesExactlyThePixelsNearEdges) {
    CameraModel camera = small_camera();
    camera.width = 23;
    camera.height = 19;
    camera.intrinsics.cx = 16.0;
    camera.intrinsics.cy = 4.0;
    Scene scene = two_markers();
    scene.markers.resize(1);
    const Plain plain(camera, scene, 64);
    int expected = 0;
    for (int y = -5; y < camera.height + 5; ++y)
        for (int x = -5; x < camera.width + 5; ++x)
            expected += plain.is_near_edge(x, y) ? 1 : 0;
    const auto image = PublishedMethod(camera, 64, Undistortion::per_ray).render(scene);
    EXPECT_GT(expected, 100);
    EXPECT_LT(expected, 33 * 29);
    // Edges further outside are not looked for.
    EXPECT_NEAR(image.edge_pixels, expected, 12);
}

TEST(PublishedMethod, ComesNearTheReferenceWhereItsShortcutsDoNoHarm) {
    // Blurred by 8 px, so that sampling the diffraction once per pixel, cutting its tail (0.9 % of
    // the energy) and counting the pixel twice matter little; weak distortion.
    CameraModel camera = small_camera();
    camera.distortion = {.k1 = -0.05};
    camera.lens->f_number = 0.1;
    Scene scene = two_markers();
    scene.markers.resize(1);
    const auto image = PublishedMethod(camera, 16384, Undistortion::per_ray).render(scene);
    const std::vector<cv::Point> pixels{{29, 23}, {20, 20}, {35, 30}, {41, 22}};
    const auto truth = integrate_reference(camera, scene, pixels);
    for (std::size_t i = 0; i < pixels.size(); ++i)
        EXPECT_NEAR(image.radiance.at<float>(pixels[i]), truth[i].mean, 2.0 / 255.0) << pixels[i];
}

TEST(PublishedMethod, VariantsDifferLittleAndByDistortionAlone) {
    const Scene scene = two_markers();
    for (const bool is_distorted : {false, true}) {
        CameraModel camera = small_camera();
        if (!is_distorted)
            camera.distortion = {};
        const auto a = PublishedMethod(camera, 256, Undistortion::per_ray).render(scene);
        const auto b = PublishedMethod(camera, 256, Undistortion::linearised).render(scene);
        const double largest = cv::norm(a.radiance, b.radiance, cv::NORM_INF);
        EXPECT_LT(cv::norm(a.radiance, b.radiance, cv::NORM_L2) / std::sqrt(a.radiance.total()),
                  is_distorted ? 2e-3 : 2e-4);
        if (is_distorted) {
            EXPECT_GT(largest, 0.0);
        } else {
            EXPECT_EQ(a.edge_pixels, b.edge_pixels);
            EXPECT_LT(largest, 4.0 / 256.0);  // rounding moves single rays over a border
        }
    }
}

TEST(PublishedMethod, ShowsTheBackgroundBehindAMarkersBack) {
    const CameraModel camera = small_camera();
    Scene scene = two_markers();
    scene.markers = {marker({3.0, 0.0, 0.0}, {0.0, 0.0, 180.0})};
    const auto image = PublishedMethod(camera, 64, Undistortion::per_ray).render(scene);
    EXPECT_EQ(image.edge_pixels, 0);
    EXPECT_NEAR(image.radiance.at<float>(23, 29), 0.8f, 1e-6f);
}

TEST(PublishedMethod, RefusesWhatItCannotDo) {
    CameraModel camera = small_camera();
    for (const int rays : {100, 32})
        EXPECT_THROW(PublishedMethod(camera, rays, Undistortion::per_ray), NumericalError);
    camera.distortion.tau_x = 0.01;
    EXPECT_THROW(PublishedMethod(camera, 64, Undistortion::per_ray), NumericalError);
    camera.distortion.tau_x = 0.0;
    camera.projection.kind = Projection::telecentric;
    EXPECT_THROW(PublishedMethod(camera, 64, Undistortion::per_ray), NumericalError);
    Scene scene = two_markers();
    scene.background = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(PublishedMethod(small_camera(), 64, Undistortion::per_ray).render(scene),
                 NumericalError);
}

}  // namespace
}  // namespace etalon
