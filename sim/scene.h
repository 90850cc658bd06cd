// What is before the camera: flat markers at their poses, and what shows behind them.
#pragma once

#include <vector>

#include "core/image.h"
#include "core/rigid.h"
#include "sim/cell_grid.h"

namespace etalon {

struct PlacedMarker {
    CellGrid grid;
    Rigid camera_from_marker;
};

struct Scene {
    std::vector<PlacedMarker> markers;
    double background = 1.0;  // radiance everywhere outside the grids
};

}  // namespace etalon
