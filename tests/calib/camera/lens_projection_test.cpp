#include "calib/camera/lens_projection.h"

#include <Eigen/Geometry>  // cross()

#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Kind = Projection;

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
            const Eigen::MatrixXd derivatives =
                complex_step([&](const auto& moved) { return complex_plane(p.kind, moved); }, at);
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

// ---- lens table

// Projections with tables: against their formulas written once more, in complex numbers where a
// derivative is wanted, and their regions by brute force.

// ---- polynomial: its ray of a point is explicit

ComplexRay polynomial_ray(const std::vector<double>& a, const ComplexPoint& m) {
    const Complex x = m[0], y = m[1] - a[3] * m[0], r = std::sqrt(x * x + y * y);
    return {x, y, 1.0 + a[0] * r * r + a[1] * r * r * r + a[2] * r * r * r * r};
}

TEST(PolynomialProjection, AndItsDerivativesInvertTheFormula) {
    for (const LensProjection& p : polynomials())
        for (const double share : {1e-9, 0.1, 0.4, 0.8, 0.99})
            for (const double azimuth : {0.3, 2.2, -1.9}) {
                const double r = share * std::min(p.table->limit, 4.0);
                const std::vector<double>& a = p.table->coefficients;
                const Eigen::Vector2d q(r * std::cos(azimuth), r * std::sin(azimuth));
                const Eigen::Vector2d m(q.x(), q.y() + a[3] * q.x());
                const ComplexRay ray = polynomial_ray(a, m.cast<Complex>());
                const auto found = onto_plane(p, 3.7 * ray.real());
                ASSERT_TRUE(found) << r;
                EXPECT_LT((found->point - m).norm(), 1e-13 * (1.0 + r)) << r;
                const Eigen::MatrixXd of_point =
                    complex_step([&](const ComplexPoint& at) { return polynomial_ray(a, at); }, m);
                const Eigen::Matrix2d identity = 3.7 * found->by_ray * of_point;
                EXPECT_LT((identity - Eigen::Matrix2d::Identity()).norm(), 1e-10) << r;
                EXPECT_LT((found->by_ray * ray.real()).norm(), 1e-13 * (1.0 + r)) << r;
                EXPECT_LT(from_plane(p, m)->cross(ray.real().normalized()).norm(), 1e-15);
            }
}

TEST(PolynomialProjection, EndsWhereItsAngleStopsToGrow) {
    for (const LensProjection& p : polynomials()) {
        const std::vector<double>& a = p.table->coefficients;
        const auto angle = [&](double r) {
            return std::atan2(r, 1.0 + a[0] * r * r + a[1] * r * r * r + a[2] * r * r * r * r);
        };
        constexpr double step = 1e-3;
        double r = 0.0;
        while (r < 30.0 && angle(r + step) > angle(r))
            r += step;
        if (r >= 30.0)
            EXPECT_TRUE(std::isinf(p.table->limit));
        else
            EXPECT_NEAR(p.table->limit, r, 2.0 * step);
        const double last = std::isinf(p.table->limit) ? angle(1e9) : angle(p.table->limit);
        EXPECT_TRUE(onto_plane(p, ray_at(last - 1e-6, 0.7)));
        if (last + 1e-6 < pi) {
            EXPECT_FALSE(onto_plane(p, ray_at(last + 1e-6, 0.7)));
        }
        EXPECT_FALSE(onto_plane(p, {0.0, 0.0, -1.0}));
    }
}

TEST(PolynomialProjection, IsPerspectiveWithoutCoefficients) {
    const LensProjection p = polynomial_projection(0, 0, 0, 0);
    const Eigen::Vector3d ray(0.7, -1.1, 0.9);
    EXPECT_LT((onto_plane(p, ray)->point - onto_plane({}, ray)->point).norm(), 1e-15);
    EXPECT_LT((onto_plane(p, ray)->by_ray - onto_plane({}, ray)->by_ray).norm(), 1e-14);
    EXPECT_FALSE(onto_plane(p, {0.7, -1.1, -0.01}));
}

// ---- CAHVOR: mrcal's formulas

Eigen::Vector3d cahvor_axis(const std::vector<double>& n) {
    return {std::sin(n[0]) * std::cos(n[1]), std::sin(n[1]), std::cos(n[0]) * std::cos(n[1])};
}

