#include "python/arguments.h"

namespace etalon {

std::string type_words(const char* words, const std::type_info* const* classes) {
    std::string text;
    for (; *words != '\0'; ++words)
        if (*words != '%')
            text += *words;
        else if (const py::handle type = py::detail::get_type_handle(**classes++, false))
            text += type.attr("__name__").cast<std::string>();
    return text;
}

std::string given_words(py::handle given) {
    constexpr std::size_t most = 40;
    const auto type = py::type::handle_of(given).attr("__name__").cast<std::string>();
    if (!PyLong_Check(given.ptr()) && !PyFloat_Check(given.ptr()) && !PyUnicode_Check(given.ptr()))
        return type;
    const auto text = py::reinterpret_steal<py::object>(PyObject_ASCII(given.ptr()));
    if (!text) {  // an int of thousands of digits
        PyErr_Clear();
        return type;
    }
    const auto shown = text.cast<std::string>();
    return shown.size() <= most ? shown : type;
}

}  // namespace etalon
