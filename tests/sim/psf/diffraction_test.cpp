#include "sim/psf/diffraction.h"

#include <math.h>  // j0, j1: POSIX, not in namespace std

#include "sim/psf/wave_point_spread.h"
#include "sim/psf/wedge_table.h"
#include "sim/tiles/image_filter.h"
#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

using std::numbers::pi;

CameraModel camera_with_lens(double wavelength_nm) {
    return test::camera_with(64, 48, {700.0, 500.0, 31.0, 23.0}, {}, Sensor{.pixel_pitch_um = 6.0},
                             Lens{2.8, 300.0, wavelength_nm, {}});
}

TEST(Airy, HasItsFirstDarkRingAt122LambdaN) {
    const auto psf = PointSpreadFunction::airy(0.7);
    EXPECT_LT(psf.density(1.2196699 * 0.7), 1e-12 * psf.density(0.0));
    EXPECT_NEAR(psf.energy_within(1.2196699 * 0.7), 0.83778, 1e-5);  // Born and Wolf, 8.5.2
}

TEST(Airy, DensityIsTheDerivativeOfTheEncircledEnergy) {
    const auto psf = PointSpreadFunction::airy(0.7);
    for (const double r : {0.001, 0.3, 0.9, 4.0}) {
        const double h = 1e-5;
        const double slope = (psf.energy_within(r + h) - psf.energy_within(r - h)) / (2.0 * h);
        EXPECT_NEAR(psf.density(r) * 2.0 * pi * r, slope, 1e-6);
    }
}

TEST(Airy, LeavesTwoLambdaNOverPiSquaredRBeyondR) {
    const auto psf = PointSpreadFunction::airy(0.5);
    const double r = psf.radius_of_tail(0.004);
    EXPECT_NEAR(r, 2.0 * 0.5 / (pi * pi * 0.004), 1e-12);
    EXPECT_NEAR(1.0 - psf.energy_within(r), 0.004, 0.01 * 0.004);
}

TEST(Airy, WidthFollowsTheWorkingFNumber) {
    const CameraModel camera = camera_with_lens(550.0);
    const double v = 700.0 * 6e-3;
    const double f = 1.0 / (1.0 / 300.0 + 1.0 / v);
    const double working = 2.8 * v / f;
    EXPECT_NEAR(PointSpreadFunction::of(camera).scale_px(), 0.550 * working / 6.0, 1e-12);
}

TEST(Airy, RefusesAWavelengthThatIsNotPositive) {
    EXPECT_THROW(PointSpreadFunction::of(camera_with_lens(0.0)), NumericalError);
    EXPECT_THROW(PointSpreadFunction::of(camera_with_lens(std::nan(""))), NumericalError);
}

// Core and rings together hold all the energy, on a sensor with oblong pixels too: they end with a
// smooth window between a radius and its double.
TEST(ImageFilter, LevelsTogetherHoldAllEnergy) {
    const ImageFilter filter(camera_with_lens(550.0));
    const auto psf = PointSpreadFunction::of(camera_with_lens(550.0));
    for (const SampleKind kind : {SampleKind::point, SampleKind::box})
        for (const int k : {1, 3}) {
            double energy = filter.core(k, kind).energy;
            const int first = filter.first_ring();
            for (int shift = first; shift < first + 8; ++shift) {
                EXPECT_GT(energy, psf.energy_within(filter.radius_held(shift)));
                EXPECT_LT(energy, psf.energy_within(2.0 * filter.radius_held(shift)));
                energy += filter.ring(shift, false).energy;
            }
            EXPECT_NEAR(energy, 1.0, 2e-4);
        }
}

TEST(ImageFilter, ARingHoldsTheEnergyOfTheFinerOnesToo) {
    const ImageFilter filter(camera_with_lens(550.0));
    const int first = filter.first_ring();
    double energy = filter.ring(first, false).energy;
    for (int shift = first + 1; shift < first + 3; ++shift) {
        energy += filter.ring(shift, false).energy;
        EXPECT_NEAR(filter.ring(shift, true).energy, energy, 1e-9);
    }
}

TEST(ImageFilter, RefusesKernelsThatNoMemoryHolds) {
    CameraModel camera = camera_with_lens(550.0);
    camera.lens->wavelength_nm *= 110.0 / PointSpreadFunction::of(camera).scale_px();
    EXPECT_THROW(ImageFilter(camera).core(24, SampleKind::point), NumericalError);
}

TEST(ImageFilter, OfACameraWithoutLensIsThePixelsMean) {
    CameraModel camera = camera_with_lens(550.0);
    camera.lens.reset();
    const ImageFilter filter(camera);
    EXPECT_FALSE(filter.has_tail());
    const FilterKernel& core = filter.core(3, SampleKind::box);
    EXPECT_EQ(core.reach_x, 0);
    EXPECT_EQ(core.reach_y, 0);
    EXPECT_NEAR(core.energy, 1.0, 1e-12);
}

// ---- wave point spread

