// Whether a camera sees a marker at a pose, from geometry alone.
#pragma once

#include "calib/camera/projector.h"
#include "core/geometry/rigid.h"
#include "sim/marker/cell_grid.h"

namespace etalon {

// True when all of the marker's front is before the lens and seen by all of the lens, and the
// grid's outline keeps `margin_px` from the centres of the image's outermost pixels. Looked at are
// the grid's corners, and where distortion bends the edges between them also seven points along
// each edge (an edge that bulges out by b px may then come nearer by b / 64). Throws NumericalError
// when the camera's lens section is of no lens. Safe from every thread; 0.3 us, with distortion
// 1.5 us.
bool is_in_view(const Projector& projector, const CellGrid& grid, const Rigid& camera_from_marker,
                double margin_px);

}  // namespace etalon
