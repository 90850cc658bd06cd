// What the vector code of sim/tiles/wedge_kernel.cpp needs to know of a tile's lines, and the
// points of a pixel that it averages over.
#pragma once

#include <cstddef>

#include "sim/psf/wedge_table.h"
#include "sim/tiles/tile_kernel.h"

namespace etalon {

struct WedgeLine {
    TileLine line;
    float blur_scale;   // the blur across the line in units of the tile's
    float blur_across;  // the change of that by px across the line
    // How much of this is asymmetric: the lens turns the rest into a change of scale.
    float asymmetry;
    float rows_along;  // the change along the line, in rows of the table, in its directions' sense
    float bend;        // the line's change of gradient across it, by px
    float direction;   // place among the table's
    float extent;      // of a pixel across the line, px
    float per_chord;   // parts of its chord in a pixel by px along the line

    WedgeLine() = default;
    WedgeLine(const TileGeometry& tile, const TileLine& tile_line);
};

// The angle between the normals of two lines; almost parallel ones count as a thousandth apart.
struct WedgeAngle {
    float cosine, inverse_sine;

    WedgeAngle(const TileLine& a, const TileLine& b);
};

// Gauss' 8 x 8 nodes.
struct PixelNodes {
    static constexpr std::size_t side = 8, count = side * side;
    alignas(64) float x[count], y[count], weight[count];

    constexpr PixelNodes() : x(), y(), weight() {
        constexpr float node[] = {-0.48014493f, -0.39833324f, -0.26276621f, -0.09171732f,
                                  0.09171732f,  0.26276621f,  0.39833324f,  0.48014493f};
        constexpr float share[] = {0.05061427f, 0.11119052f, 0.15685332f, 0.18134189f,
                                   0.18134189f, 0.15685332f, 0.11119052f, 0.05061427f};
        for (std::size_t n = 0; n < count; ++n) {
            x[n] = node[n % side];
            y[n] = node[n / side];
            weight[n] = share[n % side] * share[n / side];
        }
    }
};

}  // namespace etalon
