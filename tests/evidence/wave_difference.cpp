// Prints how far the usual model, geometrical disk convolved with the Airy pattern, is from the
// wave-optical pattern on a black-white edge averaged over pixels. From encircled energies alone;
// no renderer takes part. docs/rendering.md has the table.
#include <fmt/format.h>

#include "bench/benchmark_scenes.h"
#include "sim/psf/diffraction.h"
#include "sim/psf/wave_point_spread.h"
#include "tests/evidence/edge_spread.h"

namespace etalon {
namespace {

constexpr int per_px = 10;

// The Airy pattern's profile, averaged over the disk's line spread 2 sqrt(R^2 - s^2) / (pi R^2).
std::vector<double> disk_and_airy(double lambda_n_px, double blur_px, double half) {
    const auto airy = PointSpreadFunction::airy(lambda_n_px);
    const auto energy = [&](double r) { return airy.energy_within(r); };
    const double wide = half + std::ceil(blur_px);
    const auto profile = test::pixel_profile(energy, wide, per_px);
    const auto at = [&](double t) {
        const double place = (t + wide) * per_px;
        const auto i = std::min(static_cast<std::size_t>(place), profile.size() - 2);
        const double part = place - static_cast<double>(i);
        return (1.0 - part) * profile[i] + part * profile[i + 1];
    };
    std::vector<double> result;
    constexpr int points = 400;
    for (int i = 0; i <= static_cast<int>(2 * half * per_px); ++i) {
        double sum = 0.0;  // s = R sin(angle): weight 2/pi cos^2
        for (int q = 0; q < points; ++q) {
            const double angle = ((q + 0.5) / points - 0.5) * std::numbers::pi;
            const double c = std::cos(angle);
            sum += c * c * at(i / double(per_px) - half - blur_px * std::sin(angle));
        }
        result.push_back(2.0 * sum / points);
    }
    return result;
}

void print_row(const std::string& name, double lambda_n_px, double blur_px) {
    const double half = std::ceil(blur_px) + 6.0;
    const auto usual = disk_and_airy(lambda_n_px, blur_px, half);
    const WavePointSpread wave(lambda_n_px, blur_px);
    const auto truth =
        test::pixel_profile([&](double r) { return wave.energy_within(r); }, half, per_px);
    double largest = 0.0, squares = 0.0, slope = 0.0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
        const double difference = 255.0 * (usual[i] - truth[i]);
        largest = std::max(largest, std::abs(difference));
        squares += difference * difference / per_px;
        if (i > 0)
            slope = std::max(slope, std::abs(truth[i] - truth[i - 1]) * per_px);
    }
    fmt::print("| {} | {:.1f} | {:.2f} | {:.2f} | {:.3f} |\n", name, blur_px, largest,
               std::sqrt(squares / (2.0 * half)), slope);
}

}  // namespace
}  // namespace etalon

int main() {
    using namespace etalon;
    fmt::print(
        "| camera | R, px | max, gray | RMS, gray | edge slope, 1/px |\n|---|---|---|---|---|\n");
    for (const std::string name : {"webcam-500", "canon-500"})
        for (const double blur_px : {0.0, 0.2, 0.5, 1.0, 2.0, 4.0})
            print_row(name.substr(0, name.find('-')), lambda_n_px(benchmark_scene(name).camera),
                      blur_px);
}
