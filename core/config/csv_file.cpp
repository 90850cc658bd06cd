#include "core/config/csv_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "core/file/text.h"

namespace etalon {
namespace {

std::vector<std::string> cells_of(std::string_view line) {
    std::vector<std::string> cells = split(line, ',');
    for (std::string& cell : cells)
        cell = trimmed(cell);
    return cells;
}

}  // namespace

double CsvRow::number(std::size_t column, Range range) const {
    const auto value = parse_number(cells[column]);
    if (!value)
        throw ConfigError(place, fmt::format("'{}' is not a finite number", cells[column]));
    if (!range.contains(*value))
        throw ConfigError(place, fmt::format("{} must be {}", *value, range.words()));
    return *value;
}

std::vector<double> CsvRow::numbers() const {
    std::vector<double> all;
    for (std::size_t i = 0; i < cells.size(); ++i)
        all.push_back(number(i));
    return all;
}

std::size_t CsvFile::column(std::string_view name) const {
    const auto found = std::ranges::find(header, name);
    if (found == header.end())
        throw ConfigError(place, fmt::format("the header lacks the column '{}'", name));
    return static_cast<std::size_t>(found - header.begin());
}

CsvReader::CsvReader(const std::filesystem::path& path,
                     std::initializer_list<std::string_view> headers, std::uintmax_t most_bytes)
    : place_{path.string(), 1}, file_(open_text(path, most_bytes)) {
    next_line();
    remove_byte_order_mark(line_);
    header_ = cells_of(line_);
    const std::string header = fmt::format("{}", fmt::join(header_, ","));
    if (headers.size() > 0 && std::ranges::find(headers, header) == headers.end())
        throw ConfigError(place_, fmt::format("the first line must be '{}', not '{:.200}'",
                                              fmt::join(headers, "' or '"), trimmed(line_)));
}

bool CsvReader::next_line() {
    constexpr std::streamsize longest = 64 * 1024;
    line_.resize(longest);
    file_.getline(line_.data(), longest);
    const SourcePlace place{place_.file, ++number_};
    if (file_.fail() && file_.gcount() == longest - 1)
        throw ConfigError(place, "is longer than 64 KiB");
    if (file_.fail()) {
        line_.clear();
        return false;
    }
    line_.resize(static_cast<std::size_t>(file_.gcount()) - (file_.eof() ? 0 : 1));
    require_utf8(line_, place);
    if (printable(line_, "\t\r") != line_)  // blanks around cells, line ends
        throw ConfigError(place, "holds a control character");
    return true;
}

std::optional<CsvRow> CsvReader::next() {
    while (next_line()) {
        if (trimmed(line_).empty())
            continue;
        CsvRow row{{place_.file, number_}, cells_of(line_)};
        if (row.cells.size() != header_.size())
            throw ConfigError(
                row.place,
                fmt::format("has {} cells, not the header's {}{}", row.cells.size(), header_.size(),
                            row.cells.size() > header_.size() ? "; a decimal point is a dot" : ""));
        return row;
    }
    return std::nullopt;
}

CsvFile read_csv(const std::filesystem::path& path,
                 std::initializer_list<std::string_view> headers) {
    CsvReader reader(path, headers, max_text_bytes);
    CsvFile file{reader.place(), reader.header(), {}};
    while (auto row = reader.next())
        file.rows.push_back(std::move(*row));
    return file;
}

}  // namespace etalon
