// The point spread with a small disk taken out of it: disk (*) sharpened = spread. A sharp image
// sampled by averages over that disk and filtered by the sharpened spread is the image filtered by
// the spread itself; and averages over a disk follow an edge at fewer samples than averages over
// squares do (21 a pixel side instead of 35 for a webcam at 0.1 gray).
//
// By Fourier: the spread's transfer divided by the disk's, 2 J1(q) / q with q = 2 pi r f, out to
// the spread's cut-off, where q = 3.5 lies before the disk's first zero at 3.83.
#pragma once

#include <optional>
#include <vector>

#include "sim/diffraction.h"

namespace etalon {

class SharpenedSpread {
public:
    // Good to radii of `reach_px`. Nothing for a measured profile, which has no known transfer, and
    // for patterns below 0.04 px, which matter too little. Takes some 20 ms.
    static std::optional<SharpenedSpread> of(const PointSpreadFunction& spread, double reach_px);

    double disk_radius_px() const { return disk_radius_px_; }

    // Per px^2 at the radius r up to the reach. Has negative parts.
    double density(double r) const;

    // Seen along one axis, per px: the integral of the density over the other.
    double line(double x) const;

private:
    struct Wave {  // what is left of the transfer at this frequency, times the quadrature's weight
        double cycles_per_px, amplitude;
    };

    double disk_radius_px_ = 0.0, table_step_px_ = 1.0;
    std::vector<Wave> waves_;
    std::vector<double> table_;  // density at -1, 0, 1 ... steps
};

}  // namespace etalon
