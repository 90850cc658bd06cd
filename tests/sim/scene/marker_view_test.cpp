#include "sim/scene/marker_view.h"

#include <random>

#include "bench/benchmark_scenes.h"
#include "core/geometry/units.h"
#include "sim/tiles/lens_average.h"
#include "tests/sim/edge_scenes.h"

namespace etalon {
namespace {

constexpr double background = 0.4;

// 5 x 3 cells, all different.
PlacedMarker small_marker(const Eigen::Vector2d& cell_mm, const Eigen::Vector2d& corner_mm,
                          const Rigid& camera_from_marker) {
    cv::Mat_<float> cells(3, 5);
    for (int j = 0; j < 3; ++j)
        for (int i = 0; i < 5; ++i)
            cells(j, i) = static_cast<float>((7 * (5 * j + i) % 15) / 15.0 + 0.01);
    return {{cells, corner_mm, cell_mm}, camera_from_marker};
}

// What the ray from `from` along `along` meets going forward, in the marker's own frame; nothing
// where it passes within 1e-6 cells of an edge.
std::optional<double> traced(const PlacedMarker& marker, const Eigen::Vector3d& from,
                             const Eigen::Vector3d& along) {
    const Rigid to_marker = marker.camera_from_marker.inverse();
    const Eigen::Vector3d start = to_marker * from, step = to_marker.rotation * along;
    if (!(start.z() < 0.0 && step.z() > 0.0))
        return background;
    const Eigen::Vector2d met = (start - start.z() / step.z() * step).head<2>();
    const Eigen::Array2d cell = (met - marker.grid.corner_mm).array() / marker.grid.cell_mm.array();
    const bool far = (cell.abs() > 1e6).any();
    if (!far && ((cell - cell.round()).abs() < 1e-6).any())
        return std::nullopt;
    if (far || (cell < 0.0).any() || cell.x() > marker.grid.columns() ||
        cell.y() > marker.grid.rows())
        return background;
    return marker.grid.cells.at<float>(static_cast<int>(cell.y()), static_cast<int>(cell.x()));
}

std::optional<double> traced(const PlacedMarker& marker, const Aperture& aperture,
                             const Eigen::Vector2d& x, const Eigen::Vector2d& l) {
    const double focus = aperture.focus(x);
    if (aperture.projection == Projection::telecentric)
        return traced(marker, (x - focus * l).homogeneous() - Eigen::Vector3d::UnitZ(),
                      l.homogeneous());
    if (aperture.faces_rays) {  // a disc across the ray, its point in space
        const Eigen::Vector3d ray = x.homogeneous().normalized();
        Eigen::Vector3d from;
        from << aperture.pupil(x).inverse() * l, -ray.head<2>().dot(l);
        EXPECT_NEAR(from.dot(ray), 0.0, 1e-12 * l.norm());
        EXPECT_NEAR(from.norm(), l.norm(), 1e-12 * l.norm());
        return traced(marker, from, x.homogeneous() - focus * from);
    }
    return traced(marker, {l.x(), l.y(), 0.0}, (x - focus * l).homogeneous());
}

// Whether the plane does not meet the ray in front of the lens; not asked of a wide one.
bool runs_away(const MarkerView& view, const Eigen::Vector2d& x, const Eigen::Vector2d& l) {
    if (view.aperture().projection == Projection::telecentric || view.aperture().faces_rays)
        return false;
    const double w = view.h().row(2).dot(x.homogeneous());
    return w - view.aperture().focus(x) * view.turn(x).dot(l) <= 0.0;
}

// The cell that the lines of a range make of one ray: the sum of both closed-form methods.
double told_by_lines(const MarkerView& view, const CellRange& range, const Eigen::Vector2d& x,
                     const Eigen::Vector2d& l) {
    const SensorPoint point = view.sensor_point(x);
    const auto beyond = [&](int axis, int index) {
        const LensLine line = view.lens_line(axis, index, point);
        return line.offset + line.slope.dot(l) >= 0.0;
    };
    const auto along_row = [&](int row) {
        double sum = view.cell(range.first_column, row);
        for (int i = range.first_column + 1; i <= range.last_column; ++i)
            if (beyond(0, i))
                sum += view.cell(i, row) - view.cell(i - 1, row);
        return sum;
    };
    double sum = along_row(range.first_row);
    for (int j = range.first_row + 1; j <= range.last_row; ++j)
        if (beyond(1, j))
            sum += along_row(j) - along_row(j - 1);
    return sum;
}

class Dice {
public:
    explicit Dice(unsigned seed) : random_(seed) {}

