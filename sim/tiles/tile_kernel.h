// Methods E and C for the points of one tile at a time, in single precision with the widest vector
// instructions that the machine has (Google Highway chooses at run time).
//
// The same sums as sim/tiles/lens_average.h and sim/tiles/lens_average.h, which are in double
// precision and the truth in the tests: every instruction set is within 2e-3 gray of them for edges
// blurred by more than 0.05 px (and for sharper ones within the step that 1e-6 px make), and within
// 1e-3 gray of every other. docs/rendering.md has the formulas.
//
// All lengths are in "px", units of 1/f_x in undistorted normalised coordinates (of wedge_pixels()
// and of averages over disks: px of the sensor), and are taken from
// the tile's centre: that is what makes single precision enough. Finite values below 1e9 px give
// finite results. Pure functions, safe from every thread, without allocation.
#pragma once

#include <array>
#include <span>
#include <vector>

namespace etalon {

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
    float base;                           // radiance before the first lines
    std::vector<float> column_contrast;   // across each column line, before the first row line
    std::vector<float> row_contrast;      // across each row line, before the first column line
    // Mixed difference of the four cells at each crossing, row-major [row line][column line].
    std::vector<float> mixed;
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
// together and meets few lines. Immutable.
class TilePositions {
public:
    // Throws NumericalError unless n is a positive multiple of 4.
    explicit TilePositions(int n);
    // The same continued by `margin` parts beyond the tile on each side. Throws NumericalError
    // unless all of them, n() = n + 2 margin a side, are a positive multiple of 4.
    TilePositions(int n, int margin);

    int n() const { return n_; }
    // Across the tile, -0.5 to 0.5 (a margin beyond): block by block, row by row within a block.
    const float* s() const { return s_.data(); }
    const float* t() const { return t_.data(); }

    // Of the blocks' centres, in the blocks' order, continued to a multiple of 16.
    const float* block_s() const { return block_s_.data(); }
    const float* block_t() const { return block_t_.data(); }
    // From a block's centre to its outermost points, in s and in t.
    float block_reach() const { return block_reach_; }

private:
    int n_;
    float block_reach_;
    std::vector<float> s_, t_, block_s_, block_t_;
};

// E: the average over the whole aperture at each point. `values`: n x n, row by row.
// CPU time of a point with AVX-512 about 1.4 ns, 1 ns per line that cuts the aperture of a point
// near it and 0.7 ns per crossing of two such lines; AVX2 a third more.
void exact_lens_samples(const TileGeometry& geometry, const TilePositions& positions,
                        float* values);

// C: the average over each part, a parallelogram with the sides of the polynomials' derivatives, of
// what some points of the aperture see; their weights' sum must be 1.
void exact_area_samples(const TileGeometry& geometry, const TilePositions& positions,
                        std::span<const UnitLensPoint> lens_points, float* values);

// The averages over the tile's 4 x 4 pixels of what the table's spread makes of the light: of a
// geometry in sensor px (set_sensor_geometry()) with all lines within the table's reach.
// CPU time of a tile with AVX-512 about 0.1 us per line, 0.3 us per crossing and 0.7 us for every
// pixel less than 1.5 px from one.
void wedge_pixels(const TileGeometry& geometry, const TilePositions& positions,
                  const WedgeRows& table, float* values);

// Highway's name of the instruction set in use: "AVX3" (AVX-512), "AVX2", "SSE4", "SSSE3",
// "SCALAR", ...
const char* tile_kernel_target();

}  // namespace etalon
