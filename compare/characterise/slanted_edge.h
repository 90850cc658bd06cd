// Slanted-edge modulation transfer function: ISO 12233, edge-based spatial frequency response.
//
// The centroid of the derivative locates the edge in each row; a straight line is fitted; the
// pixels' distances along its normal are sorted into bins of 0.25 px. The mean profile is
// differentiated, multiplied by a Tukey window (flat over the middle half) and Fourier transformed.
// The losses of the two-sided difference and of averaging over a bin are taken out. Frequencies are
// along the edge's normal, cycles per px (fx = fy). The result is that of lens, pixel and camera in
// linear radiance (linear_photo()). The uncertainty is that of pixel noise at both sides of the
// edge, linear in the signal between them.
#pragma once

#include <string>

#include "compare/edges/edge_spread.h"

namespace etalon {

struct ModulationRow {
    double cycles_per_px, modulation, standard_uncertainty;
};

struct SlantedEdge {
    double angle_deg = 0.0;          // of the edge from the nearer pixel axis, 0..45
    double dark = 0.0, light = 0.0;  // levels at both sides of the edge, radiance
    int pixels = 0;
    std::vector<ModulationRow> modulation;  // 0 .. 1 cycle per px in steps of 1/width, 0 first
    // The frequency where the modulation falls to one half; 0 when it does not.
    double mtf50_cycles_per_px = 0.0, mtf50_standard_uncertainty = 0.0;
    double at_nyquist = 0.0, at_nyquist_standard_uncertainty = 0.0;  // at half a cycle per px
};

// One edge across a rectangle of a linear photograph, at least 16 px wide and high. The edge
// crosses two opposite sides and stays 8 px away from the others, at 1..44 degrees to the pixels'
// rows or columns (best: 2..10). Throws NumericalError with the values for any other rectangle, and
// for clipped pixels. Under a ms for 100 x 100 px. Safe from every thread.
SlantedEdge slanted_edge(const LinearPhoto& photo, const cv::Rect& region);

// The same of a target's edge with a band of at least 16 x 16 px, distortion taken out; its own
// shift and turn are fitted.
SlantedEdge slanted_edge(const StraightEdge& edge);

// Slanted edges of any photograph: every straight line segment (Grompone von Gioi et al., "LSD: a
// Line Segment Detector", Image Processing On Line 2, 2012) that runs 2 to 15 degrees off the
// pixels' rows or columns is measured in a window as wide as its surroundings are even.

struct FoundSlantedEdge {
    cv::Rect region;
    SlantedEdge edge;
};

struct SlantedEdges {
    std::vector<FoundSlantedEdge> edges;
    std::string reason;  // why the longest line that cannot be measured cannot; empty: no such line
};

// The edges whose MTF50 is most certain, the best first, none around the middle of another's
// region; at most `most`. Some 50 ns a pixel and a ms an edge. Safe from every thread.
SlantedEdges find_slanted_edges(const LinearPhoto& photo, std::size_t most = 12);

}  // namespace etalon
