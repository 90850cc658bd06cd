#include "study/study_summary.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>

#include "compare/expect/pose_statistics.h"
#include "core/program/errors.h"
#include "core/program/version.h"
#include "report/csv.h"
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

void judge_corners(SizeClass& one, std::vector<double> corners_px) {
    if (corners_px.empty())
        return;
    if (corners_px.size() >= min_quantile_values)
        one.corner_quantile_px = quantile_95(corners_px);
    one.median_corner_px = median_estimate(corners_px);
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
        judge_corners(one, std::move(corners_px));
    }
    return result;
}

std::string size_words(const SizeClass& one) {
    if (one.to_px)
        return one.from_px > 0.0 ? fmt::format("{:g} to {:g}", one.from_px, *one.to_px)
                                 : fmt::format("below {:g}", *one.to_px);
    return one.from_px > 0.0 ? fmt::format("from {:g}", one.from_px) : "all";
}

namespace {

using nlohmann::ordered_json;

constexpr std::uint64_t bootstrap_seed = 1;

struct NamedEstimate {
    const char* name;
    const Estimate ErrorStatistics::*value;
};
constexpr std::array<NamedEstimate, 4> estimates = {
    {{"mean", &ErrorStatistics::mean},
     {"mean |error|", &ErrorStatistics::mean_absolute},
     {"median", &ErrorStatistics::median},
     {"median |error|", &ErrorStatistics::median_absolute}}};

double percent(const std::optional<Proportion>& share) {
    return share ? 100.0 * share->value : 0.0;
}

// ------------------------------------------------------------------------------------- for people

std::string detection_lines(const StudyDescription& description,
                            const std::vector<DetectorSummary>& detectors) {
    std::string text =
        fmt::format("{:<22}{:>10}{:>16}{:>10}{:>12}\n", "", "detected", "95 %", "flips", "corners");
    for (std::size_t i = 0; i < detectors.size(); ++i) {
        const DetectorSummary& one = detectors[i];
        text += fmt::format(
            "{:<22.21}{:>8.2f} %{:>16}{:>8.2f} %{:>12}\n", description.detectors[i].name,
            percent(one.own.detected),
            one.own.detected ? fmt::format("{:.2f}-{:.2f}", 100.0 * one.own.detected->low,
                                           100.0 * one.own.detected->high)
                             : "",
            percent(one.own.flips),
            one.median_corner_px() ? figure_text(one.median_corner_px()->value) + " px" : "-");
    }
    return text;
}

// Nothing where a statistic has no value.
using Value = std::optional<Estimate> (*)(const ErrorStatistics&);
constexpr std::array<std::pair<const char*, Value>, 4> statistics_of_table = {{
    {"mean", [](const ErrorStatistics& s) { return std::optional(s.mean); }},
    {"std", [](const ErrorStatistics& s) { return s.standard_deviation; }},
    {"mean |error|", [](const ErrorStatistics& s) { return std::optional(s.mean_absolute); }},
    {"median |error|", [](const ErrorStatistics& s) { return std::optional(s.median_absolute); }},
}};

std::string error_lines(const std::string& name, const PoseStatistics& statistics) {
    if (!statistics.all)
        return fmt::format("{:<16.15}nothing to tell\n", name);
    std::string text;
    for (const std::vector<std::string>& row : error_table(statistics)) {
        text += fmt::format("{:<16.15}{:<15}", text.empty() ? name : "", row.front());
        for (std::size_t k = 1; k < row.size(); ++k)
            text += fmt::format("{:>8}", row[k]);
        text += "\n";
    }
    return text;
}

// What an ablation is for: one line per detector and variant.
std::string variant_lines(const StudyDescription& description, const StudySummary& summary) {
    std::string text =
        fmt::format("\n{:<16}{:<14}{:>9}{:>10}{:>9}{:>9}{:>10}\n", "each on its common", "",
                    "detected", "mean X", "mean Y", "mean Z", "median");
    text += fmt::format("{:<16}{:<14}{:>9}{:>12}{:>9}{:>9}{:>10}\n", "poses", "switched", "%", "mm",
                        "mm", "mm", "|angle|");
    for (std::size_t i = 0; i < description.detectors.size(); ++i)
        for (std::size_t v = 0; v < description.variants.size(); ++v) {
            const DetectorSummary& one = summary.detectors[v][i];
            text +=
                fmt::format("{:<16.15}{:<14}{:>9.2f}", v == 0 ? description.detectors[i].name : "",
                            description.variants[v], percent(one.own.detected));
            if (one.common.all)
                text += fmt::format("{:>12}{:>9}{:>9}{:>10}",
                                    figure_text((*one.common.all)[0].mean.value),
                                    figure_text((*one.common.all)[1].mean.value),
                                    figure_text((*one.common.all)[2].mean.value),
                                    figure_text((*one.common.all)[7].median_absolute.value));
            text += "\n";
        }
    return text;
}

// ------------------------------------------------------------------------------------------- JSON

ordered_json json_of(const std::optional<Proportion>& share) {
    if (!share)
        return nullptr;
    return {{"count", share->count},
            {"of", share->trials},
            {"value", share->value},
            {"low", share->low},
            {"high", share->high}};
}

ordered_json json_of(const Estimate& estimate) {
    ordered_json json{{"value", estimate.value}};
    if (estimate.interval) {
        json["low"] = estimate.interval->low;
        json["high"] = estimate.interval->high;
    }
    return json;
}

ordered_json json_of(const MeasureStatistics& measures) {
    ordered_json json = ordered_json::object();
    for (std::size_t k = 0; k < measures.size(); ++k) {
        ordered_json entry{{"unit", error_measures[k].unit}};
        for (const NamedEstimate& one : estimates)
            entry[one.name] = json_of(measures[k].*one.value);
        if (measures[k].standard_deviation)
            entry["std"] = json_of(*measures[k].standard_deviation);
        json[error_measures[k].name] = entry;
    }
    return json;
}

ordered_json json_of(const PoseStatistics& statistics) {
    ordered_json json{{"poses", statistics.poses},
                      {"detected", json_of(statistics.detected)},
                      {"flips", json_of(statistics.flips)}};
    if (statistics.all)
        json["errors"] = json_of(*statistics.all);
    if (statistics.without_flips)
        json["errors_without_flips"] = json_of(*statistics.without_flips);
    return json;
}

ordered_json json_of(const SizeClass& one) {
    ordered_json json{{"from_px", one.from_px},
                      {"to_px", nullptr},
                      {"poses", one.poses},
                      {"detected", json_of(one.detected)}};
    if (one.to_px)
        json["to_px"] = *one.to_px;
    if (one.median_corner_px)
        json["median_corner_rms_px"] = json_of(*one.median_corner_px);
    if (one.corner_quantile_px)
        json["quantile95_corner_rms_px"] = *one.corner_quantile_px;
    return json;
}

// -------------------------------------------------------------------------------------------- CSV

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
        text += fmt::format("{}{},{},{},{},{},{},{},{},,,\n", start, statistics.poses,
                            statistics.detected ? statistics.detected->count : 0,
                            error_measures[k].name, error_measures[k].unit, csv_cell(s.mean),
                            csv_cell(s.standard_deviation), csv_cell(s.mean_absolute),
                            csv_cell(s.median_absolute));
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

std::vector<std::vector<std::string>> error_table(const PoseStatistics& statistics) {
    std::vector<std::vector<std::string>> table;
    for (const auto& [statistic, value_of] : statistics_of_table) {
        if (!statistics.all)
            break;
        std::vector<std::string>& row = table.emplace_back(1, statistic);
        for (std::size_t k = 0; k < pose_component_count; ++k) {
            const auto estimate = value_of((*statistics.all)[k]);
            row.push_back(estimate ? figure_text(estimate->value) : "-");
        }
    }
    return table;
}

std::string figure_text(double value) {
    const double size = std::abs(value);
    return size < 0.00005 ? "0"
           : size < 1.0   ? fmt::format("{:.4f}", value)
           : size < 10.0  ? fmt::format("{:.3f}", value)
           : size < 100.0 ? fmt::format("{:.2f}", value)
                          : fmt::format("{:.1f}", value);
}

std::string summary_text(const StudyResults& results, const StudySummary& summary) {
    const StudyDescription& description = results.description;
    std::string text = fmt::format("study {}: {} poses\n{}\n", description.id, description.poses,
                                   detection_lines(description, summary.detectors[0]));
    text += fmt::format("{:<31}{:>8}{:>8}{:>8}{:>8}{:>8}{:>8}\n",
                        fmt::format("on {} poses that all detect", summary.common[0]), "X mm",
                        "Y mm", "Z mm", "roll", "pitch", "yaw deg");
    for (std::size_t i = 0; i < description.detectors.size(); ++i)
        text += error_lines(description.detectors[i].name, summary.detectors[0][i].common);
    if (description.variants.size() > 1)
        text += variant_lines(description, summary);
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
    ordered_json variants = ordered_json::array();
    for (std::size_t v = 0; v < description.variants.size(); ++v) {
        ordered_json detectors = ordered_json::array();
        for (std::size_t i = 0; i < description.detectors.size(); ++i) {
            const DetectorSummary& one = summary.detectors[v][i];
            ordered_json entry{{"name", description.detectors[i].name},
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
    const ordered_json json{
        {"etalon", "study-summary/1"}, {"version", version},
        {"id", description.id},        {"poses", description.poses},
        {"refused", results.refused},  {"made_from", ordered_json::parse(description.made_from)},
        {"variants", variants}};
    return text_of(json) + "\n";
}

}  // namespace etalon