    double uniform(double low, double high) {
        return std::uniform_real_distribution<double>(low, high)(random_);
    }
    double log_uniform(double low, double high) {
        return std::exp(uniform(std::log(low), std::log(high)));
    }
    Eigen::Vector2d in_box(const Box& box) {
        return {uniform(box.low.x(), box.high.x()), uniform(box.low.y(), box.high.y())};
    }
    Eigen::Vector2d in_disk(double radius) {
        const double r = radius * std::sqrt(uniform(0.0, 1.0));
        const double angle = uniform(0.0, 2.0 * std::numbers::pi);
        return {r * std::cos(angle), r * std::sin(angle)};
    }

    Aperture aperture() {
        Aperture aperture;
        aperture.radius_mm = uniform(0.0, 1.0) < 0.2 ? 0.0 : log_uniform(0.01, 20.0);
        aperture.focus_on_axis = uniform(0.0, 1.0) < 0.1 ? 0.0 : 1.0 / log_uniform(50.0, 3000.0);
        if (uniform(0.0, 1.0) < 0.3)
            aperture.focus_slope = 0.3 * aperture.focus_on_axis * in_disk(1.0);
        return aperture;
    }

    PlacedMarker marker() {
        const Eigen::Vector2d cell_mm{log_uniform(1.0, 200.0), log_uniform(1.0, 200.0)};
        const Eigen::Vector2d corner_mm{uniform(-100.0, 0.0), uniform(-100.0, 0.0)};
        const double tilt = std::min(89.9, 90.0 - log_uniform(0.1, 90.0)) * rad_per_deg;
        const double axis = uniform(0.0, 2.0 * std::numbers::pi);
        const Eigen::Quaterniond rotation(
            Eigen::AngleAxisd(tilt, Eigen::Vector3d(std::cos(axis), std::sin(axis), 0.0)) *
            Eigen::AngleAxisd(uniform(0.0, 6.3), Eigen::Vector3d::UnitZ()));
        const double z = log_uniform(5.0, 3000.0);
        return small_marker(cell_mm, corner_mm,
                            {rotation, {z * uniform(-1.0, 1.0), z * uniform(-1.0, 1.0), z}});
    }

private:
    std::mt19937 random_;
};

// Nothing where a corner is behind the lens, the back is seen, or the plane cuts the aperture.
std::optional<MarkerView> view_of(const PlacedMarker& marker, const Aperture& aperture) {
    try {
        return MarkerView(marker, background, aperture);
    } catch (const NumericalError&) {
        return std::nullopt;
    }
}

struct Counts {
    int views = 0, told = 0, horizons = 0;
};

// Boxes of all sizes, half of them at the marker.
void expect_footprints_hold(const MarkerView& view, const PlacedMarker& marker, Dice& dice,
                            Counts& counts) {
    const double rho = view.aperture().radius_mm;
    for (int n = 0; n < 8; ++n) {
        const Eigen::Vector2d half{dice.log_uniform(1e-6, 0.5), dice.log_uniform(1e-6, 0.5)};
        const Eigen::Vector2d centre =
            n % 2 == 0 ? view.sensor_point_of(dice.uniform(-1.0, 6.0), dice.uniform(-1.0, 4.0))
                       : Eigen::Vector2d{dice.uniform(-1.5, 1.5), dice.uniform(-1.5, 1.5)};
        const Box box{centre - half, centre + half};
        const auto range = view.footprint(box);
        for (int ray = 0; ray < 20; ++ray) {
            const Eigen::Vector2d x = dice.in_box(box), l = dice.in_disk(rho);
            const auto truth = traced(marker, view.aperture(), x, l);
            if (!truth)
                continue;
            const double told = range ? told_by_lines(view, *range, x, l) : background;
            EXPECT_NEAR(told, *truth, 1e-6);
            counts.told += *truth != background;
            counts.horizons += range && runs_away(view, x, l);
        }
    }
    ++counts.views;
}

// `prepare` changes the marker and the aperture of each draw.
template <class Prepare>
Counts counts_of_footprints(unsigned seed, int draws, const Prepare& prepare) {
    Dice dice(seed);
    Counts counts;
    for (int n = 0; n < draws; ++n) {
        PlacedMarker marker = dice.marker();
        Aperture aperture = dice.aperture();
        prepare(marker, aperture, dice);
        if (const auto view = view_of(marker, aperture))
            expect_footprints_hold(*view, marker, dice, counts);
    }
    return counts;
}

TEST(MarkerView, FootprintsTellWhatEveryRayMeets) {
    const Counts counts = counts_of_footprints(21, 6000, [](auto&, auto&, auto&) {});
    EXPECT_GT(counts.views, 1000);
    EXPECT_GT(counts.told, 20000);
    EXPECT_GT(counts.horizons, 2000);
}

TEST(MarkerView, TelecentricFootprintsTellWhatEveryRayMeets) {
    const Counts counts =
        counts_of_footprints(22, 300, [](auto& marker, auto& aperture, Dice& dice) {
            marker.camera_from_marker.translation.z() += 5000.0;
            aperture = {Projection::telecentric, dice.log_uniform(1e-3, 0.1), 5000.0};
        });
    EXPECT_GT(counts.views, 100);
    EXPECT_GT(counts.told, 1000);
    EXPECT_EQ(counts.horizons, 0);
}

TEST(MarkerView, FootprintsOfAWideLensTellWhatEveryRayMeets) {
    const Counts counts = counts_of_footprints(24, 3000, [](auto&, auto& aperture, auto&) {
        aperture.focus_slope = {0.0, 0.0};
        aperture.faces_rays = true;
    });
    EXPECT_GT(counts.views, 400);
    EXPECT_GT(counts.told, 8000);
}

// Seen from 2 mm above: cells from 30 mm to 6 m away, up to their horizon.
PlacedMarker long_floor() {
    const Eigen::Quaterniond rotation(
        Eigen::AngleAxisd(-90.0 * rad_per_deg, Eigen::Vector3d::UnitX()) *
        Eigen::AngleAxisd(0.3 * rad_per_deg, Eigen::Vector3d::UnitY()));
    return small_marker({10.0, 2000.0}, {-23.0, -6000.0}, {rotation, {1.0, 2.0, 30.0}});
}

// Through the lens' rim such a plane is seen from its own height: nothing bounds where the rays of
// a sensor point meet it, but the marker's points still have small images.
TEST(MarkerView, AMarkerWhosePlaneAlmostCutsTheLensIsSeenCloseToItsImageOnly) {
    PlacedMarker floor = long_floor();
    floor.grid.corner_mm.y() = -1000.0;
    floor.grid.cell_mm.y() = 20.0;
    const Aperture aperture{.radius_mm = 1.9999, .focus_on_axis = 1.0 / 1000.0};
    const MarkerView view(floor, background, aperture);
    const Eigen::Vector2d image = view.sensor_point_of(2.0, 1.0);
    const auto around = [](const Eigen::Vector2d& x) {
        const Eigen::Vector2d half(1e-4, 2e-4);
        return Box{x - half, x + half};
    };
    EXPECT_TRUE(view.footprint(around(image)));
    EXPECT_FALSE(view.footprint(around(image + Eigen::Vector2d(0.0, 0.01))));
    EXPECT_FALSE(view.footprint(around(image - Eigen::Vector2d(0.0, 0.01))));
}

// An edge that runs at 45 degrees passes through the corners of the square around a blur disk
// before it reaches the disk.
TEST(MarkerView, AFootprintKnowsThatTheLensIsRound) {
    PlacedMarker marker = half_plane(0.0, 500.0).markers[0];
    marker.camera_from_marker.rotation =
        Eigen::AngleAxisd(45.0 * rad_per_deg, Eigen::Vector3d::UnitZ());
    const Aperture aperture{.radius_mm = 5.0, .focus_on_axis = 1.0 / 1000.0};
    const MarkerView view(marker, background, aperture);
    const double blur = aperture.radius_mm * (1.0 / 500.0 - 1.0 / 1000.0);
    const Eigen::Vector2d across(std::cos(45.0 * rad_per_deg), std::sin(45.0 * rad_per_deg));
    const Eigen::Vector2d half(1e-5, 2e-5);
    for (const double side : {-1.0, 1.0})
        for (const double distance : {0.98, 1.02, 1.4}) {
            const Eigen::Vector2d x = side * distance * blur * across;
            const auto range = view.footprint({x - half, x + half});
            ASSERT_TRUE(range);
            EXPECT_EQ(range->first_column != range->last_column, distance < 1.0) << distance;
            EXPECT_EQ(range->last_column, side > 0.0 || distance < 1.0 ? 1 : 0);
        }
}

// The average over side x side rays through the aperture, and whether the horizon crosses it.
struct RayAverage {
    double radiance;
    bool crossed;
};

RayAverage average_of_rays(const PlacedMarker& marker, const MarkerView& view,
                           const Eigen::Vector2d& x, int side) {
    double sum = 0.0;
    int rays = 0, away = 0;
    for (int p = 0; p < side * side; ++p) {
        const Eigen::Vector2d l = Eigen::Vector2d(p % side + 0.5, p / side + 0.5) * (2.0 / side) -
                                  Eigen::Vector2d::Ones();
        if (l.norm() > 1.0)
            continue;
        const Eigen::Vector2d at = view.aperture().radius_mm * l;
        sum += traced(marker, view.aperture(), x, at).value_or(background);
        away += runs_away(view, x, at);
        ++rays;
    }
    return {sum / rays, away > 0 && away < rays};
}

TEST(MarkerView, ApertureAveragesHoldAcrossTheHorizon) {
    const Aperture aperture{.radius_mm = 0.9, .focus_on_axis = 1.0 / 150.0};
    const PlacedMarker floor = long_floor();
    const MarkerView view(floor, background, aperture);
    LensAverage lens_average(view);
    int crossed = 0;
    for (int n = 0; n < 40; ++n) {
        const Eigen::Vector2d x(-0.023 + 0.0051 * (n % 10), -0.0021 + 0.0019 * (n / 10));
        const RayAverage truth = average_of_rays(floor, view, x, 200);
        crossed += truth.crossed;
        const auto range = view.footprint({x, x});
        EXPECT_NEAR(range ? lens_average.at(x, *range) : background, truth.radiance, 1e-3)
            << x.transpose();
    }
    EXPECT_GE(crossed, 15);
}

// Wide apertures close to the plane: lines of both directions and the horizon cross them in any
// order. 60 x 60 rays are good to the rows and columns of rays that the lines pass between.
TEST(MarkerView, ApertureAveragesHoldHoweverTheLinesAreOrdered) {
    Dice dice(23);
    int crossed = 0;
    for (int n = 0; n < 40000; ++n) {
        const PlacedMarker marker = dice.marker();
        Aperture aperture = dice.aperture();
        aperture.radius_mm = dice.uniform(5.0, 50.0);
        const auto view = view_of(marker, aperture);
        if (!view)
            continue;
        const Eigen::Vector2d x = dice.in_box({{-1.5, -1.5}, {1.5, 1.5}});
        const auto range = view->footprint({x, x});
        if (!range)
            continue;
        const RayAverage truth = average_of_rays(marker, *view, x, 60);
        if (truth.crossed) {
            EXPECT_NEAR(LensAverage(*view).at(x, *range), truth.radiance, 0.03) << n;
        }
        crossed += truth.crossed;
    }
    EXPECT_GT(crossed, 100);
}

// Maximum 0.1 gray and 4 standard errors, at every step-th pixel.
void expect_reference(const Renderer& renderer, const Scene& scene, int step) {
    const CameraModel& camera = renderer.camera();
    std::vector<cv::Point> pixels;
    for (int y = step / 2; y < camera.height; y += step)
        for (int x = step / 2; x < camera.width; x += step)
            pixels.push_back({x, y});
    const auto reference = test::expect_reference(renderer.render(scene).radiance, camera, scene,
                                                  pixels, {.samples_per_scramble = 128});
    EXPECT_GT(std::ranges::count_if(reference,
                                    [&](const ReferencePixel& pixel) {
                                        return std::abs(pixel.mean - scene.background) > gray;
                                    }),
              5);
}

TEST(MarkerView, AFloorUpToItsHorizonIsRendered) {
    expect_reference(Renderer(small_camera({})), {{long_floor()}, background}, 9);
}

TEST(MarkerView, SteepMarkersAreRenderedBesideTheirHorizon) {
    const Renderer renderer(small_camera({}));
    for (const double tilt : {80.0, 85.0, 89.0}) {
        const Eigen::Quaterniond rotation(
            Eigen::AngleAxisd(tilt * rad_per_deg, Eigen::Vector3d(0.96, 0.28, 0.0)) *
            Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitZ()));
        const PlacedMarker marker =
            small_marker({11.0, 17.0}, {-20.0, -30.0}, {rotation, {20.0, -6.0, 180.0}});
        expect_reference(renderer, {{marker}, background}, 9);
    }
}

// A pose of the benchmark's cloud whose plane has its horizon in the image.
TEST(MarkerView, AWebcamSeesAMarkerBesideItsHorizon) {
    BenchmarkScene scene = benchmark_scene("webcam-500");
    scene.scene.markers[0].camera_from_marker = {
        Eigen::Quaterniond(0.6561, 0.3968, 0.3840, 0.5144).normalized(), {-246.7, -74.4, 569.0}};
    const Renderer renderer(scene.camera);
    EXPECT_NO_THROW(renderer.render(scene.scene));
}

CameraModel camera_that_distorts(const Distortion& distortion) {
    return test::camera_with(640, 480, {500.0, 500.0, 319.5, 239.5}, distortion);
}

// 12 x 1 cells of 20 mm, the origin in the middle.
CellGrid wide_grid() {
    return {cv::Mat_<float>(1, 12, 0.5f), {-120.0, -10.0}, {20.0, 20.0}};
}

Rigid turned(double angle, const Eigen::Vector3d& axis, const Eigen::Vector3d& position) {
    return {Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis)), position};
}

