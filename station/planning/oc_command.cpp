// `etalon oc`: how often this station's plan gives which verdict.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cctype>
#include <nlohmann/json.hpp>

#include "core/file/file_writing.h"
#include "core/file/text.h"
#include "report/json_text.h"
#include "report/svg_plot.h"
#include "station/planning/operating_characteristic.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

struct OcArguments {
    std::filesystem::path station, out;  // out: folder for curves and JSON; empty: none
    int runs = 2000;                     // per point
    std::vector<std::string> errors;     // only these; none: all
    std::string shard;                   // "2/5"; empty: all runs
    bool json = false;
};

struct OcMergeArguments {
    std::vector<std::filesystem::path> shards;
    std::filesystem::path out;  // as of OcArguments
    bool json = false;
};

constexpr int frames_of_study = 24;

// "99.9 >99.6": the share in percent and the end of its interval that matters.
std::string at_least(const Proportion& share) {
    return fmt::format("{:5.1f} >{:4.1f}", 100.0 * share.value, 100.0 * share.low);
}

// At most 80 columns: 29 + 11 + 3 x 13.
void print_row(const ErrorCharacteristic& error, std::size_t quantity) {
    constexpr double multiples[] = {0.5, 1.0, 2.0};
    if (!error.observable) {
        fmt::print("{:<28} NOT_OBSERVABLE: {}\n", error.name, error.reason);
        return;
    }
    if (std::ranges::any_of(multiples, [&](double m) { return !point_at(error, quantity, m); })) {
        fmt::print("{:<28} no size of it was found that reaches the limit\n", error.name);
        return;
    }
    const auto share = [&](double multiple, std::size_t OutcomeCounts::*outcome) {
        return point_at(error, quantity, multiple)->quantities[quantity].counts.share(outcome);
    };
    const Proportion pass = share(1.0, &OutcomeCounts::pass);
    fmt::print("{:<28} {:>10} {:>12} {:5.2f} <{:4.2f} {:>12}\n", error.name,
               size_text(*error.limit_size[quantity], error.unit),
               at_least(share(0.5, &OutcomeCounts::pass)), 100.0 * pass.value, 100.0 * pass.high,
               at_least(share(2.0, &OutcomeCounts::fail)));
}

// U over the limit without any error, and its largest over the errors at 1x.
std::pair<double, double> relative_uncertainty(const OperatingCharacteristic& result,
                                               std::size_t quantity) {
    const double limit = result.quantities[quantity].limit;
    double largest = 0.0;
    for (const ErrorCharacteristic& error : result.errors)
        if (const CharacteristicPoint* point = point_at(error, quantity, 1.0))
            largest = std::max(largest, point->quantities[quantity].mean_uncertainty / limit);
    return {result.without_error.quantities[quantity].mean_uncertainty / limit, largest};
}

void print_quantity(const OperatingCharacteristic& result, std::size_t k) {
    const JudgedQuantity& quantity = result.quantities[k];
    const auto [without, at_limit] = relative_uncertainty(result, k);
    fmt::print("\n{}: limit {:.4g} {}, U / limit {:.3f}, at 1x {:.3f} at most\n", quantity.name,
               quantity.limit, quantity.unit, without, at_limit);
    fmt::print("{:<28} {:>10} {:>12} {:>12} {:>12}\n", "error", "1x", "PASS at 0.5x", "PASS at 1x",
               "FAIL at 2x");
    for (const ErrorCharacteristic& error : result.errors)
        print_row(error, k);
}

void print_text(const StationCharacteristic& studied) {
    const OperatingCharacteristic& result = studied.result;
    fmt::print("operating characteristic of {}: {} poses, {} runs a point\n{}", studied.station,
               studied.detector.asked, result.runs, detector_text(studied.detector));
    const Proportion pass = result.without_error.verdict.share(&OutcomeCounts::pass);
    fmt::print("without any error the verdict is PASS in {:.2f} % of runs ({:.2f} to {:.2f})\n",
               100.0 * pass.value, 100.0 * pass.low, 100.0 * pass.high);
    for (std::size_t k = 0; k < result.quantities.size(); ++k)
        print_quantity(result, k);
    fmt::print("\nshares in %, with the end of the 95 % interval that counts\n");
    for (const ErrorCharacteristic& error : result.errors)
        if (!error.alike.empty())
            fmt::print("{} stands also for: {}\n", error.name, fmt::join(error.alike, ", "));
}

