// Which numbers are allowed in a file: the physical ranges of all units, in one table.
#pragma once

#include <array>
#include <limits>
#include <string>
#include <string_view>

namespace etalon {

// The bounds themselves are allowed unless `open_low`.
struct Range {
    double low = -std::numeric_limits<double>::infinity();
    double high = std::numeric_limits<double>::infinity();
    bool open_low = false;
    const char* unit = "";

    // False for what is not a number.
    bool contains(double value) const;
    // "greater than 0", "between 0.001 and 1e+06 um".
    std::string words() const;
};
inline constexpr Range any_number{};
inline constexpr Range positive{0.0, std::numeric_limits<double>::infinity(), true};
inline constexpr Range non_negative{0.0};

// A unit in which files give numbers. What lies beyond these sizes is a slip of the pen, or meant
// to make something overflow; the table is in docs/files.md too, which a test compares.
struct Unit {
    const char* name;
    double least, most;  // size, of numbers that must not be 0

    constexpr Range positive() const { return {least, most, false, name}; }
    constexpr Range non_negative() const { return {0.0, most, false, name}; }
    constexpr Range either_sign() const { return {-most, most, false, name}; }
};

namespace units {
inline constexpr Unit mm{"mm", 1e-6, 1e7};
inline constexpr Unit um{"um", 1e-3, 1e6};
inline constexpr Unit nm{"nm", 10.0, 1e5};
inline constexpr Unit px{"px", 1e-6, 1e7};
inline constexpr Unit deg{"deg", 1e-6, 1e5};
inline constexpr Unit mrad{"mrad", 1e-6, 1e4};
inline constexpr Unit urad{"urad", 1e-3, 1e6};
inline constexpr Unit mm_per_s{"mm/s", 1e-4, 1e5};
inline constexpr Unit deg_per_s{"deg/s", 1e-4, 1e5};
inline constexpr Unit s{"s", 1e-6, 1e9};
inline constexpr Unit us{"us", 1e-3, 1e9};
inline constexpr Unit hz{"Hz", 1e-3, 1e6};
inline constexpr Unit ppm{"ppm", 1e-3, 1e5};
inline constexpr Unit kelvin{"K", 1e-4, 1e3};
inline constexpr Unit percent{"%", 1e-6, 1e4};
inline constexpr Unit gray{"gray", 1e-6, 255.0};
inline constexpr Unit electrons{"e", 1e-6, 1e9};
inline constexpr Unit counts{"counts", 1e-3, 1e10};
inline constexpr Unit f_number{"f-number", 0.1, 1e3};
inline constexpr Unit one{"1", 1e-12, 1e12};  // without a unit, or in one of a device's own
inline constexpr std::array all{mm,       um,        nm,        px,     deg,      mrad, urad,
                                mm_per_s, deg_per_s, s,         us,     hz,       ppm,  kelvin,
                                percent,  gray,      electrons, counts, f_number, one};
}  // namespace units

// Of `units::all`; the name must be there.
const Unit& unit_named(std::string_view name);

}  // namespace etalon
