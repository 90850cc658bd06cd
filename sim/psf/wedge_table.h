// What of a blurred spread falls beyond a straight edge and beyond both edges of a corner,
// tabulated once per camera: sharp images of few edges need no samples then. Definitions of P,
// turns, T(d, phi) and elliptic blur disks: docs/rendering.md, "Table of edges and corners".
#pragma once

#include "sim/psf/lagrange.h"

namespace etalon {

// The tables as the kernel reads them. The distance d px stands at the place per_unit d / (1 + d),
// the blur radius R at the row rows_per_px (sqrt(R^2 + even^2) - even): with R^2 first.
struct WedgeRows {
    const float* edges;   // [row][direction][distance]
    const float* turns;   // the same, of what lies beyond the edge times its place along it
    const float* wedges;  // [row][distance][angle, behind the last the density]
    int distances;
    float per_unit, first, last;  // the rows that there are
};

// Safe from every thread.
class WedgeTable {
public:
    static constexpr double largest_blur_px = 1.0;
    static constexpr int rows_per_px = 32;
    static constexpr double even_px = 0.1;
    static constexpr int directions = 24;  // steps of half a right angle
    static constexpr int angles = 64;      // steps of a right angle
    static constexpr int wedge_values = angles + 2;
    static constexpr double gray = 0.06;  // of its own error, of an edge of contrast 1

    // Whether the spread is wide enough for nodes within a pixel, and the core narrow enough.
    static bool suits(const PointSpreadFunction& spread, double reach_px);

    // Of the core of a spread, which ends at `core_px`: its transfer for functions that reach as
    // far as end_px(). Scaled to an energy of 1.
    WedgeTable(const std::vector<RadialWave>& core, double core_px);

    // Where the tables end: a pixel does not see an edge with the largest blur beyond.
    static double end_px(double core_px);
    // From where on it sees less than `negligible` of an edge with this blur.
    static constexpr double negligible = 3e-5;
    double reach_px(double blur_px) const { return sharp_reach_px_ + blur_px; }

    // The rows for blur radii between these, 0.3 ms each when they are made.
    WedgeRows rows(double least_blur_px, double largest_blur_px) const;

private:
    static constexpr int row_count = static_cast<int>(largest_blur_px * rows_per_px) + 2;

    void make(int row) const;
    void make_wedges(const Eigen::ArrayXd& amplitudes, const Eigen::VectorXd& lines,
                     float* to) const;
    void make_densities(double blur_px, float* to) const;

    double sharp_reach_px_ = 0.0;
    Eigen::ArrayXd frequencies_, amplitudes_;  // the latter of an energy of 1
    Eigen::ArrayXd distances_;
    Eigen::MatrixXd sines_, cosines_, bessels_, waves_;  // by distance and frequency
    Eigen::MatrixXd pixels_, turned_pixels_;             // by frequency and direction
    mutable std::array<std::once_flag, static_cast<std::size_t>(row_count)> made_;
    std::unique_ptr<float[]> edges_, turns_, wedges_;
};

}  // namespace etalon
