// The one reader for every YAML or JSON file of this project: nothing is guessed, defaulted or
// ignored silently. Unknown, doubled and missing keys, wrong types, numbers that are not finite or
// out of range are ConfigErrors with file, line and dotted key.
//
//     StrictFile file("camera.yml", "camera/1");
//     const Value intrinsics = file.root().at("intrinsics");
//     const double fx = intrinsics.at("fx").number(units::px.positive());
//     file.finish();                       // throws if any key was never asked for
//
// Files of other tools are read with the same Value, see Value::of_foreign_file(). Not thread-safe.
#pragma once

#include <array>
#include <initializer_list>
#include <limits>
#include <memory>
#include <string_view>
#include <vector>

#include "core/program/errors.h"

namespace YAML {
class Node;
}

namespace etalon {

// Which numbers are allowed in a file: the physical ranges of all units, in one table.

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

class StrictFile;
struct ReadEvent;

// One value of a file, with its place. Cheap to copy; outlives its file object.
class Value {
public:
    // A YAML or JSON text of another program, named `file` in errors. Keys that nobody asks for are
    // ignored, a null counts as absent, a quoted number as a number. Throws as parse_yaml().
    static Value of_foreign_file(const std::string& text, const std::string& file);

    // Of a mapping: a required key, an optional one, all keys in file order.
    Value at(std::string_view key) const;
    std::optional<Value> find(std::string_view key) const;
    std::vector<std::string> keys() const;
    // The same mapping; keys looked up are names that the file gives (axes), no words of ours.
    Value with_names() const;

    // Of an optional key, 0 without it.
    double number_or_zero(std::string_view key, Range range) const;

    // Of a list.
    std::vector<Value> items() const;

    // Of a scalar. A quoted number is text. Text is one line without control characters: it is
    // printed beside words that programs read.
    double number(Range range) const;
    int integer(int low, int high) const;
    bool flag() const;  // true or false
    std::string text() const;
    std::string one_of(std::initializer_list<std::string_view> words) const;

    // A list of exactly `count` numbers; any length if `count` is 0.
    std::vector<double> numbers(std::size_t count, Range range) const;

    bool is_mapping() const;
    bool is_list() const;
    bool is_scalar() const;

    SourcePlace place() const;
    [[noreturn]] void fail(const std::string& message) const;

private:
    friend class StrictFile;
    struct Shared;
    Value(std::shared_ptr<YAML::Node> node, std::string path, std::shared_ptr<Shared> shared);

    Value child(const YAML::Node& node, std::string path) const;
    std::optional<Value> look_up(std::string_view key) const;
    double finite_number(Range range) const;
    std::string scalar() const;
    void note(ReadEvent event) const;

    std::shared_ptr<YAML::Node> node_;
    std::string path_;    // dotted, "plan.volume.x" or "axes[1].name"
    bool names_ = false;  // with_names()
    std::shared_ptr<Shared> shared_;
};

// A file that begins with `etalon: KIND`.
class StrictFile {
public:
    // Throws ConfigError when the file cannot be read or parsed, holds a key twice, or is not of
    // this kind; `kind` is for instance "camera/1".
    StrictFile(const std::filesystem::path& path, std::string_view kind);

    // The same for text that was not read from a file.
    static StrictFile from_text(const std::string& text, const std::string& name,
                                std::string_view kind);

    Value root() const { return root_; }

    // `relative` as a path seen from this file's folder.
    std::filesystem::path resolve(const std::string& relative) const;

    // Throws ConfigError for the first key that nobody asked for. Call it when all is read.
    void finish() const;

private:
    StrictFile(const std::string& text, const std::filesystem::path& path, std::string_view kind);

    std::filesystem::path path_;
    Value root_;
};

// Whether the beginning declares one of ours (`etalon: ...`). Foreign files need not be YAML.
bool is_etalon_file(const std::filesystem::path& path);

}  // namespace etalon
