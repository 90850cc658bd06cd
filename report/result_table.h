// The figures of a result, described once. Its CSV file, its JSON, its table on a page and its
// table on a terminal follow from the same columns:
//
//     const ColumnsOf<ModelScore> columns = {
//         {"model", &ModelScore::model, "model"},
//         {"rms_px", &ModelScore::rms_px, "fit", "px", "{:.3f}"},
//         {"is_best", [](const ModelScore& score) { return score.above_best == 0.0; }}};
//     const ResultTable table = table_of(columns, scores);
//     write_text(path, csv_of(table));
//     json["models"] = json_rows(table);
//     page.add_table(table);
//     std::cout << text_table(table);
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <variant>
#include <vector>

#include "core/geometry/rigid.h"
#include "report/json_text.h"

namespace etalon {

// Text, a number, a count, yes or no, numbers (in JSON); or nothing where there is no such figure.
struct TableCell {
    std::variant<std::monostate, std::string, double, std::int64_t, bool, std::vector<double>>
        value;

    TableCell() = default;
    TableCell(std::nullopt_t) {}
    TableCell(std::string text) : value(std::move(text)) {}
    TableCell(std::string_view text) : value(std::string(text)) {}
    TableCell(const char* text) : value(std::string(text)) {}
    TableCell(bool flag) : value(flag) {}
    TableCell(std::vector<double> numbers) : value(std::move(numbers)) {}
    template <class Number>
    requires std::is_floating_point_v<Number> TableCell(Number number)
        : value(static_cast<double>(number)) {}
    template <class Count>
    requires std::is_integral_v<Count> TableCell(Count count)
        : value(static_cast<std::int64_t>(count)) {}
    template <class Type>
    TableCell(const std::optional<Type>& cell) {
        if (cell)
            *this = TableCell(*cell);
    }
};

// How a column is named and shown.
struct ColumnHead {
    std::string heading;            // for people; empty: in files only
    std::string unit = {};          // for people, behind the heading
    std::string key = {};           // in files; empty: for people only
    std::string format = "{:.4g}";  // of a number for people, in the syntax of fmt
};

// `value` is whatever std::invoke() calls with a row: a pointer to a member, a function, a lambda.
template <class Row>
struct Column {
    std::string key;
    std::function<TableCell(const Row&)> value;
    std::string heading = {}, unit = {};
    std::string format = "{:.4g}";
};

template <class Row>
using ColumnsOf = std::vector<Column<Row>>;

// The columns of a part of the row, with a prefix to their keys. `part` gives a reference to the
// part, or a pointer or an optional where it may be missing: its cells are empty then.
template <class Row, class Part, class Function>
void add_columns(ColumnsOf<Row>& columns, const ColumnsOf<Part>& of_part, Function part,
                 const std::string& prefix = "") {
    for (const Column<Part>& column : of_part) {
        auto value = [get = column.value, part](const Row& row) -> TableCell {
            auto&& it = std::invoke(part, row);
            if constexpr (std::is_convertible_v<decltype(it), const Part&>)
                return get(it);
            else
                return it ? get(*it) : TableCell();
        };
        columns.push_back({prefix + column.key, value, column.heading, column.unit, column.format});
    }
}

// Six columns of a pose in files, "rx" to "tz": rotation vector in rad, then translation in mm.
const ColumnsOf<Rigid>& columns_of_pose();

// From columns, or filled row by row.
struct ResultTable {
    std::vector<ColumnHead> columns;
    std::vector<std::vector<TableCell>> rows = {};  // each with a cell for every column
};

// For people, without rows yet. "fit / px" has a unit.
ResultTable empty_table(const std::vector<std::string>& headings);

template <class Row, class List>
ResultTable table_of(const ColumnsOf<Row>& columns, const List& rows) {
    ResultTable table;
    for (const Column<Row>& each : columns)
        table.columns.push_back({each.heading, each.unit, each.key, each.format});
    for (const auto& row : rows)
        for (auto& cells = table.rows.emplace_back(); const Column<Row>& each : columns)
            cells.push_back(each.value(row));
    return table;
}

// A table of this row alone, for json_object().
template <class Row>
ResultTable table_of_one(const ColumnsOf<Row>& columns, const Row& row) {
    return table_of(columns, std::initializer_list<std::reference_wrapper<const Row>>{row});
}

// ---- files: the columns with a key ----------------------------------------------------------

// Nothing is an empty cell, yes and no are 1 and 0. Numbers are unrounded without a format.
std::string csv_of(const ResultTable& table, const std::string& number_format = "");

// Text with commas, quotes or line ends is quoted (RFC 4180, section 2).
std::string csv_text(const std::string& text);
// What csv_text() was given.
std::string text_of_csv(std::string_view field);

// What is missing is null, or has no key.
enum class MissingFigure { null, left_out };
Json json_rows(const ResultTable& table, MissingFigure missing = MissingFigure::null);
// Of the first row.
Json json_object(const ResultTable& table, MissingFigure missing = MissingFigure::null);
template <class Row, class Object = Json>
Object json_object(const ColumnsOf<Row>& columns, const Row& row,
                   MissingFigure missing = MissingFigure::null) {
    return json_object(table_of_one(columns, row), missing);
}

// ---- people: the columns with a heading -----------------------------------------------------

// A cell as people read it: a dash where there is nothing or no finite number.
std::string cell_text(const TableCell& cell, const ColumnHead& column);

// "fit / px"
std::vector<std::string> headings_of(const ResultTable& table);
std::vector<std::vector<std::string>> texts_of(const ResultTable& table);

// For a terminal: headings, units, rows; numbers aligned right. The widest text is cut to 80
// columns a line. `without`: headings that are for pages only.
std::string text_table(const ResultTable& table, const std::vector<std::string>& without = {});

}  // namespace etalon
