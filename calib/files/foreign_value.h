// A value in a YAML or JSON file of another program, with its place. Keys that nobody asks for are
// ignored: such files hold more than a camera. Doubled keys (yaml-cpp lets the first win), missing
// ones, wrong types and numbers that are not finite are ConfigErrors with file, line and key.
//
// For files of ours there is core/config/strict_reader.h. Cheap to copy.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/files/foreign_camera.h"
#include "core/program/errors.h"

namespace YAML {
class Node;
}

namespace etalon {

class ForeignValue {
public:
    // The mapping that the text must be; `file` names it in errors.
    static ForeignValue parse(const std::string& text, const std::string& file);

    // Of a mapping: a required key, an optional one (null counts as absent), all keys.
    ForeignValue at(std::string_view key) const;
    std::optional<ForeignValue> find(std::string_view key) const;
    std::vector<std::string> keys() const;

    double number() const;
    std::string text() const;
    std::vector<double> numbers() const;                   // a list, maybe empty
    std::vector<double> numbers(std::size_t count) const;  // of exactly so many
    std::vector<std::vector<double>> rows() const;         // a list of lists

    const SourcePlace& place() const { return place_; }
    [[noreturn]] void fail(const std::string& message) const;

private:
    ForeignValue(const YAML::Node& node, SourcePlace place);

    std::shared_ptr<YAML::Node> node_;
    SourcePlace place_;
};

// `rows` lists of `cols` numbers.
ForeignMatrix matrix_of_rows(const ForeignValue& value, std::size_t rows, std::size_t cols);

}  // namespace etalon
