#include "sim/psf/deconvolved_psf.h"

#include <cmath>

#include "sim/psf/lagrange.h"

namespace etalon {
namespace {

constexpr double two_pi = 2.0 * std::numbers::pi;
constexpr double disk_phase_at_cutoff = 2.6;
constexpr double min_scale_px = 0.04, max_scale_px = 50.0;
constexpr double steps_per_scale = 40.0;

// Cubic, in a table from -1 on; 0 behind its end.
double interpolated(const std::vector<double>& table, double place) {
    const auto n = static_cast<std::size_t>(place);
    if (n + 3 >= table.size())
        return 0.0;
    return cubic_through(&table[n], place - static_cast<double>(n));
}

}  // namespace

std::optional<DeconvolvedPsf> DeconvolvedPsf::of(const PointSpreadFunction& spread,
                                                 const std::function<double(double)>& window,
                                                 double reach_px) {
    const double scale = spread.scale_px();
    if (!spread.has_cutoff() || scale < min_scale_px || scale > max_scale_px)
        return std::nullopt;
    DeconvolvedPsf result;
    result.disk_radius_px_ = disk_phase_at_cutoff / (two_pi * cutoff_per_px(spread));
    result.reach_px_ = reach_px + 4.0 * result.disk_radius_px_;
    result.table_step_px_ = spread.scale_px() / steps_per_scale;

    const double step = result.table_step_px_;
    for (const RadialWave& wave : radial_transfer(spread, window, reach_px, result.reach_px_))
        result.waves_.push_back(
            {wave.cycles_per_px, wave.transfer * wave.width /
                                     disk_transfer(result.disk_radius_px_ * wave.cycles_per_px)});
    const int steps = static_cast<int>(result.reach_px_ / step) + 4;
    for (int n = -1; n < steps; ++n) {
        double density = 0.0,
               line = 0.0;  // the transfer along one axis is a section of the plane's
        for (const Wave& wave : result.waves_) {
            const double phase = two_pi * wave.cycles_per_px * n * step;
            density += two_pi * wave.amplitude * wave.cycles_per_px * j0(phase);
            line += 2.0 * wave.amplitude * std::cos(phase);
        }
        result.densities_.push_back(density);
        result.lines_.push_back(line);
    }
    // J(a) J(b) - J(root of a^2 + b^2) is at most a^2 b^2 / 192, J(q) = 2 J1(q) / q.
    const double r0 = result.disk_radius_px_;
    result.one_disk_gray_ =
        result.edge_change([&](double f) { return std::pow(two_pi * f, 4) * r0 * r0 / 192.0; });
    for (int disks = 2; disks <= max_disks; ++disks) {
        double& most = result.most_gray_[static_cast<std::size_t>(disks)];
        for (const double ratio : {1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 12.0})
            most = std::max(most, result.gray_of_disks(disks, ratio * r0));
    }
    return result;
}

// By how much the image of an edge changes at most, anywhere, when what the disk averages has its
// transfer changed by so much: the sum of the magnitudes.
double DeconvolvedPsf::edge_change(const std::function<double(double)>& transfer) const {
    double sum = 0.0;
    for (const Wave& wave : waves_) {
        const double f = wave.cycles_per_px, phase = std::numbers::pi * f;
        sum += std::abs(wave.amplitude * std::sin(phase) / phase * transfer(f) / phase);
    }
    return 255.0 * sum;
}

double DeconvolvedPsf::gray_of_disks(int count, double blur_px) const {
    const auto disks = concentric_disks(count);
    return edge_change([&](double f) {
        double left = disk_transfer(disk_radius_px_ * f) * disk_transfer(blur_px * f);
        for (const ConcentricDisk& disk : disks)
            left -= disk.weight *
                    disk_transfer(std::sqrt(blur_px * blur_px + disk_radius_px_ * disk_radius_px_ +
                                            2.0 * disk.cosine * blur_px * disk_radius_px_) *
                                  f);
        return left;
    });
}

double DeconvolvedPsf::blur_of_one_disk_px(double gray) const {
    return std::sqrt(gray / one_disk_gray_);
}

int DeconvolvedPsf::disks_for_any_blur(double gray) const {
    for (int count = 2; count <= max_disks; ++count)
        if (most_gray_[static_cast<std::size_t>(count)] <= gray)
            return count;
    return 0;
}

// Chebyshev's polynomials of the second kind belong to the weight.
std::vector<ConcentricDisk> concentric_disks(int count) {
    std::vector<ConcentricDisk> disks;
    for (int i = 1; i <= count; ++i) {
        const double angle = i * std::numbers::pi / (count + 1), sine = std::sin(angle);
        disks.push_back({std::cos(angle), 2.0 / (count + 1) * sine * sine});
    }
    return disks;
}

double DeconvolvedPsf::density(double r) const {
    return interpolated(densities_, r / table_step_px_);
}

double DeconvolvedPsf::line(double x) const {
    return interpolated(lines_, std::abs(x) / table_step_px_);
}

}  // namespace etalon
