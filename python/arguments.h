// Functions and classes of the module. An argument that cannot be taken is a TypeError with its
// name: "marker: must be Marker, is str". pybind11 itself would list the whole signature.
#pragma once

#include <fmt/format.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <functional>
#include <limits>

namespace etalon {

namespace py = pybind11;
using namespace py::literals;

template <class>
inline constexpr bool is_optional = false;
template <class T>
inline constexpr bool is_optional<std::optional<T>> = true;

// pybind11's words for a type, with the names of its classes: `Optional[Tuple[int, int]]`,
// `Marker`.
std::string type_words(const char* words, const std::type_info* const* classes);
// What a person has to see of a wrong argument: a number or text itself, else the type's name.
std::string given_words(py::handle given);

// What was given for an argument of type T. pybind11 knows no names while it converts arguments, so
// a conversion that fails is told later, by require().
template <class T>
class Argument {
    using Value = py::detail::intrinsic_t<T>;

public:
    void load(py::handle given, bool convert) {
        constexpr bool takes_none =
            std::is_pointer_v<T> || is_optional<Value> || std::is_same_v<Value, py::object>;
        given_ = given;
        try {
            is_taken_ = (takes_none || !given.is_none()) && caster_.load(given, convert);
        } catch (const py::reference_cast_error&) {  // None in a list of objects
            is_taken_ = false;
        }
    }
    // Throws TypeError.
    void require(const std::string& name) const {
        if (!is_taken_)
            throw py::type_error(
                fmt::format("{}: must be {}, is {}", name, words<T>(), given_words(given_)));
    }
    decltype(auto) value() { return py::detail::cast_op<T>(std::move(caster_)); }

private:
    template <class Wanted>
    static std::string words() {
        using Plain = py::detail::intrinsic_t<Wanted>;
        if constexpr (is_optional<Plain>) {
            return words<typename Plain::value_type>() + " or None";
        } else if constexpr (std::is_integral_v<Plain> && !std::is_same_v<Plain, bool>) {
            using Limits = std::numeric_limits<Plain>;
            return fmt::format("int from {} to {}", Limits::min(), Limits::max());
        } else {
            constexpr auto name = py::detail::make_caster<Wanted>::name;
            return type_words(name.text, name.types().data()) +
                   (std::is_pointer_v<Wanted> ? " or None" : "");
        }
    }

    py::detail::make_caster<T> caster_;
    py::handle given_;
    bool is_taken_ = false;
};

// ---- functions by their arguments' names

template <class Function>
struct SignatureOf : SignatureOf<decltype(&Function::operator())> {};
template <class Return, class... Given>
struct SignatureOf<Return (*)(Given...)> {
    using Type = Return (*)(Given...);
};
// A lambda's; a method's has its object before the others.
template <class Return, class Object, class... Given>
struct SignatureOf<Return (Object::*)(Given...)> {
    using Type = Return (*)(Given...);
    using OfMethod = Return (*)(Object&, Given...);
};
template <class Return, class Object, class... Given>
struct SignatureOf<Return (Object::*)(Given...) const> {
    using Type = Return (*)(Given...);
    using OfMethod = Return (*)(const Object&, Given...);
};

template <class Function, class Return, class... Given>
auto requiring(Function function, std::vector<std::string> names, Return (*)(Given...)) {
    return [function = std::move(function),
            names = std::move(names)](Argument<Given>&... given) -> Return {
        [[maybe_unused]] std::size_t index = 0;
        (given.require(names.at(index++)), ...);
        return std::invoke(function, given.value()...);
    };
}

// `extra`: what py::class_::def() takes; names stand in it in the function's order.
template <class Function, class... Extra>
auto by_name(Function function, std::vector<std::string> names, const Extra&... extra) {
    const auto add = [&](const auto& one) {
        if constexpr (std::is_base_of_v<py::arg, std::decay_t<decltype(one)>>)
            names.emplace_back(one.name);
    };
    (add(extra), ...);
    if constexpr (std::is_member_function_pointer_v<Function>)
        return requiring(function, std::move(names),
                         typename SignatureOf<Function>::OfMethod(nullptr));
    else
        return requiring(std::move(function), std::move(names),
                         typename SignatureOf<Function>::Type(nullptr));
}

class Module : public py::module_ {
public:
    explicit Module(const py::module_& module) : py::module_(module) {}

    template <class Function, class... Extra>
    Module& def(const char* name, Function function, const Extra&... extra) {
        py::module_::def(name, by_name(std::move(function), {}, extra...), extra...);
        return *this;
    }
};

// A class of Python: py::class_ with its read-only properties said in a line each. Its objects can
// be neither copied nor pickled unless etalon/copies.py says how.
template <class Type, class... Options>
class Bound : public py::class_<Type, Options...> {
public:
    using Base = py::class_<Type, Options...>;

    Bound(py::module_& module, const char* name, const char* doc) : Base(module, name, doc) {
        Base::def("__reduce_ex__",
                  [name = std::string(name)](const py::object&, const py::object&) -> py::object {
                      throw py::type_error(name + ": cannot be copied or pickled");
                  });
    }

    // `getter`: what std::invoke() calls with an object, a member for instance.
    template <class Getter>
    Bound& get(const char* name, const char* doc, Getter getter) {
        if constexpr (std::is_member_object_pointer_v<Getter>)
            Base::def_readonly(name, getter, doc);
        else
            Base::def_property_readonly(name, getter, doc);
        return *this;
    }
    // `make`: gives an object for the arguments.
    template <class Make, class... Extra>
    Bound& init(Make make, const Extra&... extra) {
        Base::def(py::init(by_name(std::move(make), {}, extra...)), extra...);
        return *this;
    }
    template <class Function, class... Extra>
    Bound& def(const char* name, Function function, const Extra&... extra) {
        if constexpr ((std::is_base_of_v<py::arg, Extra> || ...))
            Base::def(name, by_name(std::move(function), {"self"}, extra...), extra...);
        else
            Base::def(name, std::move(function), extra...);
        return *this;
    }
    template <class Function, class... Extra>
    Bound& def_static(const char* name, Function function, const Extra&... extra) {
        Base::def_static(name, by_name(std::move(function), {}, extra...), extra...);
        return *this;
    }
};

}  // namespace etalon

namespace pybind11::detail {

// Takes whatever is given.
template <class T>
class type_caster<etalon::Argument<T>> {
public:
    static constexpr auto name = make_caster<T>::name;
    template <class>
    using cast_op_type = etalon::Argument<T>&;

    bool load(handle given, bool convert) {
        argument_.load(given, convert);
        return true;
    }
    operator etalon::Argument<T>&() { return argument_; }

private:
    etalon::Argument<T> argument_;
};

}  // namespace pybind11::detail
