// Whether a camera sees a marker at a pose, from geometry alone.
#pragma once

#include "calib/projector.h"
#include "core/rigid.h"
#include "sim/cell_grid.h"

namespace etalon {

// The whole front in front of the lens, seen by all of it, and the grid's corners inside the image
// by `margin_px`. Safe from every thread; a microsecond.
bool is_in_view(const Projector& projector, const CellGrid& grid, const Rigid& camera_from_marker,
                double margin_px);

}  // namespace etalon
