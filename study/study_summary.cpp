#include "study/study_summary.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/program/version.h"
#include "report/json_text.h"

namespace etalon {
namespace {

struct Bounds {
    double from_px;
    std::optional<double> to_px;

    bool hold(double size_px) const { return size_px >= from_px && (!to_px || size_px < *to_px); }
};
constexpr std::array<Bounds, 7> classes{
    {{0, 25}, {25, 40}, {40, 60}, {60, 100}, {100, {}}, {60, {}}, {0, {}}}};

// By rank: the smallest value that 95 % of them do not exceed.
double quantile_95(std::vector<double> values) {
    const std::size_t rank = (95 * values.size() + 99) / 100;
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(rank - 1);
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

constexpr std::uint64_t bootstrap_seed = 1;

constexpr std::pair<const char*, Estimate ErrorStatistics::*> estimates[] = {
    {"mean", &ErrorStatistics::mean},
    {"mean |error|", &ErrorStatistics::mean_absolute},
    {"median", &ErrorStatistics::median},
    {"median |error|", &ErrorStatistics::median_absolute}};

Json json_of(const std::optional<Proportion>& share) {
    if (!share)
        return nullptr;
    return {{"count", share->count},
            {"of", share->trials},
            {"value", share->value},
            {"low", share->low},
            {"high", share->high}};
}

Json json_of(const Estimate& estimate) {
    Json json{{"value", estimate.value}};
    if (estimate.interval) {
        json["low"] = estimate.interval->low;
        json["high"] = estimate.interval->high;
    }
    return json;
}

Json json_of(const MeasureStatistics& measures) {
    Json json = Json::object();
    for (std::size_t k = 0; k < measures.size(); ++k) {
        Json entry{{"unit", error_measures[k].unit}};
        for (const auto& [name, value] : estimates)
            entry[name] = json_of(measures[k].*value);
        if (measures[k].standard_deviation)
            entry["std"] = json_of(*measures[k].standard_deviation);
        json[error_measures[k].name] = entry;
    }
    return json;
}

Json json_of(const PoseStatistics& statistics) {
    Json json{{"poses", statistics.poses},
              {"detected", json_of(statistics.detected)},
              {"flips", json_of(statistics.flips)}};
    if (statistics.all)
        json["errors"] = json_of(*statistics.all);
    if (statistics.without_flips)
        json["errors_without_flips"] = json_of(*statistics.without_flips);
    return json;
}

Json json_of(const SizeClass& one) {
    Json json{{"from_px", one.from_px},
              {"to_px", or_null(one.to_px)},
              {"poses", one.poses},
              {"detected", json_of(one.detected)}};
    if (one.median_corner_px)
        json["median_corner_rms_px"] = json_of(*one.median_corner_px);
    add_present(json, "quantile95_corner_rms_px", one.corner_quantile_px);
    return json;
}

// "0.0213 (0.0190 to 0.0240)"; a narrow table breaks it before the bracket only.
std::optional<std::string> with_interval(const std::optional<Estimate>& estimate) {
    if (!estimate)
        return std::nullopt;
    const std::string value = figure_text(estimate->value);
    if (!estimate->interval)
        return value;
    return fmt::format("{} ({}\u00a0to\u00a0{})", value, figure_text(estimate->interval->low),
                       figure_text(estimate->interval->high));
}

std::optional<std::string> percent(const std::optional<Proportion>& share) {
    if (!share)
        return std::nullopt;
    return fmt::format("{:.2f} ({:.2f}\u00a0to\u00a0{:.2f})", 100.0 * share->value,
                       100.0 * share->low, 100.0 * share->high);
}

std::optional<std::string> figure_of(const std::optional<double>& value) {
    return value ? std::optional(figure_text(*value)) : std::nullopt;
}

std::optional<std::string> figure_of(const std::optional<Estimate>& estimate) {
    return estimate ? std::optional(figure_text(estimate->value)) : std::nullopt;
}

using Statistic = std::optional<Estimate> (*)(const ErrorStatistics&);
constexpr std::pair<const char*, Statistic> short_statistics[] = {
    {"mean", [](const ErrorStatistics& s) { return std::optional(s.mean); }},
    {"std", [](const ErrorStatistics& s) { return s.standard_deviation; }},
    {"mean |error|", [](const ErrorStatistics& s) { return std::optional(s.mean_absolute); }},
    {"median |error|", [](const ErrorStatistics& s) { return std::optional(s.median_absolute); }}};

std::string csv_cell(const std::optional<Estimate>& estimate) {
    if (!estimate)
        return ",,";
    if (!estimate->interval)
        return fmt::format("{:.6f},,", estimate->value);
    return fmt::format("{:.6f},{:.6f},{:.6f}", estimate->value, estimate->interval->low,
                       estimate->interval->high);
}

std::string csv_lines(const std::string& start, const PoseStatistics& statistics) {
    std::string text;
    for (std::size_t k = 0; statistics.all && k < error_measure_count; ++k) {
        const ErrorStatistics& s = (*statistics.all)[k];
        text += fmt::format("{}{},{},{},{}", start, statistics.poses,
                            statistics.detected ? statistics.detected->count : 0,
                            error_measures[k].name, error_measures[k].unit);
        for (const auto& [name, value_of] : short_statistics)
            text += "," + csv_cell(value_of(s));
        text += ",,,\n";
    }
    return text;
}

std::string csv_line(const std::string& start, const SizeClass& one) {
    const std::string nothing = csv_cell(std::nullopt);
    return fmt::format(
        "{}size,{},{},corner,px,{},{},{},{},{:g},{},{}\n", start, one.poses,
        one.detected ? one.detected->count : 0, nothing, nothing, nothing,
        csv_cell(one.median_corner_px), one.from_px,
        one.to_px ? fmt::format("{:g}", *one.to_px) : "",
        one.corner_quantile_px ? fmt::format("{:.6f}", *one.corner_quantile_px) : "");
}

}  // namespace

std::vector<SizeClass> size_classes(const DetectorErrors& errors, std::span<const double> sizes_px,
                                    std::span<const std::optional<double>> corner_rms_px) {
    if (sizes_px.size() != errors.size() || corner_rms_px.size() != errors.size())
        throw NumericalError(fmt::format("size classes: {} sizes and {} corner errors for {} poses",
                                         sizes_px.size(), corner_rms_px.size(), errors.size()));
    std::vector<SizeClass> result;
    for (const Bounds& bounds : classes) {
        SizeClass& one = result.emplace_back(SizeClass{bounds.from_px, bounds.to_px});
        std::size_t detected = 0;
        std::vector<double> corners_px;
        for (std::size_t i = 0; i < errors.size(); ++i) {
            if (!bounds.hold(sizes_px[i]))
                continue;
            ++one.poses;
            detected += errors[i].has_value();
            if (corner_rms_px[i])
                corners_px.push_back(*corner_rms_px[i]);
        }
        if (one.poses > 0)
            one.detected = wilson_share(detected, one.poses);
        if (!corners_px.empty())
            one.median_corner_px = median_estimate(corners_px);
        if (corners_px.size() >= min_quantile_values)
            one.corner_quantile_px = quantile_95(corners_px);
    }
    return result;
}

std::string size_words(const SizeClass& one) {
    if (one.to_px)
        return one.from_px > 0.0 ? fmt::format("{:g} to {:g}", one.from_px, *one.to_px)
                                 : fmt::format("below {:g}", *one.to_px);
    return one.from_px > 0.0 ? fmt::format("from {:g}", one.from_px) : "all";
}

StudySummary summarise(const StudyResults& results) {
    StudySummary summary;
    for (std::size_t v = 0; v < results.errors.size(); ++v) {
        const std::vector<bool> common = commonly_detected(results.errors[v]);
        summary.common.push_back(
            static_cast<std::size_t>(std::count(common.begin(), common.end(), true)));
        std::vector<DetectorSummary>& detectors = summary.detectors.emplace_back();
        for (std::size_t i = 0; i < results.errors[v].size(); ++i) {
            const DetectorErrors& errors = results.errors[v][i];
            detectors.push_back(
                {pose_statistics(errors, bootstrap_seed),
                 pose_statistics(errors, bootstrap_seed, common),
                 size_classes(errors, results.sizes_px[i], results.corner_rms_px[v][i])});
        }
    }
    return summary;
}

std::string figure_text(double value) {
    const double size = std::abs(value);
    return size < 0.00005 ? "0"
           : size < 1.0   ? fmt::format("{:.4f}", value)
           : size < 10.0  ? fmt::format("{:.3f}", value)
           : size < 100.0 ? fmt::format("{:.2f}", value)
                          : fmt::format("{:.1f}", value);
}

ResultTable detection_table(const StudyDescription& description,
                            const std::vector<DetectorSummary>& detectors) {
    ResultTable table =
        empty_table({"detector", "detected / %", "flips / %", "corner error / px", "marker"});
    for (std::size_t i = 0; i < detectors.size(); ++i)
        table.rows.push_back({description.detectors[i].name, percent(detectors[i].own.detected),
                              percent(detectors[i].own.flips),
                              figure_of(detectors[i].median_corner_px()),
                              description.detectors[i].marker});
    return table;
}

ResultTable size_table(const StudyDescription& description,
                       const std::vector<DetectorSummary>& detectors) {
    ResultTable table = empty_table({"detector", "size / px", "median corner error / px",
                                     "95 % are below / px", "detected / %", "poses"});
    for (std::size_t i = 0; i < detectors.size(); ++i) {
        std::string name = description.detectors[i].name;
        for (const SizeClass& size : detectors[i].sizes)
            if (size.poses > 0)
                table.rows.push_back({std::exchange(name, ""), size_words(size),
                                      with_interval(size.median_corner_px),
                                      figure_of(size.corner_quantile_px), percent(size.detected),
                                      size.poses});
    }
    return table;
}

ResultTable error_table(const StudyDescription& description,
                        const std::vector<DetectorSummary>& detectors,
                        PoseStatistics DetectorSummary::*set) {
    ResultTable table = empty_table(
        {"detector", "error", "mean", "standard deviation", "mean |error|", "median |error|"});
    for (std::size_t i = 0; i < detectors.size(); ++i) {
        std::string name = description.detectors[i].name;
        const auto& all = (detectors[i].*set).all;
        for (std::size_t k = 0; all && k < error_measure_count; ++k) {
            const ErrorStatistics& s = (*all)[k];
            table.rows.push_back(
                {std::exchange(name, ""),
                 fmt::format("{}, {}", error_measures[k].name, error_measures[k].unit),
                 with_interval(s.mean), with_interval(s.standard_deviation),
                 with_interval(s.mean_absolute), with_interval(s.median_absolute)});
        }
    }
    return table;
}

ResultTable short_error_table(const StudyDescription& description,
                              const std::vector<DetectorSummary>& detectors) {
    ResultTable table = empty_table({"detector", "errors"});
    for (std::size_t k = 0; k < pose_component_count; ++k)
        table.columns.push_back({error_measures[k].name, error_measures[k].unit});
    for (std::size_t i = 0; i < detectors.size(); ++i) {
        std::string name = description.detectors[i].name;
        for (const auto& [statistic, value_of] : short_statistics) {
            if (!detectors[i].common.all)
                break;
            auto& row = table.rows.emplace_back();
            row = {std::exchange(name, ""), statistic};
            for (std::size_t k = 0; k < pose_component_count; ++k)
                row.push_back(figure_of(value_of((*detectors[i].common.all)[k])));
        }
    }
    return table;
}

ResultTable variant_table(const StudyDescription& description, const StudySummary& summary) {
    ResultTable table =
        empty_table({"detector", "switched", "detected / %", "mean X / mm", "mean Y / mm",
                     "mean Z / mm", "median |Z| / mm", "median |angle| / deg"});
    constexpr std::size_t z = 2, angle = 7;  // places in error_measures
    for (std::size_t i = 0; i < description.detectors.size(); ++i)
        for (std::size_t v = 0; v < description.variants.size(); ++v) {
            const DetectorSummary& one = summary.detectors[v][i];
            auto& row = table.rows.emplace_back();
            row = {v == 0 ? description.detectors[i].name : "", description.variants[v],
                   one.own.detected ? fmt::format("{:.2f}", 100.0 * one.own.detected->value) : "-"};
            row.resize(table.columns.size());
            if (!one.common.all)
                continue;
            for (std::size_t k = 0; k <= z; ++k)
                row[3 + k] = figure_of((*one.common.all)[k].mean);
            row[6] = figure_of((*one.common.all)[z].median_absolute);
            row[7] = figure_of((*one.common.all)[angle].median_absolute);
        }
    return table;
}

std::string summary_text(const StudyResults& results, const StudySummary& summary) {
    const StudyDescription& description = results.description;
    std::string text = fmt::format(
        "study {}: {} poses\n{}\non {} poses that all detect:\n{}", description.id,
        description.poses,
        text_table(detection_table(description, summary.detectors[0]), {"marker"}),
        summary.common[0], text_table(short_error_table(description, summary.detectors[0])));
    if (description.variants.size() > 1)
        text += "\neach variant on the poses that all detect in it:\n" +
                text_table(variant_table(description, summary), {"median |Z|"});
    if (results.refused > 0)
        text += fmt::format("\n{} poses could not be rendered: see results.csv\n", results.refused);
    return text;
}

std::string summary_csv(const StudyDescription& description, const StudySummary& summary) {
    std::string text = "variant,detector,set,poses,detected,measure,unit";
    for (const char* statistic : {"mean", "std", "mean_absolute", "median_absolute"})
        text += fmt::format(",{0},{0}_low,{0}_high", statistic);
    text += ",size_from_px,size_to_px,quantile95_absolute\n";
    for (std::size_t v = 0; v < description.variants.size(); ++v)
        for (std::size_t i = 0; i < description.detectors.size(); ++i) {
            const std::string start = csv_text(description.variants[v]) + "," +
                                      csv_text(description.detectors[i].name) + ",";
            text += csv_lines(start + "own,", summary.detectors[v][i].own);
            text += csv_lines(start + "common,", summary.detectors[v][i].common);
            for (const SizeClass& size : summary.detectors[v][i].sizes)
                text += csv_line(start, size);
        }
    return text;
}

std::string summary_json(const StudyResults& results, const StudySummary& summary) {
    const StudyDescription& description = results.description;
    Json variants = Json::array();
    for (std::size_t v = 0; v < description.variants.size(); ++v) {
        Json detectors = Json::array();
        for (std::size_t i = 0; i < description.detectors.size(); ++i) {
            const DetectorSummary& one = summary.detectors[v][i];
            Json entry{{"name", description.detectors[i].name},
                       {"detector", description.detectors[i].detector},
                       {"marker", description.detectors[i].marker},
                       {"own", json_of(one.own)},
                       {"common", json_of(one.common)}};
            if (one.median_corner_px())
                entry["median_corner_rms_px"] = one.median_corner_px()->value;
            for (const SizeClass& size : one.sizes)
                entry["sizes"].push_back(json_of(size));
            detectors.push_back(entry);
        }
        variants.push_back({{"variant", description.variants[v]},
                            {"common_poses", summary.common[v]},
                            {"detectors", detectors}});
    }
    const Json json{
        {"etalon", "study-summary/1"}, {"version", version},
        {"id", description.id},        {"poses", description.poses},
        {"refused", results.refused},  {"made_from", Json::parse(description.made_from)},
        {"variants", variants}};
    return text_of(json) + "\n";
}

}  // namespace etalon