Json json_of(const OutcomeCounts& counts) {
    const auto share = [&](std::size_t OutcomeCounts::*outcome) {
        const Proportion s = counts.share(outcome);
        return Json{{"runs", s.count}, {"share", s.value}, {"low", s.low}, {"high", s.high}};
    };
    return {{"PASS", share(&OutcomeCounts::pass)},
            {"FAIL", share(&OutcomeCounts::fail)},
            {"INCONCLUSIVE", share(&OutcomeCounts::other)}};
}

Json json_of(const CharacteristicPoint& point, const OperatingCharacteristic& result) {
    Json quantities = Json::object();
    for (std::size_t k = 0; k < point.quantities.size(); ++k) {
        const QuantityOutcomes& one = point.quantities[k];
        Json entry = json_of(one.counts);
        entry["mean_value"] = one.mean_value;
        entry["mean_uncertainty"] = one.mean_uncertainty;
        quantities[result.quantities[k].name] = entry;
    }
    return {{"size", point.size},
            {"verdict", json_of(point.verdict)},
            {"refused", point.refused},
            {"quantities", quantities}};
}

Json json_of(const ErrorCharacteristic& error, const OperatingCharacteristic& result) {
    Json entry = {{"name", error.name}, {"unit", error.unit}, {"alike", error.alike}};
    entry["outcome"] = error.observable ? "OBSERVABLE" : "NOT_OBSERVABLE";
    if (!error.observable)
        entry["reason"] = error.reason;
    Json sizes = Json::object();
    for (std::size_t k = 0; k < error.limit_size.size(); ++k)
        sizes[result.quantities[k].name] = or_null(error.limit_size[k]);
    entry["limit_size"] = sizes;
    entry["points"] =
        json_list(error.points, [&](const auto& point) { return json_of(point, result); });
    return entry;
}

Json json_of(const StationCharacteristic& studied) {
    const OperatingCharacteristic& result = studied.result;
    const DetectorFigures& detector = studied.detector;
    Json quantities = Json::array();
    for (std::size_t k = 0; k < result.quantities.size(); ++k) {
        const auto [without, at_limit] = relative_uncertainty(result, k);
        quantities.push_back({{"name", result.quantities[k].name},
                              {"unit", result.quantities[k].unit},
                              {"limit", result.quantities[k].limit},
                              {"uncertainty_over_limit", without},
                              {"uncertainty_over_limit_at_1x", at_limit}});
    }
    return {{"etalon", "operating-characteristic/1"},
            {"station", studied.station},
            {"poses", detector.asked},
            {"runs", result.runs},
            {"seed", result.seed},
            {"detector",
             {{"noise_px", detector.noise_px},
              {"bias_px", detector.bias_px},
              {"noise_bias_px", detector.noise_bias_px},
              {"noisy_frames", detector.frames}}},
            {"quantities", quantities},
            {"without_error", json_of(result.without_error, result)},
            {"errors",
             json_list(result.errors, [&](const auto& error) { return json_of(error, result); })}};
}

// Shares of PASS and FAIL of one quantity over the size of the error, in its 1x.
std::string curve(const OperatingCharacteristic& result, const ErrorCharacteristic& error,
                  std::size_t quantity) {
    Series pass, fail;
    const auto add = [&](double size, const OutcomeCounts& counts) {
        const Proportion share = counts.share(&OutcomeCounts::pass);
        pass.add(size, share.value, share.low, share.high);
        fail.add(size, counts.share(&OutcomeCounts::fail).value);
    };
    add(0.0, result.without_error.quantities[quantity].counts);
    for (const CharacteristicPoint& point : error.points)
        add(point.size / *error.limit_size[quantity], point.quantities[quantity].counts);
    SvgPlot plot(
        fmt::format("{} over {}", error.name, size_text(*error.limit_size[quantity], error.unit)),
        "share of runs");
    plot.set_y_range(0.0, 1.0);
    plot.add_band(pass, Color::green, "95 % interval");
    plot.add_line(pass, Color::green, "PASS");
    plot.add_line(fail, Color::red, "FAIL");
    return plot.svg(true);
}

