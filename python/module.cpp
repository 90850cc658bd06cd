// The compiled part of the package `etalon`; errors become the exceptions of etalon/errors.py.
#include "core/program/errors.h"

#include "core/program/version.h"
#include "python/arrays.h"

namespace etalon {
namespace {

template <class... Parts>
void raise(const char* type, const std::exception& error, const Parts&... parts) {
    const py::object exception = py::module_::import("etalon.errors").attr(type);
    PyErr_SetObject(exception.ptr(), exception(error.what(), parts...).ptr());
}

void translate(std::exception_ptr thrown) {
    try {
        std::rethrow_exception(thrown);
    } catch (const ConfigError& error) {
        const SourcePlace& place = error.place();
        raise("ConfigError", error, place.file, place.line, place.key);
    } catch (const DeviceError& error) {
        raise("DeviceError", error, error.device(), error.request(), error.cause());
    } catch (const NumericalError& error) {
        raise("NumericalError", error);
    } catch (const Interrupted& error) {
        raise("Interrupted", error);
    } catch (const Error& error) {
        raise("Error", error);
    }
}

}  // namespace
}  // namespace etalon

PYBIND11_MODULE(_etalon, compiled) {
    using namespace etalon;
    Module module(compiled);
    module.attr("__version__") = version;
    py::register_exception_translator(translate);
    for (const auto bind :
         {bind_transforms, bind_camera, bind_marker, bind_render, bind_detect, bind_photometric,
          bind_calibrate, bind_compare, bind_devices, bind_station, bind_study, bind_twin})
        bind(module);
}
