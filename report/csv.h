// The CSV files that commands write, row by row. A result whose columns are described once:
// report/result_table.h.
#pragma once

#include <optional>
#include <string>

#include "report/result_table.h"

namespace etalon {

// A table by columns, so that a cell cannot lose its heading: the first row's make the header.
class CsvTable {
public:
    void text(const std::string& column, const std::string& value);
    // Unrounded; empty where there is none.
    void number(const std::string& column, const std::optional<double>& value);
    // Six columns: rotation vector in rad, then translation in mm.
    void pose(const std::string& prefix, const std::optional<Rigid>& pose);
    void end_row();
    std::string finish() const { return header_ + "\n" + rows_; }

private:
    std::string header_, row_, rows_;
    bool is_first_row_ = true, row_is_empty_ = true;
};

}  // namespace etalon
