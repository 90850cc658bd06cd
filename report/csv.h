// The CSV files that commands write: tables by columns, and text in their cells.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "core/geometry/rigid.h"

namespace etalon {

// Text with commas, quotes or line ends is quoted (RFC 4180, section 2).
std::string csv_text(const std::string& text);

// What csv_text() was given.
std::string text_of_csv(std::string_view field);

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
