#include "sim/tiles/lens_average.h"

#include "core/statistics/random.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Real = long double;

struct Line {
    double angle, offset;  // of the normal, rad
};

Eigen::Vector2d normal(const Line& line) {
    return {std::cos(line.angle), std::sin(line.angle)};
}

// Integral of sqrt(1 - x^2).
Real half_disk_integral(Real from, Real to) {
    const auto antiderivative = [](Real x) {
        const Real h = std::sqrt(std::max<Real>(0, (1 - x) * (1 + x)));
        return (x * h + std::atan2(x, h)) / 2;
    };
    return antiderivative(to) - antiderivative(from);
}

// The same area by another method, in long double: a's normal along x, then vertical strips from
// a's chord to the rim, cut off by b's chord. Needs n_b relative to n_a.
Real wedge_by_strips(const Line& a, const Line& b) {
    const Eigen::Vector2d na = normal(a), nb = normal(b);
    const Real c = Real(na.x()) * nb.x() + Real(na.y()) * nb.y();
    const Real s = Real(na.x()) * nb.y() - Real(na.y()) * nb.x();
    const Real t = b.offset, q = std::sqrt((1 - t) * (1 + t));
    Real x1 = -t * c - q * s, y1 = -t * s + q * c, x2 = -t * c + q * s, y2 = -t * s - q * c;
    if (x1 > x2) {
        std::swap(x1, x2);
        std::swap(y1, y2);
    }
    const auto full_strips = [&](Real from, Real to) {  // all or nothing: decided on the x axis
        return to > from && c * (from + to) / 2 + t >= 0 ? 2 * half_disk_integral(from, to) : 0;
    };
    const Real from = -Real(a.offset);
    Real area = full_strips(from, std::max(from, x1)) + full_strips(std::max(from, x2), 1);
    if (from < x2) {
        const Real begin = std::max(from, x1);
        const Real y = begin == x1 ? y1 : y1 + (begin - x1) / (x2 - x1) * (y2 - y1);
        const Real below = (x2 - begin) * (y + y2) / 2;  // integral of b's chord
        const Real half = half_disk_integral(begin, x2);
        area += s > 0 ? half - below : half + below;
    }
    return area / std::numbers::pi_v<Real>;
}

// Offsets and angles near everything that is delicate: the rim, the centre, parallel, opposite and
// square normals, and lines that meet on the rim.
class Draws {
public:
    explicit Draws(std::uint64_t seed) : random_(seed, 0) {}

    std::pair<Line, Line> next() {
        Line a{any_angle(), any_offset()}, b{0.0, any_offset()};
        const double turn[] = {any_angle(), tiny(), std::numbers::pi - tiny(),
                               std::numbers::pi / 2 + tiny()};
        b.angle = a.angle + turn[random_.bits() % 4];
        if (random_.bits() % 3 == 0)
            b.offset = within(a.offset + tiny());
        if (random_.bits() % 3 == 0)  // through the end of a's chord, almost
            b.offset = within(-std::cos(std::acos(-a.offset) - (b.angle - a.angle)) + tiny());
        return {a, b};
    }

private:
    double sign() { return random_.bits() % 2 ? 1.0 : -1.0; }
    double tiny() { return sign() * std::pow(10.0, -18.0 * random_.uniform()); }
    double any_angle() { return 2.0 * std::numbers::pi * random_.uniform(); }
    static double within(double t) {
        return std::clamp(t, std::nextafter(-1.0, 0.0), std::nextafter(1.0, 0.0));
    }
    double any_offset() {
        switch (random_.bits() % 3) {
            case 0:
                return within(sign() * (1.0 - std::abs(tiny())));
            case 1:
                return within(tiny());
            default:
                return within(2.0 * random_.uniform() - 1.0);
        }
    }

    RandomStream random_;
};

TEST(DiskArea, OfASegmentIsTheTextbookFormula) {
    for (const double t : {-0.9, -0.3, 0.0, 0.45, 0.99}) {
        const double expected = (std::acos(-t) + t * std::sqrt(1 - t * t)) / std::numbers::pi;
        EXPECT_NEAR(disk_chord({0.6, 0.8}, t).area, expected, 1e-15);
    }
}

