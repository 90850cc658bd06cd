// Draws displacements from a point spread: the inverse of the encircled energy. For the reference
// integrator only; the filters of the other methods integrate the density instead.
#pragma once

#include <vector>

#include "calib/camera_model.h"

namespace etalon {

class PointSpreadSampler {
public:
    // Of the camera's lens section, which must exist, with one pattern for the whole image (not the
    // wave-optical model).
    explicit PointSpreadSampler(const CameraModel& camera);

    struct Radius {
        double r;       // in units of the pixel pitch along x
        double weight;  // of this draw; 1 on average
    };

    // For u uniform in (0, 1). A quarter of the draws goes to the outermost 5 % of the energy, so
    // that the tail, which matters far from edges, is not left to chance.
    Radius radius(double u) const;

    // Radius that holds this part of the energy, 0 <= energy < 1.
    double radius_of(double energy) const;

private:
    void tabulate_airy();
    void tabulate_profile(const std::vector<std::pair<double, double>>& profile);
    void make_guide();
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
