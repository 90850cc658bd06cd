#include "calib/files/foreign_value.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include "core/config/yaml_text.h"
#include "core/file/text.h"

namespace etalon {

ForeignValue::ForeignValue(const YAML::Node& node, SourcePlace place)
    : node_(std::make_shared<YAML::Node>(node)), place_(std::move(place)) {}

ForeignValue ForeignValue::parse(const std::string& text, const std::string& file) {
    const YAML::Node root = parse_yaml(text, file);
    if (text.starts_with("Model = CAHV"))
        throw ConfigError({file, 1},
                          "is a CAHV, CAHVOR or CAHVORE file of JPL, which is not read: "
                          "mrcal-from-cahvor makes a .cameramodel of it, which is");
    if (!root.IsMap())
        throw ConfigError({file, 1}, "is no camera calibration of a known format");
    return {root, {file, 1}};
}

std::optional<ForeignValue> ForeignValue::find(std::string_view key) const {
    if (!node_->IsMap())
        fail("must be a mapping (key: value)");
    SourcePlace place = place_;
    place.key += (place.key.empty() ? "" : ".") + std::string(key);
    std::optional<YAML::Node> found;
    for (const auto& entry : *node_) {
        if (!entry.first.IsScalar() || entry.first.Scalar() != key)
            continue;
        place.line = entry.first.Mark().line + 1;
        if (found)
            throw ConfigError(place, "doubled key");
        found.emplace(entry.second);
    }
    if (!found || found->IsNull())
        return std::nullopt;
    return ForeignValue(*found, place);
}

ForeignValue ForeignValue::at(std::string_view key) const {
    if (const auto found = find(key))
        return *found;
    SourcePlace place = place_;
    place.key += (place.key.empty() ? "" : ".") + std::string(key);
    throw ConfigError(place, "missing");
}

std::vector<std::string> ForeignValue::keys() const {
    if (!node_->IsMap())
        fail("must be a mapping (key: value)");
    std::vector<std::string> keys;
    for (const auto& entry : *node_)
        keys.push_back(entry.first.IsScalar() ? entry.first.Scalar() : "");
    return keys;
}

double ForeignValue::number() const {
    const auto value = node_->IsScalar() ? parse_number(node_->Scalar()) : std::nullopt;
    if (!value)
        fail("must be a finite number");
    return *value;
}

std::string ForeignValue::text() const {
    if (!node_->IsScalar())
        fail("must be a word");
    return node_->Scalar();
}

std::vector<double> ForeignValue::numbers() const {
    if (!node_->IsSequence())
        fail("must be a list of numbers");
    std::vector<double> numbers;
    for (const YAML::Node& item : *node_)
        numbers.push_back(ForeignValue(item, place_).number());
    return numbers;
}

std::vector<double> ForeignValue::numbers(std::size_t count) const {
    std::vector<double> list = numbers();
    if (list.size() != count)
        fail(fmt::format("must have {} numbers, not {}", count, list.size()));
    return list;
}

std::vector<std::vector<double>> ForeignValue::rows() const {
    if (!node_->IsSequence())
        fail("must be a list of rows");
    std::vector<std::vector<double>> rows;
    for (const YAML::Node& row : *node_)
        rows.push_back(ForeignValue(row, place_).numbers());
    return rows;
}

void ForeignValue::fail(const std::string& message) const {
    throw ConfigError(place_, message);
}

ForeignMatrix matrix_of_rows(const ForeignValue& value, std::size_t rows, std::size_t cols) {
    ForeignMatrix matrix{value.place(), static_cast<int>(rows), static_cast<int>(cols), {}};
    const auto lists = value.rows();
    if (lists.size() != rows)
        value.fail(fmt::format("must have {} rows, not {}", rows, lists.size()));
    for (const std::vector<double>& row : lists) {
        if (row.size() != cols)
            value.fail(fmt::format("must have rows of {} numbers, not {}", cols, row.size()));
        matrix.values.insert(matrix.values.end(), row.begin(), row.end());
    }
    return matrix;
}

}  // namespace etalon