// At 500 mm a mm is a pixel: columns 200 - 120 and 200 + 120 at x = -119.5 mm, the row 239.5 - 10.
TEST(MarkerInView, KeepsTheMarginToEachBorder) {
    const Projector projector(camera_that_distorts({}));
    const CellGrid grid = wide_grid();
    const auto is_seen = [&](double x, double y, double margin) {
        return is_in_view(projector, grid, {Eigen::Quaterniond::Identity(), {x, y, 500.0}}, margin);
    };
    EXPECT_TRUE(is_seen(-119.5, 0.0, 79.9));
    EXPECT_FALSE(is_seen(-119.5, 0.0, 80.1));
    EXPECT_TRUE(is_seen(150.5, 0.0, 48.9));  // 639 - (319.5 + 150.5 + 120)
    EXPECT_FALSE(is_seen(150.5, 0.0, 49.1));
    EXPECT_TRUE(is_seen(0.0, -199.5, 29.9));
    EXPECT_FALSE(is_seen(0.0, -199.5, 30.1));
    EXPECT_TRUE(is_seen(0.0, 180.5, 48.9));  // 479 - (239.5 + 180.5 + 10)
    EXPECT_FALSE(is_seen(0.0, 180.5, 49.1));
}

// Of the upper edge, 200 mm above the axis at 500 mm, the middle is at y = -0.4 and the ends at
// x = +-0.24, y = -0.4. With k1 = -0.3 the ends come to row 239.5 - 500 * 0.4 (1 - 0.3 * 0.2176)
// = 52.6, the middle to 239.5 - 500 * 0.4 (1 - 0.3 * 0.16) = 49.1.
TEST(MarkerInView, CountsAnEdgeThatBulgesOutBetweenItsEnds) {
    const Projector projector(camera_that_distorts({.k1 = -0.3}));
    const Rigid pose{Eigen::Quaterniond::Identity(), {0.0, -190.0, 500.0}};
    EXPECT_TRUE(is_in_view(projector, wide_grid(), pose, 49.0));
    EXPECT_FALSE(is_in_view(projector, wide_grid(), pose, 49.2));
}

