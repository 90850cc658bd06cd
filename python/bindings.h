// What each file of this folder adds to the module `etalon`: the functions and classes of one room.
// What they do, with shapes, units, frames and errors, is in etalon/__init__.pyi and
// docs/python.md.
#pragma once

#include <pybind11/pybind11.h>

namespace etalon {

void bind_errors();
void bind_transforms(pybind11::module_& module);
void bind_camera(pybind11::module_& module);
void bind_marker(pybind11::module_& module);
void bind_render(pybind11::module_& module);
void bind_detect(pybind11::module_& module);
void bind_photometric(pybind11::module_& module);
void bind_calibrate(pybind11::module_& module);
void bind_compare(pybind11::module_& module);
void bind_devices(pybind11::module_& module);
void bind_station(pybind11::module_& module);
void bind_study(pybind11::module_& module);
void bind_twin(pybind11::module_& module);

}  // namespace etalon
