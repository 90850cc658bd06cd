// At most 32 x 32 lines of a tile, without those that change nothing: what the kernels work on, so
// that their memory is fixed. The sum over a tile's patches is that over its lines and crossings.
#pragma once

#include <algorithm>

#include "sim/tiles/tile_kernel.h"

namespace etalon {

// Some consecutive lines of a patch.
struct PatchPart {
    std::size_t first_column, end_column, first_row, end_row;

    bool has_no_line() const { return first_column == end_column && first_row == end_row; }
};

struct TilePatch {
    static constexpr std::size_t capacity = 32;

    std::size_t column_count = 0, row_count = 0;
    std::array<TileLine, capacity> columns, rows;
    std::array<std::array<float, capacity>, capacity> mixed;  // [row][column]
    // What the cells between the lines add: of a ray beyond the first j row lines and the first i
    // column lines, at [j][i].
    std::array<std::array<float, capacity + 1>, capacity + 1> cells;

    // Whether a line's cells differ anywhere in the part.
    bool column_counts(const PatchPart& part, std::size_t column) const {
        bool differ = false;
        for (std::size_t row = part.first_row; row <= part.end_row; ++row)
            differ |= cells[row][column] != cells[row][column + 1];
        return differ;
    }
    bool row_counts(const PatchPart& part, std::size_t row) const {
        bool differ = false;
        for (std::size_t column = part.first_column; column <= part.end_column; ++column)
            differ |= cells[row][column] != cells[row + 1][column];
        return differ;
    }
};

// The patch of the column lines from `first_column` and the row lines from `first_row` on. Only
// the first patch of a column (row) has its contrast.
TilePatch make_tile_patch(const TileGeometry& geometry, std::size_t first_column,
                          std::size_t first_row);

// Fills the n x n values with the first cell's and calls add(patch) for every patch of the tile.
template <class Add>
void sum_patches(const TileGeometry& tile, int n, float* values, Add add) {
    std::fill_n(values, n * n, static_cast<float>(tile.cells.front() - tile.background));
    // One patch at least in each direction: there may be lines of the other alone.
    for (std::size_t j = 0; j == 0 || j < tile.rows.size(); j += TilePatch::capacity)
        for (std::size_t i = 0; i == 0 || i < tile.columns.size(); i += TilePatch::capacity) {
            const TilePatch patch = make_tile_patch(tile, i, j);
            if (patch.column_count + patch.row_count > 0)
                add(patch);
        }
}

// The total degree, 2, 3 or 6, beyond which the polynomials of dx and dy have no term larger than
// single precision's rounding of a few px.
int significant_degree(const TileGeometry& geometry);

// How a block of points differs at most from its centre.
struct BlockBounds {
    float reach;        // of (dx, dy), px
    float blur_change;  // of the blur radius, px
    float turn;         // |turn|
};

BlockBounds block_bounds(const TileGeometry& geometry, const TilePositions& positions);

// The shapes of a tile's n x n parts: their sides, in px, as polynomials of s and t in the order of
// TileGeometry; and bounds of how a line changes across them.
struct PartShapes {
    std::array<float, 16> x_by_s{}, y_by_s{}, x_by_t{}, y_by_t{};
    float turn;      // |turn|
    float steepest;  // the largest |gradient| by (dx, dy) of D + w . l
};

PartShapes part_shapes(const TileGeometry& geometry, int n);

}  // namespace etalon