ComplexPoint cahvor_point(const std::vector<double>& n, const ComplexRay& p) {
    const double linearity = n[5];
    const Eigen::Vector3d o = cahvor_axis(n);
    Complex zeta = 0.0;
    for (int i = 0; i < 3; ++i)
        zeta += o[i] * p[i];
    const ComplexRay aside = p - zeta * o.cast<Complex>();
    const Complex lambda =
        std::sqrt(aside[0] * aside[0] + aside[1] * aside[1] + aside[2] * aside[2]);
    const Complex theta = std::atan(lambda / zeta) + (zeta.real() < 0.0 ? pi : 0.0);
    const Complex chi = linearity > 0.0   ? std::tan(linearity * theta) / linearity
                        : linearity < 0.0 ? std::sin(linearity * theta) / linearity
                                          : theta;
    const Complex mu = n[2] + n[3] * chi * chi + n[4] * chi * chi * chi * chi;
    const ComplexRay bent = (lambda / chi) * o.cast<Complex>() + (1.0 + mu) * aside;
    return {bent[0] / bent[2], bent[1] / bent[2]};
}

TEST(CahvorProjection, AndItsDerivativesAreMrcalsFormulas) {
    for (const LensProjection& p : cahvors())
        for (const double angle : {1e-7, 0.05, 0.3, 0.7, 1.0})
            for (const double azimuth : {0.3, 2.2, -1.9}) {
                const std::vector<double>& n = p.table->coefficients;
                const Eigen::Vector3d ray = ray_at(angle, azimuth, 3.7);
                const auto found = onto_plane(p, ray);
                ASSERT_TRUE(found) << angle;
                const ComplexPoint expected = cahvor_point(n, ray.cast<Complex>());
                EXPECT_LT((found->point - expected.real()).norm(), 1e-13);
                const Eigen::MatrixXd of_ray =
                    complex_step([&](const ComplexRay& at) { return cahvor_point(n, at); }, ray);
                EXPECT_LT((found->by_ray - of_ray).norm(), 1e-12);
                EXPECT_LT(from_plane(p, found->point)->cross(ray / 3.7).norm(), 1e-14);
            }
}

TEST(CahvorProjection, HasItsSlopeOnItsOwnAxis) {
    for (const LensProjection& p : cahvors()) {
        const Eigen::Vector3d o = cahvor_axis(p.table->coefficients);
        const Eigen::Vector3d step(2e-7, -1e-7, 3e-7);
        const auto at_axis = onto_plane(p, o), beside = onto_plane(p, o + step);
        ASSERT_TRUE(at_axis && beside);
        EXPECT_LT((beside->point - at_axis->point - at_axis->by_ray * step).norm(), 1e-12);
        EXPECT_LT((beside->by_ray - at_axis->by_ray).norm(), 1e-5);
        EXPECT_LT(from_plane(p, at_axis->point)->cross(o).norm(), 1e-15);
    }
}

// By brute force along many directions from the axis o: t' grows, and Z of the bent ray is
// positive.
TEST(CahvorProjection, EndsAtItsFoldOrAtARightAngle) {
    for (const LensProjection& p : cahvors()) {
        const std::vector<double>& n = p.table->coefficients;
        const Eigen::Vector3d o = cahvor_axis(n);
        for (const double azimuth : {0.1, 1.7, 3.0, 4.9}) {
            const Eigen::Vector3d side = o.unitOrthogonal(), other = o.cross(side);
            const Eigen::Vector3d aside = std::cos(azimuth) * side + std::sin(azimuth) * other;
            double before = 0.0;
            constexpr double step = 1e-3;
            for (double angle = step; angle < pi; angle += step) {
                const double turned = n[5] * angle;
                const bool bends = std::abs(turned) < pi / 2;
                const double chi = n[5] > 0.0   ? std::tan(turned) / n[5]
                                   : n[5] < 0.0 ? std::sin(turned) / n[5]
                                                : angle;
                const double t =
                    chi * (1.0 + n[2] + n[3] * chi * chi + n[4] * chi * chi * chi * chi);
                const bool goes_on = bends && t > before && (o + t * aside).z() > 0.0;
                const bool has_image =
                    onto_plane(p, std::cos(angle) * o + std::sin(angle) * aside).has_value();
                if (!goes_on) {
                    const double past = angle + step;
                    EXPECT_FALSE(onto_plane(p, std::cos(past) * o + std::sin(past) * aside));
                    break;
                }
                before = t;
                EXPECT_TRUE(
                    has_image || angle > pi - 2.0 * step ||
                    !onto_plane(p, std::cos(angle + step) * o + std::sin(angle + step) * aside))
                    << angle;
            }
        }
    }
}