void write_files(const std::filesystem::path& folder, const Json& json,
                 const OperatingCharacteristic& result) {
    ReportFolder report(folder, "oc");
    write_text(report / "operating-characteristic.json", json.dump(1) + "\n");
    for (const ErrorCharacteristic& error : result.errors)
        for (std::size_t k = 0; k < error.limit_size.size(); ++k) {
            if (!error.limit_size[k])
                continue;
            std::string file = error.name + "-" + result.quantities[k].name;
            for (char& c : file)
                if (!std::isalnum(static_cast<unsigned char>(c)))
                    c = '-';
            write_text(report / (file + ".svg"), curve(result, error, k));
        }
    report.finish();
}

void give(const StationCharacteristic& studied, const std::filesystem::path& out, bool json) {
    const Json text = json_of(studied);
    if (!out.empty())
        write_files(out, text, studied.result);
    if (json)
        fmt::print("{}\n", text.dump(1));
    else
        print_text(studied);
}

int run_oc(const OcArguments& arguments) {
    // `merge` needs none, so that the command line cannot require it.
    if (arguments.station.empty())
        throw ConfigError({}, "STATION is required");
    const Shard shard = parse_shard(arguments.shard);
    if (!shard.is_all() && arguments.out.empty())
        throw ConfigError({"--out"}, "is required: a shard's runs are merged from its folder");
    const auto simulator = study_plan(arguments.station, frames_of_study);
    CharacteristicRequest request;
    request.runs = arguments.runs;
    request.errors = arguments.errors;
    const CharacteristicRuns runs(*simulator, request);
    StationCharacteristic result = characteristic_of(*simulator, runs.planned());
    std::optional<RowRecord> record;
    if (!shard.is_all())
        record.emplace(arguments.out, oc_rows(result, shard));
    std::vector<std::size_t> missing;
    for (std::size_t i = record ? record->units_done() : 0;
         i < shard.units(static_cast<std::size_t>(arguments.runs)); ++i)
        missing.push_back(shard.index - 1 + i * shard.count);
    StderrProgress progress;
    if (!missing.empty())
        progress.begin("simulating", static_cast<int>(missing.size()));
    runs.simulate(missing, [&](std::size_t run, std::span<const PointRun> points) {
        if (record)
            record->add(rows_of_run(run, points));
        else
            add_run(result.result, points);
        progress.step();
    });
    progress.end();
    if (record)
        fmt::print("shard {}\n", (arguments.out / "results.csv").string());
    else
        give(result, arguments.out, arguments.json);
    return 0;
}

int run_oc_merge(const OcMergeArguments& arguments) {
    give(merged_characteristic(arguments.shards), arguments.out, arguments.json);
    return 0;
}

}  // namespace

void declare_oc(Command& program) {
    auto [command, asked] = program.add(
        run_oc, "oc", "operating characteristic: what its PASS means",
        "Simulates thousands of runs with errors of known size put in, and prints how\n"
        "often each judged quantity comes out as PASS and FAIL. 1x is the size whose\n"
        "field just reaches the quantity's limit. About 15 ms of CPU a run; --runs 200\n"
        "for a first look. Explained in docs/operating-characteristic.md.\n\n"
        "Examples:\n"
        "  etalon oc examples/demo/station.yaml --error \"focal length\"\n"
        "  etalon oc station.yaml --runs 100000 --shard 2/5 --out part-2\n");
    command.option("STATION", asked->station, "station.yaml");
    command.option("--runs", asked->runs, "of each error and size (default 2000)", "N")
        .within(1, 1000000);
    command
        .option("--error", asked->errors,
                "an error by its name; may be repeated\n(default: all, one of each group)", "NAME")
        .one_each();
    command.option("--out", asked->out, "folder for the curves (SVG) and the JSON", "DIR");
    command.option(
        "--shard", asked->shard,
        "only part I of N: every N-th run, to be merged;\nkilled, the same command goes on", "I/N");
    auto [merge, merged] = command.add(
        run_oc_merge, "merge", "put the shards of an operating characteristic together",
        "All shards, in any order. Prints what the runs in one process print, byte for\n"
        "byte.\n\n"
        "Example:\n  etalon oc merge part-1 part-2 part-3 --out curves\n");
    merge.required("SHARDS", merged->shards, "folders of `etalon oc --shard`");
    merge.option("--out", merged->out, "folder for the curves (SVG) and the JSON", "DIR");
}

}  // namespace etalon
