#include "compare/verdict/limits_file.h"

#include "core/strict_reader.h"

namespace etalon {
namespace {

double limit_of(const Value& quantity, std::string_view unit) {
    const double limit = quantity.at("limit").number(positive);
    quantity.at("unit").one_of({unit});
    return limit;
}

std::optional<double> optional_limit_of(const Value& root, std::string_view key,
                                        std::string_view unit) {
    const std::optional<Value> quantity = root.find(key);
    if (!quantity)
        return std::nullopt;
    return limit_of(*quantity, unit);
}

}  // namespace

Limits read_limits(const std::filesystem::path& path) {
    const StrictFile file(path, "limits/1");
    const Value root = file.root();
    Limits limits;
    limits.id = root.at("id").text();
    if (limits.id.empty())
        root.at("id").fail("is empty");
    limits.b3_position_field_rms_mm = limit_of(root.at(quantity::position_rms), "mm");
    limits.b3_position_field_max_mm = limit_of(root.at(quantity::position_max), "mm");
    limits.b3_rotation_field_rms_mrad = optional_limit_of(root, quantity::rotation_rms, "mrad");
    limits.b3_rotation_field_max_mrad = optional_limit_of(root, quantity::rotation_max, "mrad");
    limits.b3_position_rest_rms_mm = optional_limit_of(root, quantity::rest_rms, "mm");
    limits.b3_length_error_max_mm = optional_limit_of(root, quantity::length_max, "mm");
    limits.b4_position_field_rms_mm = optional_limit_of(root, quantity::photometric_rms, "mm");
    limits.b4_position_field_max_mm = optional_limit_of(root, quantity::photometric_max, "mm");
    file.finish();
    return limits;
}

}  // namespace etalon
