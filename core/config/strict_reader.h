// The one reader for every YAML or JSON file of this project: nothing is guessed, defaulted or
// ignored silently. Unknown, doubled and missing keys, wrong types, numbers that are not finite or
// out of range are ConfigErrors with file, line and dotted key.
//
//     StrictFile file("camera.yml", "camera/1");
//     const Value intrinsics = file.root().at("intrinsics");
//     const double fx = intrinsics.at("fx").number(units::px.positive());
//     file.finish();                       // throws if any key was never asked for
//
// Not for foreign files with keys of their own (OpenCV, ROS): see calib/. Not thread-safe.
#pragma once

#include <filesystem>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/config/range.h"
#include "core/program/errors.h"

namespace YAML {
class Node;
}

namespace etalon {

class StrictFile;
struct ReadEvent;

// One value of a file, with its place. Cheap to copy; outlives its file object.
class Value {
public:
    // Of a mapping: a required key, an optional one, all keys in file order.
    Value at(std::string_view key) const;
    std::optional<Value> find(std::string_view key) const;
    std::vector<std::string> keys() const;
    // The same mapping; what is looked up through it are names that the file itself gives, of its
    // axes for instance, and no words of ours (core/config/read_trace.h).
    Value with_names() const;

    // Of an optional key, 0 without it.
    double number_or_zero(std::string_view key, Range range) const;

    // Of a list.
    std::vector<Value> items() const;

    // Of a scalar. A quoted number is text, not a number. What has a unit has the range of that
    // unit (core/config/range.h).
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

// True if the file declares itself one of ours (`etalon: ...`), whatever else is wrong with it.
// Foreign files need not be YAML: only the beginning is looked at.
bool is_etalon_file(const std::filesystem::path& path);

}  // namespace etalon
