// The core of a point spread with a small disk taken out: disk (*) sharpened = core. It needs fewer
// samples than averages over squares: docs/rendering.md, "C: exact area". It leaks a little beyond
// the cut-off, and is followed to 1.25 times that.
#pragma once

#include <functional>

#include "sim/psf/diffraction.h"

namespace etalon {

// One of the disks whose mean is the convolution of two others: c^2 = a^2 + b^2 + 2 cosine a b.
struct ConcentricDisk {
    double cosine, weight;
};
// Gauss' rule of that many disks, at least 1.
std::vector<ConcentricDisk> concentric_disks(int count);

class DeconvolvedPsf {
public:
    // Of spread density times window, a function of the radius that ends at `reach_px`. Nothing for
    // a measured profile (unknown cut-off) and patterns below 0.04 or above 50 px. Some 50 ms.
    static std::optional<DeconvolvedPsf> of(const PointSpreadFunction& spread,
                                            const std::function<double(double)>& window,
                                            double reach_px);

    double disk_radius_px() const { return disk_radius_px_; }
    // Beyond it nothing is left.
    double reach_px() const { return reach_px_; }

    // Per px^2 at the radius r. Has negative parts.
    double density(double r) const;

    // Seen along one axis, per px: the integral of the density over the other.
    double line(double x) const;

    // Up to this blur radius one disk stands for the disk and the lens together, within so many
    // gray for an edge of contrast 1.
    double blur_of_one_disk_px(double gray) const;
    // The fewest disks, 2 to 4, that do so whatever the blur; 0: none.
    int disks_for_any_blur(double gray) const;

private:
    struct Wave {  // what is left of the transfer at this frequency, times the quadrature's weight
        double cycles_per_px, amplitude;
    };

    double edge_change(const std::function<double(double)>& transfer) const;
    double gray_of_disks(int count, double blur_px) const;

    static constexpr int max_disks = 4;

    double disk_radius_px_ = 0.0, reach_px_ = 0.0, table_step_px_ = 1.0;
    double one_disk_gray_ = 0.0;                     // by the square of the blur radius
    std::array<double, max_disks + 1> most_gray_{};  // of any blur, by the number of disks
    std::vector<Wave> waves_;
    std::vector<double> densities_, lines_;  // at -1, 0, 1 ... steps
};

}  // namespace etalon
