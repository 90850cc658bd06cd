#include "station/planning/oc_record.h"

#include <fmt/format.h>

#include <limits>
#include <nlohmann/json.hpp>

#include "core/config/json_entry.h"
#include "core/file/text.h"
#include "core/program/errors.h"
#include "core/program/version.h"
#include "report/json_text.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

constexpr const char* oc_kind = "oc-record/1";
constexpr ShardedWork oc_work{"operating characteristic", "run", "oc merge", "oc.json"};
constexpr double DetectorFigures::*detector_numbers[] = {
    &DetectorFigures::noise_px, &DetectorFigures::bias_px, &DetectorFigures::noise_bias_px};
constexpr int DetectorFigures::*detector_counts[] = {
    &DetectorFigures::frames, &DetectorFigures::seen, &DetectorFigures::poses};

ordered_json error_json(const ErrorCharacteristic& error) {
    return {{"name", error.name},
            {"unit", error.unit},
            {"alike", error.alike},
            {"observable", error.observable},
            {"reason", error.reason},
            {"limit_size", json_list(error.limit_size, optional_number)},
            {"sizes", json_list(error.points, [](const auto& point) { return point.size; })}};
}

ordered_json oc_json(const StationCharacteristic& planned, const Shard& shard) {
    const OperatingCharacteristic& result = planned.result;
    ordered_json numbers = ordered_json::array(), counts = ordered_json::array();
    for (const auto number : detector_numbers)
        numbers.push_back(planned.detector.*number);
    for (const auto count : detector_counts)
        counts.push_back(planned.detector.*count);
    const auto quantity_json = [](const JudgedQuantity& one) -> ordered_json {
        return {{"name", one.name}, {"unit", one.unit}, {"limit", one.limit}};
    };
    return {{"etalon", oc_kind},
            {"station", planned.station},
            {"runs", result.runs},
            {"seed", result.seed},
            {"made_from", ordered_json::parse(planned.made_from)},
            {"detector", {{"px", numbers}, {"counts", counts}}},
            {"quantities", json_list(result.quantities, quantity_json)},
            {"errors", json_list(result.errors, error_json)},
            {"shard", {shard.index, shard.count}}};
}

// ------------------------------------------------------------------------------------- read back

constexpr long long max_count = std::numeric_limits<int>::max();

DetectorFigures read_detector(const JsonEntry& entry) {
    DetectorFigures detector;
    const auto numbers = entry.at("px").numbers(std::size(detector_numbers));
    for (std::size_t i = 0; i < numbers.size(); ++i)
        detector.*detector_numbers[i] = numbers[i];
    const auto counts = entry.at("counts").items();
    if (counts.size() != std::size(detector_counts))
        entry.fail("has other counts");
    for (std::size_t i = 0; i < counts.size(); ++i)
        detector.*detector_counts[i] = static_cast<int>(counts[i].integer(0, max_count));
    return detector;
}

CharacteristicPoint empty_point(double size, std::size_t quantities) {
    CharacteristicPoint point;
    point.size = size;
    point.quantities.resize(quantities);
    return point;
}

ErrorCharacteristic read_error(const JsonEntry& entry, std::size_t quantities) {
    ErrorCharacteristic error;
    error.name = entry.at("name").text();
    error.unit = entry.at("unit").text();
    for (const JsonEntry& other : entry.at("alike").items())
        error.alike.push_back(other.text());
    error.observable = entry.at("observable").flag();
    error.reason = entry.at("reason").text();
    for (const JsonEntry& size : entry.at("limit_size").items())
        error.limit_size.push_back(size.is_null() ? std::nullopt : std::optional(size.number()));
    if (error.limit_size.size() != (error.observable ? quantities : 0))
        entry.at("limit_size").fail("is not of all quantities");
    for (const JsonEntry& size : entry.at("sizes").items())
        error.points.push_back(empty_point(size.number(), quantities));
    return error;
}

