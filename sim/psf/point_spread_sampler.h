// Draws displacements from a point spread: the inverse of the encircled energy. For the reference
// integrator only; the filters of the other methods integrate the density instead.
#pragma once

#include "calib/camera/camera_model.h"

namespace etalon {

class PointSpreadSampler {
public:
    // Of the camera's lens section, which must exist, with one pattern for the whole image (not the
    // wave-optical model).
    explicit PointSpreadSampler(const CameraModel& camera);

    struct Energy {
        double within;  // 0 <= within < 1
        double weight;  // of this draw; 1 on average
    };

    // Which part of the energy to draw the radius of, for u uniform in (0, 1). A quarter of the
    // draws goes to the outermost 5 %.
    static Energy energy(double u);

    // Radius that holds this part of the energy, in units of the pixel pitch along x.
    double radius_of(double energy) const;

private:
    void tabulate_profile(const std::vector<std::pair<double, double>>& profile);
    // The interval of energy_ that holds this energy, and how far into it.
    struct Position {
        std::size_t index;
        double part;
    };
    Position position_of(double energy) const;

    PointSpread::Kind kind_;
    double scale_px_;             // lambda N_w, or sigma
    std::vector<double> energy_;  // within x = i * step of the Airy pattern, or within radius_
    std::vector<double> radius_;  // of a profile, px
    std::vector<int> guide_;      // first index of energy_ to look at, by energy
};

}  // namespace etalon
