// Methods E and C for the points of one tile at a time, in single precision with the machine's
// widest vectors (Google Highway chooses at run time): the sums of sim/tiles/lens_average.h, within
// 2e-3 gray for edges blurred by more than 0.05 px (sharper: within the step of 1e-6 px),
// instruction sets within 1e-3 of each other. Formulas: docs/rendering.md.
//
// Lengths are "px", units of 1/f_x in undistorted normalised coordinates (wedge_pixels() and disks:
// px of the sensor), from the tile's centre. Finite values below 1e9 px give finite results. Pure,
// every thread.
#pragma once

#include <array>
#include <span>
#include <vector>

namespace etalon {

inline constexpr int tile_px = 4;  // side of a tile

struct EdgeProfile;
struct WedgeRows;

// A grid line as seen in one tile: D = offset + gradient . (dx, dy), the signed distance from the
// line of the pinhole ray, positive beyond it. Scaled so that |gradient| = 1.
struct TileLine {
    float offset, gradient_x, gradient_y;
    // The gradient on the lens, the same where the distortion leaves the blur round; its length
    // times TileGeometry's is the blur across the line.
    float blur_x, blur_y;
};

// What the rays of a tile meet. A ray through the point l of the unit disk sees beyond a line where
// D + w . l >= 0, with w = blur(dx, dy) gradient - turn D.
struct TileGeometry {
    // dx, dy of the undistorted sensor point: bicubic in s and t, which go from -0.5 to 0.5 across
    // the tile in x and y. The coefficient of s^i t^j is at [4 j + i].
    std::array<float, 16> dx, dy;
    // Signed blur radius: the aperture's radius times f_x c; it is affine in (dx, dy).
    float blur, blur_slope_x, blur_slope_y;
    // a times the aperture's radius; |turn| < 1.
    float turn_x, turn_y;
    std::vector<TileLine> columns, rows;  // consecutive lines
    // Radiance beyond the first j row lines and the first i column lines, row by row.
    std::vector<double> cells;
    double background = 0.0;  // what the values are differences from
    // E: the average over a disk of this radius too, px (0: none), is a mean over some cosines of
    // the averages over one disk of the radius sqrt(blur^2 + disk^2 + 2 cosine blur disk)
    // (sim/psf/deconvolved_psf.h); here, of this cosine.
    float disk = 0.0f, disk_cosine = 0.0f;
    // Pixels by the table: a times the aperture's radius on the lens, whatever coordinates the tile
    // has.
    float lens_turn_x = 0.0f, lens_turn_y = 0.0f;
};

// A point of the aperture, in units of its radius, and its share of the light.
struct UnitLensPoint {
    float x, y, weight;
};

// The centres of a tile's n x n parts, in blocks of 4 x 4 so that a vector of points stays close
// together and meets few lines.
struct TilePositions {
    // Continued by `margin` parts beyond the tile on each side. Throws NumericalError unless all of
    // them, n = parts + 2 margin a side, are a positive multiple of 4.
    explicit TilePositions(int parts, int margin = 0);

    int n;
    // Across the tile, -0.5 to 0.5 (a margin beyond): block by block, row by row within a block.
    std::vector<float> s, t;
    // Of the blocks' centres, in the blocks' order, continued to a multiple of 16.
    std::vector<float> block_s, block_t;
    // From a block's centre to its outermost points, in s and in t.
    float block_reach;
};

// E: the average over the whole aperture at each point. `values`: n x n, row by row. CPU time of a
// point with AVX-512: 1.4 ns, 1 ns per line that cuts the aperture of a point near it and 0.7 ns
// per crossing of two such lines; AVX2 a third more.
void exact_lens_samples(const TileGeometry& geometry, const TilePositions& positions,
                        float* values);

// C: the average over each part, a parallelogram with the sides of the polynomials' derivatives, of
// what some points of the aperture see; their weights' sum must be 1.
void exact_area_samples(const TileGeometry& geometry, const TilePositions& positions,
                        std::span<const UnitLensPoint> lens_points, float* values);

// The averages over the tile's 4 x 4 pixels of what the table's spread makes of the light: of a
// geometry in sensor px with all lines within the table's reach. CPU time with AVX-512: 0.1 us per
// line, 0.3 us per crossing and 0.7 us for every pixel less than 1.5 px from one.
void wedge_pixels(const TileGeometry& geometry, const TilePositions& positions,
                  const WedgeRows& table, float* values);

// What the pixels of a group of 4 x 4 tiles see that sees one edge (sim/tiles/edge_group.h):
// differences from the background.
struct EdgeGroup {
    static constexpr int level = 1, side_px = 4 * tile_px;

    int i, j;  // indices, as in UndistortionMap
    // The distance from the edge, px, positive beyond it, in a scale that has the blur's rim at
    // `blur` px: the coefficient of s^i t^j at [4 j + i], s and t from -0.5 to 0.5 across the
    // group.
    std::array<float, 16> distance;
    float blur;      // radius, px along the distance
    float diagonal;  // sin^2 of twice the edge's direction
    float before, beyond;
};

// The averages of the group's squares of 2 x 2 px before any point spread, 8 x 8 row by row.
// Within 1e-2 gray of the mean over the square of an edge blurred by 3 px.
void edge_averages(const EdgeGroup& group, float* averages);

// Adds the response to the rows from `first` to before `end`; `out`: the pixel of the group's first
// column in the row `first`. `profile` of the group's blur, of which `energy` is the filter's.
void add_edge(const EdgeGroup& group, const EdgeProfile& profile, float energy, int first, int end,
              float* out, std::ptrdiff_t stride);

// Highway's name of the instruction set in use: "AVX3" (AVX-512), "AVX2", "SSE4", "SSSE3",
// "SCALAR", ...
const char* tile_kernel_target();

}  // namespace etalon
