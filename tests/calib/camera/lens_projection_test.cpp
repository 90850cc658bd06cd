#include "calib/camera/lens_projection.h"

#include "tests/calib/lens_tables.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Kind = Projection;
using test::Complex, test::ComplexPoint, test::pi, test::ray_at;

// Each with parameters on both sides of where its formula or its limit changes.
const std::vector<LensProjection> projections{
    {Kind::perspective},
    {Kind::equidistant},
    {Kind::stereographic},
    {Kind::field_of_view, 0.0},
    {Kind::field_of_view, 0.013},
    {Kind::field_of_view, 0.93},
    {Kind::field_of_view, 2.9},
    {Kind::unified, 0.0},
    {Kind::unified, 0.71},
    {Kind::unified, 1.0},
    {Kind::unified, 1.83},
    {Kind::extended_unified, 0.86, 0.31},
    {Kind::extended_unified, 1.13, 0.62},
    {Kind::double_sphere, -0.21, 0.57},
    {Kind::double_sphere, 0.34, 0.44},
    {Kind::double_sphere, 0.0, 0.66},
};

std::string text(const LensProjection& p) {
    return fmt::format("kind {}, a {}, b {}", static_cast<int>(p.kind), p.a, p.b);
}

// The image radius as the papers have it, of the sine and cosine of the angle to the axis.
Complex radius_at(Kind kind, Complex a, Complex b, Complex sine, Complex cosine) {
    const Complex angle = std::atan(sine / cosine) + (cosine.real() < 0.0 ? pi : 0.0);
    const auto root = [&](Complex x) { return std::sqrt(sine * sine + x * x); };
    switch (kind) {
        case Kind::perspective:
            return sine / cosine;
        case Kind::telecentric:
            return {};
        case Kind::equidistant:
            return angle;
        case Kind::stereographic:
            return 2.0 * std::tan(0.5 * angle);
        case Kind::field_of_view:
            return a == 0.0 ? sine / cosine
                            : (std::atan(2.0 * sine / cosine * std::tan(0.5 * a)) +
                               (cosine.real() < 0.0 ? pi : 0.0)) /
                                  a;
        case Kind::unified:
            return sine / (cosine + a);
        case Kind::extended_unified:
            return sine / (b * std::sqrt(a * sine * sine + cosine * cosine) + (1.0 - b) * cosine);
        case Kind::double_sphere:
            return sine / (b * root(a + cosine) + (1.0 - b) * (a + cosine));
        default:
            return {};
    }
}

using RayAndParameters = Eigen::Matrix<double, 5, 1>;

ComplexPoint complex_plane(Kind kind, const Eigen::Matrix<Complex, 5, 1>& ray_and_parameters) {
    const Complex x = ray_and_parameters[0], y = ray_and_parameters[1], z = ray_and_parameters[2];
    const Complex across = std::sqrt(x * x + y * y), length = std::sqrt(x * x + y * y + z * z);
    const Complex radius =
        radius_at(kind, ray_and_parameters[3], ray_and_parameters[4], across / length, z / length);
    return {radius * x / across, radius * y / across};
}

// The largest angle of which there is an image.
double limit_of(const LensProjection& p) {
    double within = 0.0, beyond = pi;
    for (int i = 0; i < 60; ++i) {
        const double middle = 0.5 * (within + beyond);
        (onto_plane(p, ray_at(middle, 0.6)) ? within : beyond) = middle;
    }
    return within;
}

TEST(LensProjection, AndItsDerivativesAreThePapers) {
    for (const LensProjection& p : projections) {
        const double limit = limit_of(p);
        for (const double share : {0.02, 0.3, 0.55, 0.8, 0.97}) {
            SCOPED_TRACE(fmt::format("{}, {} of {}", text(p), share, limit));
            const Eigen::Vector3d ray = ray_at(share * limit, 2.13, 3.7);
            const auto found = onto_plane(p, ray);
            ASSERT_TRUE(found);
            const RayAndParameters at = (RayAndParameters() << ray, p.a, p.b).finished();
            const ComplexPoint m = complex_plane(p.kind, at.cast<Complex>());
            const double scale = found->point.norm();
            EXPECT_NEAR(found->point.x(), m[0].real(), 1e-13 * scale);
            EXPECT_NEAR(found->point.y(), m[1].real(), 1e-13 * scale);
            const Eigen::MatrixXd derivatives = test::complex_step(
                [&](const auto& moved) { return complex_plane(p.kind, moved); }, at);
            const double steepest = derivatives.cwiseAbs().maxCoeff();
            EXPECT_LE((found->by_ray - derivatives.leftCols<3>()).cwiseAbs().maxCoeff(),
                      1e-11 * steepest);
            if (p.a == 0.0 && p.kind == Kind::field_of_view)
                continue;  // there the paper has 0 / 0
            EXPECT_LE((found->by_a - derivatives.col(3)).norm(), 1e-11 * steepest);
            EXPECT_LE((found->by_b - derivatives.col(4)).norm(), 1e-11 * steepest);
        }
    }
}

