// Scenes from Python, for whoever renders.
#pragma once

#include "python/arrays.h"
#include "sim/marker/marker.h"
#include "sim/scene/scene.h"

namespace etalon {

// A list of (Marker, camera_from_marker (4, 4)).
Scene scene_of(const py::object& markers, double background);

}  // namespace etalon