// ---- splined: the basis by de Boor's recursion

Complex basis(int i, int degree, Complex x) {  // on the knots i, i + 1, ... i + degree + 1
    if (degree == 0)
        return x.real() >= i && x.real() < i + 1 ? 1.0 : 0.0;
    return (x - double(i)) / double(degree) * basis(i, degree - 1, x) +
           (double(i + degree + 1) - x) / double(degree) * basis(i + 1, degree - 1, x);
}

ComplexPoint splined_point(const LensTable& table, const ComplexRay& ray) {
    const Complex d = std::sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2]);
    const ComplexPoint u(2.0 * ray[0] / (d + ray[2]), 2.0 * ray[1] / (d + ray[2]));
    const double edge = 2.0 * std::tan(table.field_of_view_deg * pi / 720.0);
    const double spacing = 2.0 * edge / (table.columns - table.order);
    const double half = 0.5 * (table.order + 1);
    ComplexPoint m = u;
    for (int row = 0; row < table.rows; ++row)
        for (int col = 0; col < table.columns; ++col) {
            const Complex x = u[0] / spacing + 0.5 * (table.columns - 1) - double(col) + half;
            const Complex y = u[1] / spacing + 0.5 * (table.rows - 1) - double(row) + half;
            const Complex weight = basis(0, table.order, x) * basis(0, table.order, y);
            const std::size_t at = 2 * static_cast<std::size_t>(row * table.columns + col);
            m += weight * ComplexPoint(table.coefficients[at], table.coefficients[at + 1]);
        }
    return m;
}

TEST(SplinedProjection, AndItsDerivativesAreDeBoorsRecursion) {
    for (const LensProjection& p : splines())
        for (const double angle : {0.01, 0.3, 0.9, 1.4, 1.75})
            for (const double azimuth : {0.1, 3.0, -0.3}) {
                const Eigen::Vector3d ray = ray_at(angle, azimuth, 3.7);
                const auto found = onto_plane(p, ray);
                ASSERT_TRUE(found) << angle << " " << azimuth;
                const ComplexPoint expected = splined_point(*p.table, ray.cast<Complex>());
                EXPECT_LT((found->point - expected.real()).norm(), 1e-13);
                const Eigen::MatrixXd of_ray = complex_step(
                    [&](const ComplexRay& at) { return splined_point(*p.table, at); }, ray);
                EXPECT_LT((found->by_ray - of_ray).norm(), 1e-13 * (1.0 + of_ray.norm()));
                const auto back = from_plane(p, found->point);
                ASSERT_TRUE(back);
                EXPECT_LT(back->cross(ray / 3.7).norm(), 1e-13);
            }
}

TEST(SplinedProjection, EndsWithItsField) {
    for (const LensProjection& p : splines()) {
        const double half = p.table->field_of_view_deg * pi / 360.0;
        const double edge = 2.0 * std::tan(0.5 * half);
        const double down =
            edge * (p.table->rows - p.table->order) / (p.table->columns - p.table->order);
        for (const double share : {0.999999, 1.000001}) {
            const bool inside = share < 1.0;
            const double angle_x = 2.0 * std::atan(0.5 * share * edge);
            const double angle_y = 2.0 * std::atan(0.5 * share * down);
            EXPECT_EQ(onto_plane(p, ray_at(angle_x, 0.0)).has_value(), inside);
            EXPECT_EQ(onto_plane(p, ray_at(angle_x, pi)).has_value(), inside);
            EXPECT_EQ(onto_plane(p, ray_at(angle_y, pi / 2)).has_value(), inside);
            EXPECT_EQ(onto_plane(p, ray_at(angle_y, -pi / 2)).has_value(), inside);
        }
        EXPECT_FALSE(from_plane(p, {1.3 * edge, 0.1}));
        EXPECT_FALSE(onto_plane(p, {0.0, 0.0, -1.0}));
    }
}

