#include "report/csv.h"

#include "core/file/text.h"

namespace etalon {

std::string csv_text(const std::string& text) {
    if (text.find_first_of(",\"\r\n") == std::string::npos)
        return text;
    std::string quoted = "\"";
    for (const char c : text)
        quoted += c == '"' ? "\"\"" : std::string(1, c);
    return quoted + "\"";
}

std::string text_of_csv(std::string_view field) {
    if (!field.starts_with('"'))
        return std::string(field);
    std::string text;
    for (std::size_t i = 1; i + 1 < field.size(); ++i) {
        text += field[i];
        i += field[i] == '"';
    }
    return text;
}

void CsvTable::text(const std::string& column, const std::string& value) {
    if (is_first_row_)
        header_ += (header_.empty() ? "" : ",") + column;
    row_ += (row_is_empty_ ? "" : ",") + csv_text(value);
    row_is_empty_ = false;
}

void CsvTable::number(const std::string& column, const std::optional<double>& value) {
    text(column, value ? exact(*value) : std::string());
}

void CsvTable::pose(const std::string& prefix, const std::optional<Rigid>& pose) {
    constexpr const char* components[] = {"rx", "ry", "rz", "tx", "ty", "tz"};
    for (int i = 0; i < 6; ++i)
        number(prefix + components[i],
               pose ? std::optional(vector_from_rigid(*pose)[i]) : std::nullopt);
}

void CsvTable::end_row() {
    rows_ += row_ + "\n";
    row_.clear();
    row_is_empty_ = true;
    is_first_row_ = false;
}

}  // namespace etalon
