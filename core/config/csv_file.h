// The one reader of CSV files: a header, then a row a line, cells parted by commas. A byte order
// mark, CRLF, blanks around cells and empty lines make no difference. Cells are not quoted.
#pragma once

#include <fstream>

#include "core/config/strict_reader.h"

namespace etalon {

struct CsvRow {
    SourcePlace place;               // its file and line
    std::vector<std::string> cells;  // as many as the header has

    // Throws ConfigError at the row's place for a cell that is no finite number, or out of range.
    double number(std::size_t column, Range range = any_number) const;
    std::vector<double> numbers() const;  // all cells
};

struct CsvFile {
    SourcePlace place;  // of the header
    std::vector<std::string> header;
    std::vector<CsvRow> rows;

    // Throws ConfigError for a name that the header lacks.
    std::size_t column(std::string_view name) const;
};

// Reads a file of any length row by row: one is in memory.
class CsvReader {
public:
    // Throws as read_csv() for what is wrong with the header.
    CsvReader(const std::filesystem::path& path,
              std::initializer_list<std::string_view> headers = {},
              std::uintmax_t most_bytes = std::numeric_limits<std::uintmax_t>::max());

    const SourcePlace& place() const { return place_; }  // of the header
    const std::vector<std::string>& header() const { return header_; }

    // Nothing behind the last row. Throws as read_csv(), and for a line longer than 64 KiB.
    std::optional<CsvRow> next();

private:
    bool next_line();

    SourcePlace place_;
    std::ifstream file_;
    int number_ = 0;
    std::string line_;
    std::vector<std::string> header_;
};

// Throws ConfigError with file and line when the file cannot be read, is larger than 64 MiB, not
// UTF-8, holds a control character, has none of `headers` (any if empty), or a row of another
// length.
CsvFile read_csv(const std::filesystem::path& path,
                 std::initializer_list<std::string_view> headers = {});

}  // namespace etalon