StationCharacteristic read_planned(const std::filesystem::path& path, const std::string& text) {
    const JsonEntry root(text, {path.string()});
    if (!root.has("etalon") || root.at("etalon").text() != oc_kind)
        root.fail(std::string("is not of ") + oc_kind);
    StationCharacteristic planned;
    planned.station = root.at("station").text();
    planned.detector = read_detector(root.at("detector"));
    root.at("made_from");  // or it says where that is missing
    planned.made_from = ordered_json::parse(text)["made_from"].dump();
    OperatingCharacteristic& result = planned.result;
    result.runs = static_cast<int>(root.at("runs").integer(1, max_count));
    result.seed = root.at("seed").whole();
    for (const JsonEntry& entry : root.at("quantities").items()) {
        JudgedQuantity quantity;
        quantity.name = entry.at("name").text();
        quantity.unit = entry.at("unit").text();
        quantity.limit = entry.at("limit").number(positive);
        result.quantities.push_back(quantity);
    }
    result.without_error = empty_point(0.0, result.quantities.size());
    for (const JsonEntry& entry : root.at("errors").items())
        result.errors.push_back(read_error(entry, result.quantities.size()));
    return planned;
}

std::optional<Outcome> outcome_named(std::string_view text) {
    for (const Outcome outcome : {Outcome::pass, Outcome::fail, Outcome::inconclusive,
                                  Outcome::not_observable, Outcome::skipped})
        if (text == name(outcome))
            return outcome;
    return std::nullopt;
}

PointRun read_point(const std::string& row, std::size_t point, std::size_t quantities,
                    const SourcePlace& place) {
    const std::vector<std::string> cells = split(row, ',');
    if (cells.size() != 4 + 3 * quantities || cells[1] != fmt::format("{}", point) ||
        (cells[2] != "0" && cells[2] != "1"))
        throw ConfigError(place, fmt::format("is no line of point {}", point));
    const auto outcome = [&](const std::string& cell) {
        const auto found = outcome_named(cell);
        if (!found)
            throw ConfigError(place, "'" + cell + "' is no outcome");
        return *found;
    };
    const auto number = [&](const std::string& cell) {
        const auto found = parse_number(cell);
        if (!found)
            throw ConfigError(place, "'" + cell + "' is no number");
        return *found;
    };
    PointRun run{cells[2] == "1", outcome(cells[3]), {}};
    for (std::size_t k = 0; k < quantities; ++k)
        run.quantities.push_back(
            {outcome(cells[4 + 3 * k]), number(cells[5 + 3 * k]), number(cells[6 + 3 * k])});
    return run;
}

std::string oc_header(const OperatingCharacteristic& result) {
    std::string line = "run,point,refused,verdict";
    for (const JudgedQuantity& each : result.quantities)
        line += fmt::format(",{0}_outcome,{0},{0}_U", each.name);
    return line + "\n";
}

}  // namespace

StationCharacteristic characteristic_of(const StudiedPlan& studied,
                                        const OperatingCharacteristic& result) {
    ordered_json made_from{{"version", version}};
    for (const InputFile& input : studied.station.inputs)
        made_from[input.role + "_sha256"] = input.sha256;
    return {studied.station.id, made_from.dump(), figures_of(studied.simulator->study()), result};
}

RowsDescription oc_rows(const StationCharacteristic& planned, const Shard& shard) {
    return {oc_work, text_of(oc_json(planned, shard)), oc_header(planned.result),
            static_cast<std::size_t>(planned.result.runs), point_count(planned.result)};
}

std::string rows_of_run(std::size_t run, std::span<const PointRun> points) {
    std::string rows;
    for (std::size_t i = 0; i < points.size(); ++i) {
        rows += fmt::format("{},{},{:d},{}", run, i, points[i].refused, name(points[i].verdict));
        for (const QuantityRun& one : points[i].quantities)
            rows += fmt::format(",{},{},{}", name(one.outcome), exact(one.value),
                                exact(one.expanded_uncertainty));
        rows += "\n";
    }
    return rows;
}

StationCharacteristic merged_characteristic(const std::vector<std::filesystem::path>& shards) {
    std::vector<std::string> descriptions;
    StationCharacteristic merged;
    for (const std::filesystem::path& folder : shards) {
        const std::filesystem::path path = folder / oc_work.description;
        descriptions.push_back(read_text(path));
        merged = read_planned(path, descriptions.back());
    }
    const RowsDescription whole = oc_rows(merged, {});
    ShardRows rows(shards_in_order(oc_work, shards, descriptions), whole);
    std::vector<PointRun> points(whole.rows_per_unit);
    for (std::size_t run = 0; run < whole.units; ++run) {
        const std::vector<std::string>& texts = rows.next();
        for (std::size_t i = 0; i < points.size(); ++i)
            points[i] = read_point(texts[i], i, merged.result.quantities.size(), rows.place(i));
        add_run(merged.result, points);
    }
    return merged;
}

}  // namespace etalon