TEST(DiskArea, OfParallelLinesNeedsNoCrossing) {
    const DiskChord a = disk_chord({0.6, 0.8}, 0.3), wider = disk_chord({0.6, 0.8}, 0.5);
    const DiskChord facing = disk_chord({-0.6, -0.8}, 0.2), away = disk_chord({-0.6, -0.8}, -0.4);
    EXPECT_DOUBLE_EQ(disk_wedge_area(a, wider), a.area);
    EXPECT_DOUBLE_EQ(disk_wedge_area(a, facing), a.area + facing.area - 1.0);
    EXPECT_DOUBLE_EQ(disk_wedge_area(a, away), 0.0);
}

// Normals are unit to 2^-53 only, which moves a chord that almost touches the rim by more than
// that; 1e-12 is 3e-10 gray.
TEST(DiskArea, OfAWedgeHoldsNearTheRimAndForNearlyParallelLines) {
    Draws draws(7);
    for (int i = 0; i < 1'000'000; ++i) {
        const auto [a, b] = draws.next();
        const DiskChord ca = disk_chord(normal(a), a.offset), cb = disk_chord(normal(b), b.offset);
        const double area = disk_wedge_area(ca, cb);
        ASSERT_NEAR(area, static_cast<double>(wedge_by_strips(a, b)), 1e-12) << i;
        const double low = std::max(0.0, ca.area + cb.area - 1.0);
        ASSERT_GE(area, low) << i;
        ASSERT_LE(area, std::max(low, std::min(ca.area, cb.area))) << i;
    }
}

// Fraction of a fine grid's points: independent of any geometry.
double counted(const SquareCut& a, const SquareCut& b) {
    constexpr int n = 1000;
    int inside = 0;
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            const Eigen::Vector2d s((i + 0.5) / n - 0.5, (j + 0.5) / n - 0.5);
            inside += a.offset + a.gradient.dot(s) >= 0.0 && b.offset + b.gradient.dot(s) >= 0.0;
        }
    return inside / double(n * n);
}

TEST(SquareArea, OfACutIsATrapeziumOrACorner) {
    EXPECT_DOUBLE_EQ(square_cut({4.0, 0.0}, 1.0).area, 0.75);
    EXPECT_DOUBLE_EQ(square_cut({0.0, -5.0}, -2.0).area, 0.1);
    // 3 x + 5 y >= 2 leaves a triangle with the corner (1/2, 1/2): legs 2/3 and 2/5.
    EXPECT_NEAR(square_cut({3.0, 5.0}, -2.0).area, 0.5 * (2.0 / 3.0) * (2.0 / 5.0), 1e-15);
    EXPECT_NEAR(square_cut({3.0, -5.0}, 2.0).area, 1.0 - 0.5 * (2.0 / 3.0) * (2.0 / 5.0), 1e-15);
}

TEST(SquareArea, OfNoGradientIsAllOrNothing) {
    EXPECT_EQ(square_cut({0.0, 0.0}, 0.1).area, 1.0);
    EXPECT_EQ(square_cut({0.0, 0.0}, -0.1).area, 0.0);
}

// From the area of a triangle and of a trapezium by hand, then all the way from 0 to 1.
TEST(SquareArea, IsThatOfTheOffsetFoundForIt) {
    // Legs 2/3 and 2/5 as above.
    EXPECT_NEAR(offset_of_area({3.0, 5.0}, 2.0 / 15.0), -2.0, 1e-14);
    EXPECT_NEAR(offset_of_area({0.0, -5.0}, 0.1), -2.0, 1e-14);
    for (const Eigen::Vector2d& gradient :
         {Eigen::Vector2d(3.0, 5.0), {-7.0, 2.0}, {0.5, -6.0}, {0.0, 4.0}, {2.0, 2.0}})
        for (const double area : {0.0, 1e-9, 0.03, 0.25, 0.5, 0.71, 0.999, 1.0})
            EXPECT_NEAR(square_cut(gradient, offset_of_area(gradient, area)).area, area, 1e-14);
}

TEST(SquareArea, OfTwoCutsIsWhatCountingPointsGives) {
    const SquareCut cuts[] = {square_cut({3.0, 5.0}, -0.4), square_cut({-7.0, 2.0}, 1.1),
                              square_cut({0.5, -6.0}, 2.0), square_cut({1.0, 1e-3}, 0.2)};
    for (const SquareCut& a : cuts)
        for (const SquareCut& b : cuts)
            EXPECT_NEAR(square_wedge_area(a, b), counted(a, b), 2e-3);
}

TEST(SquareArea, OfAQuadrantIsExact) {
    EXPECT_NEAR(square_wedge_area(square_cut({1.0, 0.0}, -0.2), square_cut({0.0, -1.0}, 0.1)),
                0.3 * 0.6, 1e-15);
}

}  // namespace
}  // namespace etalon
