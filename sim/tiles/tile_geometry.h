// From a marker and a tile's place on the sensor to the numbers that the tile kernels work on.
#pragma once

#include "sim/scene/marker_view.h"
#include "sim/tiles/tile_kernel.h"
#include "sim/tiles/undistortion_map.h"

namespace etalon {

// Radiances are differences from the view's background; px are 1/fx. Overwrites `geometry`, which
// keeps its memory from tile to tile.
void set_tile_geometry(const MarkerView& view, const TilePolynomial& place, const CellRange& range,
                       double fx, TileGeometry& geometry);

// The same for averages over the aperture and over a disk around the point, `radius_px` pitches
// along x on the sensor (the mean over some cosines, see TileGeometry). Without the lens: over the
// disk alone, seen from the lens centre. `pitch_y` is a pixel's height by its width.
void set_disk_geometry(const MarkerView& view, const TilePolynomial& place, const CellRange& range,
                       bool with_lens, double radius_px, double pitch_y, TileGeometry& geometry);

// In sensor px (pitches along x), where a spread is round; the lines know by how much the blur is
// not.
void set_sensor_geometry(const MarkerView& view, const TilePolynomial& place,
                         const CellRange& range, double pitch_y, TileGeometry& geometry);

}  // namespace etalon