// The integral itself, by the midpoint rule in rho^2 with Richardson's step: independent of the
// Lommel functions.
double intensity_by_integration(double u, double v) {
    const auto amplitude = [&](int n) {
        std::complex<double> sum = 0.0;
        for (int i = 0; i < n; ++i) {
            const double t = (i + 0.5) / n;
            sum += std::polar(::j0(v * std::sqrt(t)) / n, 0.5 * u * t);
        }
        return sum;
    };
    const int n = 4000 + static_cast<int>(60.0 * (u + v));
    return std::norm((4.0 * amplitude(2 * n) - amplitude(n)) / 3.0);
}

TEST(WaveIntensity, IsTheDiffractionIntegral) {
    for (const double u : {0.0, 1e-7, 0.003, 0.09, 0.11, 1.0, 4.7, 12.0, 40.0, 130.0})
        for (const double v : {0.0, 1e-8, 0.05, 0.11, 0.9, 4.7, 11.0, 13.0, 45.0, 160.0})
            EXPECT_NEAR(wave_intensity(u, v), intensity_by_integration(u, v), 2e-9)
                << "u " << u << " v " << v;
}

TEST(WavePointSpread, InFocusIsTheAiryPattern) {
    const double scale = 0.51;
    const WavePointSpread psf(scale, 0.0);
    for (const double r : {0.01, 0.3, 0.62, 1.7, 9.0}) {
        const double x = pi * r / scale, a = ::j0(x), b = ::j1(x);
        EXPECT_NEAR(psf.density(r), b * b / (pi * r * r), 1e-6);
        EXPECT_NEAR(psf.energy_within(r), 1.0 - a * a - b * b, 1e-6);
    }
    // Beyond the table: 2 lambda N / (pi^2 r) on average.
    EXPECT_NEAR(1.0 - psf.energy_within(200.0), 2.0 * scale / (pi * pi * 200.0), 1e-6);
}

// The energy is summed from the density here by the midpoint rule, to the end of the table, and
// beyond it closed by the mean over the rings: what is left over is the error of all of it.
TEST(WavePointSpread, KeepsTheEnergy) {
    for (const double blur : {0.0, 0.4, 3.0, 12.0}) {
        const double scale = 0.3;
        const WavePointSpread psf(scale, blur);
        const double end = 0.999 * psf.table_end_px();
        constexpr int steps = 400000;
        double sum = 0.0;
        for (int i = 0; i < steps; ++i) {
            const double r = end * (i + 0.5) / steps;
            sum += psf.density(r) * 2.0 * pi * r * end / steps;
            if (i % 50000 == 0) {
                EXPECT_NEAR(psf.energy_within(end * (i + 1.0) / steps), sum, 2e-6);
            }
        }
        const double outside = 2.0 * scale * end / (pi * pi * (end * end - blur * blur));
        EXPECT_NEAR(sum + outside, 1.0, 1e-5) << blur;
    }
}

// With many Fresnel zones the energy becomes the geometrical disk's.
TEST(WavePointSpread, TendsToTheDisk) {
    const double blur = 10.0;
    double last = 1.0;
    for (const double scale : {0.8, 0.2, 0.05}) {
        const WavePointSpread psf(scale, blur);
        double worst = 0.0;
        for (double r = 0.5; r < 9.0; r += 0.37)
            worst = std::max(worst, std::abs(psf.energy_within(r) - r * r / (blur * blur)));
        EXPECT_LT(worst, 0.6 * last) << scale;
        last = worst;
    }
    EXPECT_LT(last, 0.02);
}

TEST(WavePointSpread, InvertsItsEnergy) {
    const WavePointSpread psf(0.22, 2.0);
    for (const double energy : {0.0, 1e-5, 0.1, 0.6, 0.97, 0.9999, 0.9999999})
        EXPECT_NEAR(psf.energy_within(psf.radius_of(energy)), energy, 1e-7);
}

TEST(WavePointSpread, RefusesWhatIsNone) {
    EXPECT_THROW(WavePointSpread(0.0, 1.0), NumericalError);
    EXPECT_THROW(WavePointSpread(std::nan(""), 1.0), NumericalError);
    EXPECT_THROW(WavePointSpread(0.2, -1.0), NumericalError);
    EXPECT_THROW(WavePointSpread(0.2, std::nan("")), NumericalError);
    EXPECT_THROW(WavePointSpread(0.01, 20.0), NumericalError);
}

// ---- wedge table

constexpr double sigma = 0.4;

WedgeTable gaussian_table() {
    constexpr double reach = 6.0 * sigma;
    return {radial_transfer(
                PointSpreadFunction::gaussian(sigma), [](double) { return 1.0; }, reach,
                WedgeTable::end_px(reach)),
            reach};
}

// Between the values of a table: where to read, and how far behind.
struct Place {
    int index;
    double way;

    explicit Place(double place) : index(static_cast<int>(place)), way(place - index) {}

    double between(double near, double far) const { return near + way * (far - near); }
};

Place row_of(double blur_px) {
    return Place(WedgeTable::rows_per_px *
                 (std::hypot(blur_px, WedgeTable::even_px) - WedgeTable::even_px));
}

