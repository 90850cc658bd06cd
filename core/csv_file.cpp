#include "core/csv_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "core/text.h"

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

CsvFile read_csv(const std::filesystem::path& path,
                 std::initializer_list<std::string_view> headers) {
    const std::vector<std::string> lines = split(read_text(path), '\n');
    CsvFile file{{path.string(), 1}, cells_of(lines.front()), {}};
    const std::string header = fmt::format("{}", fmt::join(file.header, ","));
    if (headers.size() > 0 && std::ranges::find(headers, header) == headers.end())
        throw ConfigError(file.place,
                          fmt::format("the first line must be '{}'", fmt::join(headers, "' or '")));
    for (std::size_t i = 1; i < lines.size(); ++i) {
        if (trimmed(lines[i]).empty())
            continue;
        const SourcePlace place{path.string(), static_cast<int>(i) + 1};
        CsvRow row{place, cells_of(lines[i])};
        if (row.cells.size() != file.header.size())
            throw ConfigError(place, fmt::format("has {} cells, not the header's {}",
                                                 row.cells.size(), file.header.size()));
        file.rows.push_back(std::move(row));
    }
    return file;
}

}  // namespace etalon
