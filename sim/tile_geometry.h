// From a marker and a tile's place on the sensor to the numbers that the tile kernels work on.
#pragma once

#include "sim/marker_view.h"
#include "sim/tile_kernel.h"
#include "sim/undistortion_map.h"

namespace etalon {

// Radiances are differences from the view's background; px are 1/fx. Overwrites `geometry`, which
// keeps its memory from tile to tile.
void set_tile_geometry(const MarkerView& view, const TilePolynomial& place, const CellRange& range,
                       double fx, TileGeometry& geometry);

}  // namespace etalon