TEST(MarkerInView, RefusesTheBackAndWhatIsNotInFrontOfTheCamera) {
    const Projector projector(camera_that_distorts({}));
    const CellGrid grid = wide_grid();
    const Eigen::Vector3d y_axis = Eigen::Vector3d::UnitY();
    EXPECT_TRUE(is_in_view(projector, grid, turned(80.0 * rad_per_deg, y_axis, {0, 0, 500}), 5.0));
    EXPECT_FALSE(
        is_in_view(projector, grid, turned(100.0 * rad_per_deg, y_axis, {0, 0, 500}), 5.0));
    EXPECT_FALSE(is_in_view(projector, grid, turned(0.0, y_axis, {0, 0, -500}), 5.0));
    // One end 18 mm behind the camera.
    EXPECT_FALSE(is_in_view(projector, grid, turned(80.0 * rad_per_deg, y_axis, {0, 0, 100}), 5.0));
    // The camera is 1.8 mm behind the marker's plane, and 3.1 mm before it.
    EXPECT_FALSE(
        is_in_view(projector, grid, turned(80.0 * rad_per_deg, y_axis, {-90, 0, 500}), 5.0));
    EXPECT_TRUE(
        is_in_view(projector, grid, turned(80.0 * rad_per_deg, y_axis, {-85, 0, 500}), 5.0));
}

