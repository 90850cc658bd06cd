#include "sim/psf/wave_point_spread.h"

#include <math.h>  // j0, j1: POSIX, not in namespace std

#include <complex>

#include "tests/test.h"

namespace etalon {
namespace {

using std::numbers::pi;

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

}  // namespace
}  // namespace etalon
