// Slanted-edge modulation transfer function: ISO 12233, edge-based spatial frequency response.
//
// The edge is located in each row by the centroid of its derivative, a straight line is fitted, and
// the pixels' distances from it along its normal are sorted into bins of a quarter pixel. The mean
// profile is differentiated, multiplied by a Tukey window (flat over the middle half) and Fourier
// transformed. As the standard does, the loss of the two-sided difference is taken out; beyond it,
// so is the loss of averaging over a bin, which the standard leaves in (2.6 % at half a cycle per
// px). Frequencies are along the edge's normal, in cycles per px (fx = fy assumed there).
//
// The result is that of lens, pixel and whatever the camera did, in linear radiance: decode first
// (compare/edges/edge_spread.h, linear_photo).
//
// The uncertainty is that of pixel noise, which is read off the two sides of the edge (linear in
// the signal between them), propagated through every step.
#pragma once

#include <opencv2/core.hpp>

#include <span>
#include <string>
#include <vector>

#include "compare/edges/edge_spread.h"

namespace etalon {

struct ModulationRow {
    double cycles_per_px, modulation, standard_uncertainty;
};

struct SlantedEdge {
    double angle_deg = 0.0;  // of the edge from the nearer pixel axis, 0..45
    double angle_standard_uncertainty_deg = 0.0;
    double dark = 0.0, light = 0.0;  // levels beside the edge, radiance
    int pixels = 0;
    std::vector<ModulationRow> modulation;  // 0 .. 1 cycle per px in steps of 1/width, 0 first
    // The frequency where the modulation falls to one half; 0 when it does not.
    double mtf50_cycles_per_px = 0.0, mtf50_standard_uncertainty = 0.0;
    // At half a cycle per px.
    double at_nyquist = 0.0, at_nyquist_standard_uncertainty = 0.0;
};

// One edge across a rectangle of a linear photograph. At least 16 px along the edge and across it;
// the edge crosses the two sides that it is steeper to and stays 8 px away from the others; its
// angle to the pixels' rows or columns is 1..44 degrees (the standard's 5 degrees is best: 2..10).
// Throws NumericalError with the values that tell why when a rectangle is not like that, holds
// clipped pixels or no edge. Under a ms for 100 x 100 px. Safe from every thread.
SlantedEdge slanted_edge(const LinearPhoto& photo, const cv::Rect& region);

// The same from an edge of a target, whose distances are known (distortion taken out); its own
// shift and turn are fitted. For edges whose band is at least 16 px wide and long.
SlantedEdge slanted_edge(const StraightEdge& edge);

// Slanted edges of any photograph, without knowing what it shows: every straight line segment
// (Grompone von Gioi et al., "LSD: a Line Segment Detector", Image Processing On Line 2, 2012) that
// runs 2 to 15 degrees off the pixels' rows or columns is measured in a window around it, as wide
// as its surroundings are even.

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
