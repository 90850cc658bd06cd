// The compiled part of the package `etalon`.
#include <pybind11/pybind11.h>

#include "core/program/version.h"
#include "python/arrays.h"

PYBIND11_MODULE(_etalon, module) {
    module.attr("__version__") = etalon::version;
    etalon::bind_errors();
    etalon::bind_transforms(module);
    etalon::bind_camera(module);
    etalon::bind_marker(module);
    etalon::bind_render(module);
    etalon::bind_detect(module);
    etalon::bind_photometric(module);
    etalon::bind_calibrate(module);
    etalon::bind_compare(module);
    etalon::bind_devices(module);
    etalon::bind_station(module);
    etalon::bind_study(module);
    etalon::bind_twin(module);
}