// Control points that fall along x like 0.9 c to the right of the middle column make u + du stop to
// grow in between: nothing beyond the place where the determinant vanishes, by brute force.
TEST(SplinedProjection, EndsAtItsFirstFold) {
    constexpr int columns = 11, rows = 9;
    std::vector<double> control(2 * columns * rows, 0.0);
    for (int row = 0; row < rows; ++row)
        for (int col = 7; col < columns; ++col)
            control[2 * static_cast<std::size_t>(row * columns + col)] = -0.9 * (col - 6);
    const LensProjection p = splined_projection(3, columns, rows, 200.0, control);
    double last = 0.0;
    for (double angle = 0.0; angle < 1.7; angle += 1e-4) {
        const Eigen::Vector3d ray = ray_at(angle, 0.0);
        const Eigen::MatrixXd of_ray =
            complex_step([&](const ComplexRay& at) { return splined_point(*p.table, at); }, ray);
        if (!((of_ray * ray_at(angle + pi / 2, 0.0)).x() > 0.0))
            break;
        last = angle;
    }
    ASSERT_GT(last, 0.2);
    ASSERT_LT(last, 1.5);
    EXPECT_TRUE(onto_plane(p, ray_at(last - 2e-4, 0.0)));
    for (const double beyond : {2e-4, 0.1, 0.3})
        EXPECT_FALSE(onto_plane(p, ray_at(last + beyond, 0.0)));
    EXPECT_TRUE(onto_plane(p, ray_at(1.5, pi)));
}

// ---- all of them

TEST(LensTable, RefusesWhatNoLensIs) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(polynomial_projection(0, nan, 0, 0), NumericalError);
    EXPECT_THROW(cahvor_projection(0, 0, 0, nan, 0), NumericalError);
    EXPECT_THROW(cahvor_projection(0, 0, 1e300, 0, 0), NumericalError);
    EXPECT_THROW(cahvor_projection(2.0, 0, 0, 0, 0), NumericalError);
    EXPECT_THROW(cahvor_projection(0, 0, -1.0, 0, 0), NumericalError);
    EXPECT_THROW(cahvor_projection(0, 0, 0, 0, 0, 1.1), NumericalError);
    const std::vector<double> zeros(2 * 5 * 4, 0.0);
    EXPECT_NO_THROW(splined_projection(3, 5, 4, 100, zeros));
    EXPECT_THROW(splined_projection(4, 5, 4, 100, zeros), NumericalError);
    EXPECT_THROW(splined_projection(3, 4, 4, 100, zeros), NumericalError);
    EXPECT_THROW(splined_projection(3, 5, 4, 360, zeros), NumericalError);
    EXPECT_THROW(splined_projection(3, 5, 4, 100, std::vector<double>(40, nan)), NumericalError);
    std::vector<double> folding = zeros;
    for (int i = 0; i < 40; i += 2)
        folding[static_cast<std::size_t>(i)] = -5.0 * (i / 2 % 5);
    EXPECT_THROW(splined_projection(3, 5, 4, 100, folding), NumericalError);
    EXPECT_FALSE(is_possible({Projection::cahvor}));  // without its table
}

TEST(LensTable, IsComparedByWhatItHolds) {
    EXPECT_EQ(polynomial_projection(-0.1, 0, 0.02, 0), polynomial_projection(-0.1, 0, 0.02, 0));
    EXPECT_NE(polynomial_projection(-0.1, 0, 0.02, 0), polynomial_projection(-0.1, 0, 0.03, 0));
    EXPECT_NE(polynomial_projection(0, 0, 0, 0), LensProjection{});
}

TEST(LensTable, HasNoImageOfWhatIsNoRay) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const double infinite = std::numeric_limits<double>::infinity();
    for (const auto& projections : {polynomials(), cahvors(), splines()})
        for (const LensProjection& p : projections) {
            for (const Eigen::Vector3d& ray :
                 {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(nan, 0, 1), Eigen::Vector3d(1, nan, 1),
                  Eigen::Vector3d(1, infinite, 1), Eigen::Vector3d(0, 0, nan)})
                EXPECT_FALSE(onto_plane(p, ray));
            EXPECT_FALSE(from_plane(p, {nan, 0.0}));
            EXPECT_FALSE(from_plane(p, {0.0, nan}));
            EXPECT_FALSE(from_plane(p, {infinite, 0.0}));
        }
}

}  // namespace
}  // namespace etalon