double edge_value(const WedgeTable& table, double distance, double blur_px, int direction) {
    const WedgeRows rows = table.rows(blur_px, blur_px);
    const Place row = row_of(blur_px),
                at(static_cast<double>(rows.per_unit) * distance / (1.0 + distance));
    const auto along = [&](int index) {
        const float* values =
            rows.edges + (index * (WedgeTable::directions + 1) + direction) * rows.distances;
        return at.between(values[at.index], values[at.index + 1]);
    };
    return row.between(along(row.index), along(row.index + 1));
}

// The mean over a pixel and the line spread of a disk, by Gauss and Chebyshev.
double edge_truth(double distance, double blur_px, double angle) {
    constexpr int n = 48;
    double sum = 0.0;
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            const double x = (i + 0.5) / n - 0.5, y = (j + 0.5) / n - 0.5;
            const double place = distance - x * std::cos(angle) - y * std::sin(angle);
            for (int q = 1; q <= 16; ++q) {
                const double turn = pi * q / 17.0, sine = std::sin(turn);
                const double beyond = place + blur_px * std::cos(turn);
                sum += 1.0 / 17.0 * sine * sine * std::erfc(beyond / sigma / std::numbers::sqrt2);
            }
        }
    return sum / (n * n);
}

TEST(WedgeTable, IsTheMeanOfAPixelBeyondAnEdge) {
    const WedgeTable table = gaussian_table();
    for (const double blur : {0.0, 0.07, 0.33, 0.9})
        for (const int direction : {0, 7, WedgeTable::directions})
            for (double distance = 0.0; distance < 2.4; distance += 0.29)
                EXPECT_NEAR(
                    255.0 * edge_value(table, distance, blur, direction),
                    255.0 * edge_truth(distance, blur, pi / 4 * direction / WedgeTable::directions),
                    0.025)
                    << blur << " px, direction " << direction << ", " << distance << " px";
}

// Owen, "Tables for computing bivariate normal probabilities", 1956.
TEST(WedgeTable, IsOwensFunctionOfASharpGaussian) {
    const WedgeTable table = gaussian_table();
    const WedgeRows rows = table.rows(0.0, 0.0);
    for (const int at : {0, 31, 90, 150})
        for (const int angle : {5, 32, 63, WedgeTable::angles}) {
            const double distance = at / (static_cast<double>(rows.per_unit) - at);
            constexpr int steps = 4000;
            double truth = 0.0;
            for (int n = 0; n < steps; ++n) {
                const double turn = (n + 0.5) / steps * angle * pi / 2 / WedgeTable::angles;
                truth += std::exp(-0.5 * std::pow(distance / sigma / std::cos(turn), 2));
            }
            truth *= angle * pi / 2 / WedgeTable::angles / steps / (2.0 * pi);
            EXPECT_NEAR(255.0 * rows.wedges[at * WedgeTable::wedge_values + angle], 255.0 * truth,
                        0.003)
                << distance << " px, angle " << angle;
        }
}

// The density with a paraboloid in place of the disk, where the spread is much narrower than that.
TEST(WedgeTable, KnowsTheDensity) {
    const WedgeTable table = gaussian_table();
    const WedgeRows sharp = table.rows(0.0, 0.0);
    const int at = 64;
    const double distance = at / (static_cast<double>(sharp.per_unit) - at);
    EXPECT_NEAR(sharp.wedges[at * WedgeTable::wedge_values + WedgeTable::angles + 1],
                std::exp(-0.5 * std::pow(distance / sigma, 2)) / (2.0 * pi * sigma * sigma), 1e-4);
    // A paraboloid's variance is R^2 / 6 along an axis; in the middle that is all that counts.
    const double blur = 0.15;
    const Place row = row_of(blur);
    const WedgeRows rows = table.rows(blur, blur);
    const auto middle = [&](int index) {
        return rows
            .wedges[index * rows.distances * WedgeTable::wedge_values + WedgeTable::angles + 1];
    };
    EXPECT_NEAR(row.between(middle(row.index), middle(row.index + 1)),
                1.0 / (2.0 * pi * (sigma * sigma + blur * blur / 6.0)), 0.002);
}

TEST(WedgeTable, SaysWhereAPixelSeesNoEdge) {
    const WedgeTable table = gaussian_table();
    const double reach = table.reach_px(0.2);
    EXPECT_LT(edge_value(table, reach, 0.2, WedgeTable::directions), 2.0 * WedgeTable::negligible);
    EXPECT_GT(edge_value(table, 0.8 * reach, 0.2, WedgeTable::directions), WedgeTable::negligible);
}

TEST(WedgeTable, IsNotForSpreadsThatAreTooNarrowOrTooWide) {
    EXPECT_TRUE(WedgeTable::suits(PointSpreadFunction::airy(0.3), 3.3));
    EXPECT_FALSE(WedgeTable::suits(PointSpreadFunction::airy(0.1), 3.3));
    EXPECT_FALSE(WedgeTable::suits(PointSpreadFunction::airy(0.9), 6.1));
    EXPECT_FALSE(WedgeTable::suits(
        PointSpreadFunction::measured({{0.0, 1.0}, {0.5, 0.6}, {1.0, 0.2}, {2.0, 0.0}}), 2.0));
}

}  // namespace
}  // namespace etalon