TEST(LensProjection, IsInvertedUpToItsLimit) {
    for (const LensProjection& p : projections) {
        const double limit = limit_of(p);
        for (const double share : {0.0, 1e-9, 1e-4, 0.02, 0.5, 0.9, 0.999}) {
            SCOPED_TRACE(fmt::format("{}, {} of {}", text(p), share, limit));
            const Eigen::Vector3d ray = ray_at(share * limit, -0.83);
            const auto image = onto_plane(p, ray);
            ASSERT_TRUE(image);
            const auto back = from_plane(p, image->point);
            ASSERT_TRUE(back);
            // What the image's last digits are worth as an angle.
            const double along = (image->by_ray * ray_at(share * limit + pi / 2, -0.83)).norm();
            EXPECT_LE((back->normalized() - ray).norm(),
                      2e-15 * (1.0 + (1.0 + image->point.norm()) / along));
            const auto again = onto_plane(p, *back);
            ASSERT_TRUE(again);
            EXPECT_LE((again->point - image->point).norm(), 4e-13 * (1.0 + image->point.norm()));
        }
    }
}

// By brute force: the image's radius is positive and grows with the angle, as the papers' formulas
// go on beyond the limit; there it stops to.
TEST(LensProjection, EndsWhereItsImageStopsToGrow) {
    for (const LensProjection& p : projections) {
        SCOPED_TRACE(text(p));
        const auto radius = [&](double angle) {
            return radius_at(p.kind, p.a, p.b, std::sin(angle), std::cos(angle)).real();
        };
        constexpr double step = 1e-4;
        double last_good = 0.0;
        for (double angle = step; angle < pi - step; angle += step) {
            if (!(radius(angle) > radius(angle - step)))
                break;
            last_good = angle;
        }
        EXPECT_NEAR(limit_of(p), last_good, 3.0 * step);
    }
}

TEST(LensProjection, EndsOnThePlaneWhereItEnds) {
    for (const LensProjection& p : projections) {
        SCOPED_TRACE(text(p));
        const double at_limit =
            onto_plane(p, ray_at(limit_of(p) * (1.0 - 1e-12), 0.4))->point.norm();
        const double limit = plane_limit(p);
        if (std::isfinite(limit))
            EXPECT_NEAR(at_limit, limit, 1e-5 * limit);
        else
            EXPECT_GT(at_limit, 1e4);
    }
}

TEST(LensProjection, HasItsSlopeOnTheAxis) {
    for (const LensProjection& p : projections) {
        SCOPED_TRACE(text(p));
        const auto at_axis = onto_plane(p, {0.0, 0.0, 2.0});
        const auto beside = onto_plane(p, {2e-7, -1e-7, 2.0});
        ASSERT_TRUE(at_axis && beside);
        EXPECT_EQ(at_axis->point, Eigen::Vector2d::Zero());
        EXPECT_LE((beside->by_ray - at_axis->by_ray).norm(), 1e-6 * at_axis->by_ray.norm());
        EXPECT_LE((beside->point - at_axis->by_ray * Eigen::Vector3d(2e-7, -1e-7, 0.0)).norm(),
                  1e-17);
    }
}

TEST(LensProjection, MeetsPerspectiveWhereItsParameterIsZero) {
    const Eigen::Vector3d ray(0.7, -1.1, 0.9);
    const auto straight = onto_plane({}, ray);
    for (const LensProjection& p : {LensProjection{Kind::unified, 0.0},
                                    {Kind::field_of_view, 0.0},
                                    {Kind::extended_unified, 1.7, 0.0},
                                    {Kind::double_sphere, 0.0, 0.0}})
        EXPECT_LE((onto_plane(p, ray)->point - straight->point).norm(), 1e-15) << text(p);
}

TEST(LensProjection, HasNoImageOfWhatIsNoRay) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const double infinite = std::numeric_limits<double>::infinity();
    for (const LensProjection& p : projections) {
        SCOPED_TRACE(text(p));
        for (const Eigen::Vector3d& ray :
             {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(0, 0, -1), Eigen::Vector3d(nan, 0, 1),
              Eigen::Vector3d(1, infinite, 1)})
            EXPECT_FALSE(onto_plane(p, ray));
        EXPECT_FALSE(from_plane(p, {nan, 0.0}));
        EXPECT_FALSE(from_plane(p, {infinite, 0.0}));
    }
    EXPECT_FALSE(from_plane({Kind::equidistant}, {0.0, 3.15}));
    EXPECT_FALSE(from_plane({Kind::unified, 1.83}, {0.9, 0.0}));  // at most 1 / sqrt(a^2 - 1)
    EXPECT_EQ(*from_plane({Kind::telecentric}, {-3.5, 2.25}), Eigen::Vector3d(-3.5, 2.25, 1.0));
}

TEST(LensProjection, RefusesParametersThatNoLensHas) {
    for (const LensProjection& p : {LensProjection{Kind::field_of_view, 3.2},
                                    {Kind::unified, -0.1},
                                    {Kind::extended_unified, 1.0, 1.1},
                                    {Kind::extended_unified, 0.0, 0.5},
                                    {Kind::double_sphere, -1.0, 0.5},
                                    {Kind::double_sphere, 0.2, 1.01},
                                    {Kind::unified, std::numeric_limits<double>::quiet_NaN()}})
        EXPECT_THROW(require_possible(p), NumericalError) << text(p);
    for (const LensProjection& p : projections)
        EXPECT_NO_THROW(require_possible(p)) << text(p);
}

}  // namespace
}  // namespace etalon
