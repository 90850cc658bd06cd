#include "sim/tiles/wedge_lines.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/tiles/undistortion_map.h"

namespace etalon {
namespace {

// The second derivative of a tile's polynomial across a line, at the tile's middle, by px^2.
float bend_across(const std::array<float, 16>& c, const TileLine& line) {
    const float x = line.gradient_x, y = line.gradient_y;
    return 2.0f * (c[2] * x * x + c[5] * x * y + c[8] * y * y) / (tile_px * tile_px);
}

// The table's directions are those of half a right angle; the others are mirrored.
bool is_mirrored(const TileLine& line) {
    return ((line.gradient_x < 0.0f) != (line.gradient_y < 0.0f)) !=
           (std::abs(line.gradient_y) > std::abs(line.gradient_x));
}

}  // namespace

WedgeLine::WedgeLine(const TileGeometry& tile, const TileLine& tile_line) : line(tile_line) {
    const float x = line.gradient_x, y = line.gradient_y;
    const float flat = std::min(std::abs(x), std::abs(y)),
                steep = std::max(std::abs(x), std::abs(y));
    blur_scale = std::hypot(line.blur_x, line.blur_y);
    blur_across = blur_scale * (tile.blur_slope_x * x + tile.blur_slope_y * y);
    asymmetry = blur_across -
                (tile.lens_turn_x * line.blur_x + tile.lens_turn_y * line.blur_y) / blur_scale;
    rows_along = static_cast<float>(WedgeTable::rows_per_px) * blur_scale *
                 (tile.blur_slope_y * x - tile.blur_slope_x * y) *
                 (is_mirrored(line) ? -1.0f : 1.0f);
    bend = x * bend_across(tile.dx, line) + y * bend_across(tile.dy, line);
    direction = 4.0f * static_cast<float>(WedgeTable::directions) / std::numbers::pi_v<float> *
                std::atan2(flat, steep);
    extent = flat + steep;
    per_chord = steep;
}

WedgeAngle::WedgeAngle(const TileLine& a, const TileLine& b)
    : cosine(a.gradient_x * b.gradient_x + a.gradient_y * b.gradient_y),
      inverse_sine(1.0f / std::max(1e-3f, std::abs(a.gradient_x * b.gradient_y -
                                                   a.gradient_y * b.gradient_x))) {}

}  // namespace etalon