// The plane through (0, 0, 500), turned by 89 degrees, passes the camera at 500 cos 89 = 8.7 mm: a
// lens of 8.5 mm radius reaches 8.5 sin 89 towards it, one of 8.9 mm through it. f = 500 px * 20 um
// = 10 mm (focused at infinity), so these are N = 10 / 17 and 10 / 17.8.
TEST(MarkerInView, WantsTheWholeLensBeforeTheMarkersPlane) {
    CameraModel camera = camera_that_distorts({});
    camera.sensor = Sensor{.pixel_pitch_um = 20.0};
    const Rigid pose = turned(89.0 * rad_per_deg, Eigen::Vector3d::UnitY(), {0, 0, 500});
    camera.lens = Lens{10.0 / 17.0, std::numeric_limits<double>::infinity(), 600.0, {}};
    EXPECT_TRUE(is_in_view(Projector(camera), wide_grid(), pose, 5.0));
    camera.lens->f_number = 10.0 / 17.8;
    EXPECT_FALSE(is_in_view(Projector(camera), wide_grid(), pose, 5.0));
}

// Rays of a telecentric lens are inclined by up to asin(0.2) = 11.5 degrees wherever the marker is:
// tilted by 78 degrees all of them see its front, by 79 not.
TEST(MarkerInView, WantsTheWholeConeOfATelecentricLensBeforeTheMarkersPlane) {
    CameraModel camera = camera_that_distorts({});
    camera.projection.kind = Projection::telecentric;
    camera.intrinsics = {2.0, 2.0, 319.5, 239.5};  // px/mm
    camera.sensor = Sensor{.pixel_pitch_um = 5.0};
    camera.lens = Lens{.focus_distance_mm = 200.0, .wavelength_nm = 600.0, .object_na = 0.2};
    const Projector projector(camera);
    for (const double x : {-30.0, 0.0, 60.0}) {
        const auto tilted = [&](double angle) {
            return turned(angle * rad_per_deg, Eigen::Vector3d::UnitY(), {x, 0, 300});
        };
        EXPECT_TRUE(is_in_view(projector, wide_grid(), tilted(78.0), 5.0)) << x;
        EXPECT_FALSE(is_in_view(projector, wide_grid(), tilted(79.0), 5.0)) << x;
    }
}

}  // namespace
}  // namespace etalon
