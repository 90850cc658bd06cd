#include "station/planning/operating_characteristic.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/parallel_for.h>
#include <iterator>
#include <nlohmann/json.hpp>

#include "core/file/text.h"
#include "core/program/version.h"
#include "report/json_text.h"

namespace etalon {

namespace {

PointRun run_of(const Qualification& analysis, std::span<const JudgedQuantity> quantities) {
    PointRun run;
    run.verdict = analysis.verdict;
    for (const JudgedQuantity& wanted : quantities) {
        const auto found =
            std::ranges::find(analysis.quantities, wanted.name, &JudgedQuantity::name);
        const JudgedQuantity one = found == analysis.quantities.end() ? JudgedQuantity{} : *found;
        run.quantities.push_back({one.outcome, one.value, one.expanded_uncertainty});
    }
    return run;
}

void count(Outcome outcome, OutcomeCounts& counts) {
    ++(outcome == Outcome::pass   ? counts.pass
       : outcome == Outcome::fail ? counts.fail
                                  : counts.other);
}

void add_to(CharacteristicPoint& point, const PointRun& run, int runs) {
    point.refused += run.refused;
    count(run.verdict, point.verdict);
    for (std::size_t k = 0; k < point.quantities.size(); ++k) {
        QuantityOutcomes& sum = point.quantities[k];
        const QuantityRun one = run.refused ? QuantityRun{} : run.quantities.at(k);
        count(one.outcome, sum.counts);
        sum.mean_value += one.value / static_cast<double>(runs);
        sum.mean_uncertainty += one.expanded_uncertainty / static_cast<double>(runs);
    }
}

CharacteristicPoint empty_point(double size, std::size_t quantities) {
    return {size, std::vector<QuantityOutcomes>(quantities)};
}

}  // namespace

// What has a limit, and nothing else: that is what takes no longer than it must.
Qualification CharacteristicRuns::judgement(QualificationInput input) const {
    input.options.known_run = &told_;
    input.options.known_draws = &draws_;
    input.options.measure_reported = false;
    return qualify(input);
}

RunTruth CharacteristicRuns::truth(const InjectedError& error, double size) const {
    RunTruth truth = simulator_.as_told();
    error.change(truth, size);
    return truth;
}

// The size whose exact field has the quantity at its limit; values grow nearly in proportion to the
// size. Nothing when that does not settle, or the field cannot be had at such a size.
std::optional<double> CharacteristicRuns::size_at(const JudgedQuantity& quantity,
                                                  const InjectedError& error, double start) const {
    constexpr int max_steps = 20;
    constexpr double close = 1e-3, max_step = 4.0;
    double size = start;
    for (int step = 0; step < max_steps; ++step) {
        // Not analysed where the error is so large that the marker leaves the image, say.
        auto analysis = attempted([&] { return judgement(simulator_.exact(truth(error, size))); });
        const QuantityRun found =
            analysis ? run_of(*analysis, std::span(&quantity, 1)).quantities[0] : QuantityRun{};
        if (found.outcome == Outcome::skipped || !(found.value > 0.0))
            return std::nullopt;
        const double ratio = quantity.limit / found.value;
        if (std::abs(ratio - 1.0) < close)
            return size;
        size *= std::clamp(ratio, 1.0 / max_step, max_step);
    }
    return std::nullopt;
}

ErrorCharacteristic CharacteristicRuns::with_sizes(const InjectedError& error,
                                                   const ErrorSignature& signature) {
    ErrorCharacteristic result{error.name,       error.unit, {}, signature.observable,
                               signature.reason, {},         {}};
    if (!signature.observable)
        return result;
    const double start = signature.size *
                         simulator_.station().limits.by_quantity.at(quantity::position_rms) /
                         signature.after_rms_mm;
    std::vector<double> sizes;
    for (const JudgedQuantity& quantity : planned_.quantities) {
        const auto limit_size = result.limit_size.emplace_back(size_at(quantity, error, start));
        for (const double multiple : {0.5, 1.0, 2.0})
            if (limit_size)
                sizes.push_back(multiple * *limit_size);
    }
    std::ranges::sort(sizes);
    for (const double size : sizes) {
        result.points.push_back(empty_point(size, planned_.quantities.size()));
        truths_.push_back(truth(error, size));
    }
    return result;
}

void CharacteristicRuns::choose_errors(const std::vector<std::string>& wanted) {
    const auto is_in = [](const std::vector<std::string>& names, const std::string& name) {
        return std::ranges::find(names, name) != names.end();
    };
    std::vector<ErrorCharacteristic>& chosen = planned_.errors;
    for (const InjectedError& error : simulator_.errors()) {
        const auto signature =
            std::ranges::find(told_.signatures, error.name, &ErrorSignature::name);
        if (signature == told_.signatures.end() || (!wanted.empty() && !is_in(wanted, error.name)))
            continue;
        const auto like = std::ranges::find_if(chosen, [&](const ErrorCharacteristic& other) {
            return is_in(signature->confounded_with, other.name);
        });
        if (like != chosen.end() && wanted.empty())
            like->alike.push_back(error.name);
        else
            chosen.push_back(with_sizes(error, *signature));
    }
    for (const std::string& name : wanted)
        if (std::ranges::find(chosen, name, &ErrorCharacteristic::name) == chosen.end())
            throw ConfigError({"--error"}, fmt::format("there is no '{}'; `etalon plan` lists "
                                                       "the errors of this station",
                                                       name));
}

CharacteristicRuns::CharacteristicRuns(const RunSimulator& simulator,
                                       const CharacteristicRequest& request)
    : simulator_(simulator),
      draws_(request.seed),
      told_(qualify(simulator.draw(simulator.as_told(), request.seed, 0))) {
    std::ranges::copy_if(
        told_.quantities, std::back_inserter(planned_.quantities),
        [](const JudgedQuantity& each) { return each.outcome != Outcome::skipped; });
    if (planned_.quantities.empty())
        throw NumericalError(
            fmt::format("operating characteristic: a run without any error is not judged: {}",
                        fmt::join(told_.reasons, "; ")));
    planned_.without_error = empty_point(0.0, planned_.quantities.size());
    planned_.runs = request.runs;
    planned_.seed = request.seed;
    truths_.push_back(simulator_.as_told());
    choose_errors(request.errors);
}

PointRun CharacteristicRuns::run(std::size_t run, std::size_t point) const {
    PointRun result;
    const auto qualified = attempted([&] {
        result = run_of(judgement(simulator_.draw(truths_[point], planned_.seed, run)),
                        planned_.quantities);
    });
    result.refused = !qualified;
    return result;
}

void CharacteristicRuns::simulate(std::span<const std::size_t> runs, const KeepRun& keep) const {
    constexpr std::size_t at_a_time = 32;
    const std::size_t points = truths_.size();
    for (std::size_t first = 0; first < runs.size(); first += at_a_time) {
        const auto some = runs.subspan(first, std::min(at_a_time, runs.size() - first));
        std::vector<PointRun> results(some.size() * points);
        tbb::parallel_for(std::size_t{0}, results.size(),
                          [&](std::size_t i) { results[i] = run(some[i / points], i % points); });
        for (std::size_t i = 0; i < some.size(); ++i)
            keep(some[i], std::span(results).subspan(i * points, points));
    }
}

std::size_t point_count(const OperatingCharacteristic& result) {
    std::size_t points = 1;
    for (const ErrorCharacteristic& error : result.errors)
        points += error.points.size();
    return points;
}

void add_run(OperatingCharacteristic& result, std::span<const PointRun> points) {
    std::size_t next = 0;
    add_to(result.without_error, points[next++], result.runs);
    for (ErrorCharacteristic& error : result.errors)
        for (CharacteristicPoint& point : error.points)
            add_to(point, points[next++], result.runs);
}

const CharacteristicPoint* point_at(const ErrorCharacteristic& error, std::size_t quantity,
                                    double multiple) {
    if (quantity >= error.limit_size.size() || !error.limit_size[quantity])
        return nullptr;
    const double size = multiple * *error.limit_size[quantity];
    const auto found = std::ranges::find_if(error.points, [&](const CharacteristicPoint& point) {
        return std::abs(point.size - size) <= 1e-12 * std::abs(size);
    });
    return found == error.points.end() ? nullptr : &*found;
}

namespace {

constexpr const char* oc_kind = "oc-record/1";
constexpr ShardedWork oc_work{"operating characteristic", "run", "oc merge", "oc.json"};
constexpr double DetectorFigures::*detector_numbers[] = {
    &DetectorFigures::noise_px, &DetectorFigures::bias_px, &DetectorFigures::noise_bias_px};
constexpr int DetectorFigures::*detector_counts[] = {
    &DetectorFigures::frames, &DetectorFigures::seen, &DetectorFigures::asked};

Json error_json(const ErrorCharacteristic& error) {
    return {{"name", error.name},
            {"unit", error.unit},
            {"alike", error.alike},
            {"observable", error.observable},
            {"reason", error.reason},
            {"limit_size", json_list(error.limit_size, or_null<double>)},
            {"sizes", json_list(error.points, [](const auto& point) { return point.size; })}};
}

Json oc_json(const StationCharacteristic& planned, const Shard& shard) {
    const OperatingCharacteristic& result = planned.result;
    const auto figure = [&](auto member) { return planned.detector.*member; };
    const auto quantity_json = [](const JudgedQuantity& one) -> Json {
        return {{"name", one.name}, {"unit", one.unit}, {"limit", one.limit}};
    };
    return {{"etalon", oc_kind},
            {"station", planned.station},
            {"runs", result.runs},
            {"seed", result.seed},
            {"made_from", Json::parse(planned.made_from)},
            {"detector",
             {{"px", json_list(detector_numbers, figure)},
              {"counts", json_list(detector_counts, figure)}}},
            {"quantities", json_list(result.quantities, quantity_json)},
            {"errors", json_list(result.errors, error_json)},
            {"shard", {shard.index, shard.count}}};
}

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
    planned.made_from = Json::parse(text)["made_from"].dump();
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

PointRun read_point(const std::string& row, std::size_t point, std::size_t quantities,
                    const SourcePlace& place) {
    const std::vector<std::string> cells = split(row, ',');
    if (cells.size() != 4 + 3 * quantities || cells[1] != fmt::format("{}", point) ||
        (cells[2] != "0" && cells[2] != "1"))
        throw ConfigError(place, fmt::format("is no line of point {}", point));
    const auto outcome = [&](const std::string& cell) {
        for (const Outcome one : {Outcome::pass, Outcome::fail, Outcome::inconclusive,
                                  Outcome::not_observable, Outcome::skipped})
            if (cell == name(one))
                return one;
        throw ConfigError(place, "'" + cell + "' is no outcome");
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

StationCharacteristic characteristic_of(const RunSimulator& simulator,
                                        const OperatingCharacteristic& result) {
    Json made_from{{"version", version}};
    for (const InputFile& input : simulator.station().inputs)
        made_from[input.role + "_sha256"] = input.sha256;
    return {simulator.station().id, made_from.dump(), simulator.study(), result};
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
