#include "report/csv.h"

#include "core/file/text.h"

namespace etalon {

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
