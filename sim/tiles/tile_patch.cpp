#include "sim/tiles/tile_patch.h"

#include <fmt/format.h>

#include <cmath>

#include "core/program/errors.h"

namespace etalon {
namespace {

// The largest magnitude, over the tile, that the terms beyond a total degree can add up to.
float largest_beyond(const std::array<float, 16>& polynomial, std::size_t degree) {
    constexpr std::array<float, 7> largest{1.0f,      1.0f / 2,  1.0f / 4, 1.0f / 8,
                                           1.0f / 16, 1.0f / 32, 1.0f / 64};
    float sum = 0.0f;
    for (std::size_t j = 0; j < 4; ++j)
        for (std::size_t i = 0; i < 4; ++i)
            if (i + j > degree)
                sum += std::abs(polynomial[4 * j + i]) * largest[i + j];
    return sum;
}

// The derivatives of a bicubic polynomial, times `scale`.
void differentiate(const std::array<float, 16>& c, float scale, std::array<float, 16>& by_s,
                   std::array<float, 16>& by_t) {
    for (std::size_t j = 0; j < 4; ++j)
        for (std::size_t i = 0; i < 4; ++i) {
            const float scaled = scale * c[4 * j + i];
            if (i > 0)
                by_s[4 * j + i - 1] = static_cast<float>(i) * scaled;
            if (j > 0)
                by_t[4 * (j - 1) + i] = static_cast<float>(j) * scaled;
        }
}

}  // namespace

TilePositions::TilePositions(int parts, int margin)
    : n(parts + 2 * margin), block_reach(1.5f / static_cast<float>(parts)) {
    if (parts < 1 || margin < 0 || n % 4 != 0)
        throw NumericalError(fmt::format("{} x {} points in a tile: not a multiple of 4", n, n));
    const auto place = [&](int i) {
        return (static_cast<float>(i - margin) + 0.5f) / static_cast<float>(parts) - 0.5f;
    };
    const auto middle = [&](int i) { return 0.5f * (place(i) + place(i + 3)); };
    for (int block_y = 0; block_y < n; block_y += 4)
        for (int block_x = 0; block_x < n; block_x += 4) {
            for (int i = 0; i < 16; ++i) {
                s.push_back(place(block_x + i % 4));
                t.push_back(place(block_y + i / 4));
            }
            block_s.push_back(middle(block_x));
            block_t.push_back(middle(block_y));
        }
    const std::size_t whole = (block_s.size() + 15) / 16 * 16;
    block_s.resize(whole, block_s.back());
    block_t.resize(whole, block_t.back());
}

TilePatch make_tile_patch(const TileGeometry& geometry, std::size_t first_column,
                          std::size_t first_row) {
    const std::size_t columns = geometry.columns.size(), rows = geometry.rows.size();
    const std::size_t end_column = std::min(first_column + TilePatch::capacity, columns);
    const std::size_t end_row = std::min(first_row + TilePatch::capacity, rows);
    const auto cell = [&](std::size_t row, std::size_t column) {
        return geometry.cells[row * (columns + 1) + column];
    };
    const auto mixed = [&](std::size_t row, std::size_t column) {
        return static_cast<float>((cell(row + 1, column + 1) - cell(row + 1, column)) -
                                  (cell(row, column + 1) - cell(row, column)));
    };
    TilePatch patch;
    patch.cells[0][0] = 0.0f;
    std::array<std::size_t, TilePatch::capacity> kept;  // column lines
    for (std::size_t i = first_column; i < end_column; ++i) {
        const auto contrast =
            first_row == 0 ? static_cast<float>(cell(0, i + 1) - cell(0, i)) : 0.0f;
        bool used = contrast != 0.0f;
        for (std::size_t j = first_row; j < end_row && !used; ++j)
            used = mixed(j, i) != 0.0f;
        if (!used)
            continue;
        kept[patch.column_count] = i;
        auto& first_row_of_cells = patch.cells[0];
        first_row_of_cells[patch.column_count + 1] =
            first_row_of_cells[patch.column_count] + contrast;
        patch.columns[patch.column_count++] = geometry.columns[i];
    }
    for (std::size_t j = first_row; j < end_row; ++j) {
        const auto contrast =
            first_column == 0 ? static_cast<float>(cell(j + 1, 0) - cell(j, 0)) : 0.0f;
        bool used = contrast != 0.0f;
        for (std::size_t i = 0; i < patch.column_count; ++i) {
            patch.mixed[patch.row_count][i] = mixed(j, kept[i]);
            used = used || mixed(j, kept[i]) != 0.0f;
        }
        if (!used)
            continue;
        const auto& before = patch.cells[patch.row_count];
        auto& beyond = patch.cells[patch.row_count + 1];
        beyond[0] = before[0] + contrast;
        for (std::size_t i = 0; i < patch.column_count; ++i)
            beyond[i + 1] =
                beyond[i] + (before[i + 1] - before[i]) + patch.mixed[patch.row_count][i];
        patch.rows[patch.row_count++] = geometry.rows[j];
    }
    return patch;
}

int significant_degree(const TileGeometry& geometry) {
    for (const std::size_t degree : {2, 3})
        if (largest_beyond(geometry.dx, degree) + largest_beyond(geometry.dy, degree) < 1e-7f)
            return static_cast<int>(degree);
    return 6;
}

BlockBounds block_bounds(const TileGeometry& geometry, const TilePositions& positions) {
    const float farthest = std::max(0.5f, -positions.s[0]);
    float x = 0.0f, y = 0.0f, power = 1.0f;  // by s and t together, degree by degree
    for (int degree = 1; degree <= 6; ++degree, power *= farthest)
        for (int j = std::max(0, degree - 3); j <= std::min(3, degree); ++j) {
            const auto term = static_cast<std::size_t>(4 * j + degree - j);
            x += static_cast<float>(degree) * power * std::abs(geometry.dx[term]);
            y += static_cast<float>(degree) * power * std::abs(geometry.dy[term]);
        }
    constexpr float rounding = 1.001f;
    const auto length = [](float a, float b) { return std::sqrt(a * a + b * b); };
    const float reach = rounding * positions.block_reach * length(x, y);
    return {reach, rounding * reach * length(geometry.blur_slope_x, geometry.blur_slope_y),
            std::min(1.0f, rounding * length(geometry.turn_x, geometry.turn_y))};
}

PartShapes part_shapes(const TileGeometry& geometry, int n) {
    PartShapes shapes;
    const float scale = 1.0f / static_cast<float>(n);
    differentiate(geometry.dx, scale, shapes.x_by_s, shapes.x_by_t);
    differentiate(geometry.dy, scale, shapes.y_by_s, shapes.y_by_t);
    shapes.turn = std::hypot(geometry.turn_x, geometry.turn_y);
    // D + w . l = D (1 - turn . l) + blur (gradient . l)
    shapes.steepest = 1.0f + shapes.turn + std::hypot(geometry.blur_slope_x, geometry.blur_slope_y);
    return shapes;
}

}  // namespace etalon
