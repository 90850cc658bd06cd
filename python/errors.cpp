// The errors of core/program/errors.h as the exceptions of etalon/errors.py.
#include "core/program/errors.h"

#include <pybind11/pybind11.h>

#include "python/arrays.h"

namespace etalon {
namespace {

namespace py = pybind11;

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

void bind_errors() {
    py::register_exception_translator(translate);
}

}  // namespace etalon
