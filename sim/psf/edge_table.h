// How a blurred straight edge looks: the part of a pixel's filter beyond it by the distance of the
// pixel's centre, tabulated once per camera: docs/rendering.md, "Table of edges".
#pragma once

#include <array>
#include <functional>
#include <mutex>
#include <vector>

namespace etalon {

// The response to one edge on its dark side: between two of `values` straight lines. At the
// distance d px from the edge, it is found at place per_px * d + shift; beyond the last: 0.
struct EdgeProfile {
    std::vector<float> values;
    float shift = 0.0f;
};

// Safe from every thread.
class EdgeTable {
public:
    static constexpr double per_px = 16.0;
    static constexpr double least_blur_px = 2.5, largest_blur_px = 48.0;
    static constexpr double gray = 0.02;  // of its own error, of an edge of contrast 1

    // `density`: the spread's energy per px^2 by the radius, nothing from `reach_px` on; scaled to
    // `energy`. Not convolved with the pixel.
    EdgeTable(const std::function<double(double)>& density, double reach_px, double energy);

    // Of an edge far behind, that is of the whole filter.
    double energy() const { return energy_; }
    // From the rim of the blur to where the response ends, px.
    double reach_px() const { return reach_px_; }

    // `diagonal`: sin^2 2a of the direction a of the edge. The blur must be within the limits
    // above. Cubic between rows of the table, 6 us each when they are made.
    void profile(double blur_px, double diagonal, EdgeProfile& profile) const;

    // What a change of the distances' gradient by 1 within a pixel's filter changes at most, beside
    // an edge of contrast 1 with this blur; gray.
    double gray_of_bend(double blur_px) const;

private:
    // Of one blur radius: along the pixels, and what a diagonal edge adds to it. From the distance
    // -before / per_px behind the rim on.
    struct Row {
        std::once_flag made;
        int before = 0;
        std::vector<float> straight, diagonal;
    };
    static constexpr double ratio = 1.1;  // of neighbouring rows' radii
    static constexpr int first_row = -1, row_count = 36;

    static double radius_of(int row);
    const Row& row(int index) const;
    void make(Row& row, double blur_px) const;

    double energy_, reach_px_, variance_;
    std::vector<double> straight_, diagonal_;  // line spreads, from their middle on
    mutable std::array<Row, row_count> rows_;
};

}  // namespace etalon
