#include "report/result_table.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/file/text.h"
#include "report/number_text.h"

namespace etalon {
namespace {

template <class... Functions>
struct Overloaded : Functions... {
    using Functions::operator()...;
};
template <class... Functions>
Overloaded(Functions...) -> Overloaded<Functions...>;

// `number`: what a number becomes.
template <class Function>
std::string text_of_cell(const TableCell& cell, const char* missing, const char* yes,
                         const char* no, Function number) {
    return std::visit(Overloaded{[&](std::monostate) { return std::string(missing); },
                                 [](const std::string& text) { return text; },
                                 [&](double value) -> std::string { return number(value); },
                                 [](std::int64_t count) { return std::to_string(count); },
                                 [&](bool flag) { return std::string(flag ? yes : no); },
                                 [](const std::vector<double>& numbers) {
                                     return fmt::format("{}", fmt::join(numbers, " "));
                                 }},
                      cell.value);
}

Json row_json(const ResultTable& table, const std::vector<TableCell>& row, MissingFigure missing) {
    Json json = Json::object();
    for (std::size_t i = 0; i < row.size(); ++i) {
        const std::string& key = table.columns[i].key;
        if (key.empty())
            continue;
        std::visit(Overloaded{[&](std::monostate) {
                                  if (missing == MissingFigure::null)
                                      json[key] = nullptr;
                              },
                              [&](const auto& value) { json[key] = value; }},
                   row[i].value);
    }
    return json;
}

// The places of the columns that people see.
std::vector<std::size_t> shown_columns(const ResultTable& table) {
    std::vector<std::size_t> places;
    for (std::size_t i = 0; i < table.columns.size(); ++i)
        if (!table.columns[i].heading.empty())
            places.push_back(i);
    return places;
}

// A column of text_table(): heading, unit, then a line each row.
struct TextColumn {
    std::vector<std::string> lines;
    std::size_t width = 0;
    bool is_text = false;
};

std::size_t characters(const std::string& utf8) {
    return static_cast<std::size_t>(std::ranges::count_if(
        utf8, [](char byte) { return (static_cast<unsigned char>(byte) & 0xc0u) != 0x80u; }));
}

TextColumn text_column(const ResultTable& table, std::size_t i) {
    const ColumnHead& head = table.columns[i];
    TextColumn column{{head.heading, head.unit}};
    for (const std::vector<TableCell>& row : table.rows) {
        std::string cell = cell_text(row[i], head);
        if (cell == dash)
            cell = "-";
        column.is_text |= cell != "-" && !cell.empty() && !parse_number(cell);
        column.lines.push_back(std::move(cell));
    }
    for (const std::string& line : column.lines)
        column.width = std::max(column.width, characters(line));
    return column;
}

// Takes what is beyond 80 columns from the widest text.
void fit_into_terminal(std::vector<TextColumn>& columns) {
    constexpr std::size_t terminal = 80, gap = 2, least = 8;
    std::size_t width = 0;
    TextColumn* widest = nullptr;
    for (TextColumn& column : columns) {
        width += column.width + gap;
        if (column.is_text && (!widest || column.width > widest->width))
            widest = &column;
    }
    if (widest && width > terminal + gap)
        widest->width =
            std::max(least, widest->width - std::min(widest->width, width - terminal - gap));
}

}  // namespace

const ColumnsOf<Rigid>& columns_of_pose() {
    static const ColumnsOf<Rigid> columns = [] {
        ColumnsOf<Rigid> six;
        for (int i = 0; const char* key : {"rx", "ry", "rz", "tx", "ty", "tz"}) {
            six.push_back({key, [i](const Rigid& pose) { return vector_from_rigid(pose)[i]; }});
            ++i;
        }
        return six;
    }();
    return columns;
}

ResultTable empty_table(const std::vector<std::string>& headings) {
    ResultTable table;
    for (const std::string& text : headings) {
        const auto unit = text.find(" / ");
        table.columns.push_back(
            {text.substr(0, unit), unit == std::string::npos ? "" : text.substr(unit + 3)});
    }
    return table;
}

std::string csv_of(const ResultTable& table, const std::string& number_format) {
    const auto number = [&](double value) {
        return number_format.empty() ? exact(value)
                                     : fmt::format(fmt::runtime(number_format), value);
    };
    std::vector<std::string> cells;
    for (const ColumnHead& column : table.columns)
        if (!column.key.empty())
            cells.push_back(column.key);
    std::string text = fmt::format("{}\n", fmt::join(cells, ","));
    for (const std::vector<TableCell>& row : table.rows) {
        cells.clear();
        for (std::size_t i = 0; i < row.size(); ++i)
            if (!table.columns[i].key.empty())
                cells.push_back(csv_text(text_of_cell(row[i], "", "1", "0", number)));
        text += fmt::format("{}\n", fmt::join(cells, ","));
    }
    return text;
}

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

Json json_rows(const ResultTable& table, MissingFigure missing) {
    Json rows = Json::array();
    for (const std::vector<TableCell>& row : table.rows)
        rows.push_back(row_json(table, row, missing));
    return rows;
}

Json json_object(const ResultTable& table, MissingFigure missing) {
    return row_json(table, table.rows.at(0), missing);
}

std::string cell_text(const TableCell& cell, const ColumnHead& column) {
    return text_of_cell(cell, dash, "yes", "no", [&](double number) {
        return std::isfinite(number) ? fmt::format(fmt::runtime(column.format), number) : dash;
    });
}

std::vector<std::string> headings_of(const ResultTable& table) {
    std::vector<std::string> headings;
    for (const std::size_t i : shown_columns(table)) {
        const ColumnHead& column = table.columns[i];
        headings.push_back(column.heading + (column.unit.empty() ? "" : " / " + column.unit));
    }
    return headings;
}

std::vector<std::vector<std::string>> texts_of(const ResultTable& table) {
    std::vector<std::vector<std::string>> texts;
    for (const std::vector<TableCell>& row : table.rows)
        for (auto& line = texts.emplace_back(); const std::size_t i : shown_columns(table))
            line.push_back(cell_text(row[i], table.columns[i]));
    return texts;
}

std::string text_table(const ResultTable& table, const std::vector<std::string>& without) {
    std::vector<TextColumn> columns;
    for (const std::size_t i : shown_columns(table))
        if (std::ranges::find(without, table.columns[i].heading) == without.end())
            columns.push_back(text_column(table, i));
    fit_into_terminal(columns);
    const bool has_units = std::ranges::any_of(
        columns, [](const TextColumn& column) { return !column.lines[1].empty(); });
    std::string text;
    for (std::size_t i = 0; i < table.rows.size() + 2; ++i) {
        if (i == 1 && !has_units)
            continue;
        std::string line;
        for (const TextColumn& column : columns)
            line += fmt::format(fmt::runtime(column.is_text ? "{:<{}.{}}  " : "{:>{}.{}}  "),
                                column.lines[i], column.width, column.width);
        text += line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
    }
    return text;
}

}  // namespace etalon
