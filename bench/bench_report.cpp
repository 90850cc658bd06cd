#include "bench/bench_report.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include <fstream>
#include <thread>

#include "core/config/json_entry.h"
#include "core/file/text.h"
#include "report/json_text.h"
#include "report/result_table.h"
#include "report/svg_plot.h"

namespace etalon {

ETALON_MEMBERS_TO_JSON(BenchCheck, what, figure, reached)

namespace {

constexpr const char* bench_kind = "bench/1";

// What docs/performance.md promises.
constexpr double allowed_sigmas = 4.0;  // of the reference, beyond 0.1 gray
constexpr double max_edge_shift_px = 1e-3;
constexpr double slowest_baseline_ns = 9.0;
constexpr double rms_ratio = 60.0;
constexpr double throughput_ratio = 15.0;
constexpr double min_cores_used = 1.8;
constexpr double max_memory_growth = 1.05;

double time_ratio(const std::string& scene) {
    for (const auto& [kind, ratio] :
         {std::pair{"webcam", 15.0}, {"canon", 12.0}, {"sharp", 8.0}, {"focus", 4.0}})
        if (scene.starts_with(kind))
            return ratio;
    return 3.0;
}

// Error as far as the reference can tell.
double told_error(const BenchRow& row) {
    return std::max(row.error.corrected_rms_gray(), row.error.reference_rms_gray);
}

bool beats(const BenchRow& a, const BenchRow& b) {
    return a.cpu_ms < b.cpu_ms && told_error(a) < told_error(b);
}

std::string row_name(const BenchRow& row) {
    return row.method == "default" ? row.method : row.method + " " + row.setting;
}

std::vector<BenchScene> all_scenes(const BenchResult& result) {
    std::vector<BenchScene> scenes = result.scenes;
    if (result.cloud)
        scenes.push_back(*result.cloud);
    return scenes;
}

struct ShownRow : BenchRow {
    double ns_per_pixel;  // of the scene's refined pixels
    std::optional<double> ratio;
};

ResultTable rows_table(const BenchResult& result) {
    const auto of_error = [](auto figure) {
        return [=](const ShownRow& row) { return std::invoke(figure, row.error); };
    };
    using Error = RenderComparison;
    const ColumnsOf<ShownRow> columns = {
        {"scene", &ShownRow::scene, "scene"},
        {"method", &ShownRow::method},
        {"setting", &ShownRow::setting},
        {"", row_name, "method and setting"},
        {"cpu_ms", &ShownRow::cpu_ms, "CPU ms", "", "{:.3g}"},
        {"rms", of_error(&Error::rms_gray), "RMS", "", "{:.4f}"},
        {"p99", of_error(&Error::p99_gray), "p99", "", "{:.3f}"},
        {"max", of_error(&Error::max_gray), "max", "", "{:.3f}"},
        {"edge_shift_px", of_error(&Error::edge_shift_px), "edge shift, px", "", "{:.2g}"},
        {"ns_per_pixel", &ShownRow::ns_per_pixel, "ns per refined px", "", "{:.0f}"},
        {"corrected_rms", of_error(&Error::corrected_rms_gray)},
        {"reference_se", of_error(&Error::reference_rms_gray)},
        {"", &ShownRow::ratio, "published takes", "", "{:.2f}"}};
    std::vector<ShownRow> rows;
    for (const BenchScene& scene : all_scenes(result))
        for (const BenchRow& row : scene.rows)
            rows.push_back({row, 1e6 * row.cpu_ms / std::max(1, scene.refined_pixels),
                            scene.ratio_to_published(row)});
    return table_of(columns, rows);
}

BenchCheck at_least(const std::string& what, double value, double limit) {
    return {what, fmt::format("{:.3g}, at least {:g}", value, limit), value >= limit};
}

BenchCheck at_most(const std::string& what, double value, double limit) {
    return {what, fmt::format("{:.3g}, at most {:g}", value, limit), value <= limit};
}

// Without the reference's own noise the default's error may come out as nothing at all.
BenchCheck rms_check(const std::string& scene, double published_rms_gray,
                     const RenderComparison& error) {
    const std::string what = scene + ": RMS of published n256 over default's";
    const double rms = error.corrected_rms_gray();
    if (rms > 0.0)
        return at_least(what, published_rms_gray / rms, rms_ratio);
    return {what,
            fmt::format("{:.3g} gray over less than the reference can tell ({:.2g} gray of noise)",
                        published_rms_gray, error.reference_rms_gray),
            true};
}

void add_error_checks(const BenchScene& scene, std::vector<BenchCheck>& checks) {
    const RenderComparison& error = scene.default_row().error;
    checks.push_back(
        {scene.name + ": max <= 0.1 gray + 4 s.e.",
         fmt::format("max {:.3f}, {:.1f} s.e. above 0.1", error.max_gray, error.max_sigmas),
         error.max_sigmas <= allowed_sigmas});
    checks.push_back(at_most(scene.name + ": edge position, px RMS", error.corrected_shift_px(),
                             max_edge_shift_px));
    if (const BenchRow* published = scene.row("published", published_setting))
        checks.push_back(rms_check(scene.name, published->error.rms_gray, error));
}

void add_speed_checks(const BenchScene& scene, std::vector<BenchCheck>& checks) {
    const auto ratio = scene.ratio_to_published(scene.default_row());
    if (!ratio)
        return;
    checks.push_back(at_least(scene.name + ": time of published n256 over default's", *ratio,
                              time_ratio(scene.name)));
    checks.push_back(
        at_most(scene.name + ": baseline, ns per ray", scene.ns_per_ray, slowest_baseline_ns));
}

SvgPlot panel(const BenchScene& scene) {
    SvgPlot plot("CPU time of a frame, ms (one thread)", scene.name + ": RMS error, gray");
    plot.set_log_axes();
    const std::vector<std::pair<std::string, Color>> methods{
        {"default", Color::red},
        {"E", Color::blue},
        {"C", Color::green},
        {"published", Color::orange},
        {"published-linearised", Color::orange},
        {"qmc", Color::gray}};
    for (const auto& [method, color] : methods) {
        Series curve;
        for (const BenchRow& row : scene.rows)
            if (row.method == method)
                curve.add(row.cpu_ms, row.error.rms_gray,
                          fmt::format("{}: {:.3g} ms, {:.3g} gray", row_name(row), row.cpu_ms,
                                      row.error.rms_gray));
        plot.add_curve(curve, color, method);
    }
    plot.add_level(scene.default_row().error.reference_rms_gray, Color::gray,
                   "the reference's own standard error");
    return plot;
}

Json throughput_json(const Throughput& t) {
    return {{"frames", t.by_default.frames},
            {"frames_per_s", t.by_default.frames_per_s},
            {"cores_used", t.by_default.cores_used},
            {"refused", t.refused},
            {"published_frames", t.by_published.frames},
            {"published_frames_per_s", t.by_published.frames_per_s},
            {"ratio", t.ratio()},
            {"early_peak_mib", t.early_peak_mib},
            {"final_peak_mib", t.final_peak_mib}};
}

// "AMD EPYC 9B14, 2 processors".
std::string machine_name() {
    constexpr std::string_view key = "model name";
    std::ifstream file("/proc/cpuinfo");
    std::string line, model = "unknown processor";
    while (std::getline(file, line))
        if (const auto colon = line.find(':'); line.starts_with(key) && colon != line.npos) {
            model = trimmed(line.substr(colon + 1));
            break;
        }
    return fmt::format("{}, {} processors", model, std::thread::hardware_concurrency());
}

std::string compiler_with_flags() {
    const std::vector<SoftwareVersion> versions = software_versions();
    const auto compiler = std::ranges::find(versions, "compiler", &SoftwareVersion::name);
    return fmt::format("{} {}", compiler->version, ETALON_COMPILER_FLAGS);
}

std::string scene_words(const BenchScene& scene) {
    const RenderComparison& error = scene.default_row().error;
    std::string text = fmt::format(
        "{}: max {:.3f} gray <= 0.1 + 4 s.e.: {}; edge shift {:.1e} px\n"
        "  reference s.e. {:.4f} gray, {:.1e} px; without it RMS {:.4f}, shift {:.1e}\n",
        scene.name, error.max_gray, error.max_sigmas <= allowed_sigmas ? "ok" : "FAIL",
        error.edge_shift_px, error.reference_rms_gray, error.reference_shift_px,
        error.corrected_rms_gray(), error.corrected_shift_px());
    if (scene.ns_per_ray > 0.0)
        text += fmt::format("  caches {:.1f} ms; {} refined px; baseline {:.2f} ns per ray\n",
                            scene.cache_ms, scene.refined_pixels, scene.ns_per_ray);
    for (const std::string& what : scene.left_out)
        text += "  left out: " + what + "\n";
    return text;
}

std::string throughput_words(const std::string& name, const Throughput& t) {
    const RenderRate &ours = t.by_default, &published = t.by_published;
    return fmt::format(
        "{}: {:.1f} frames/s over {} poses, {:.2f} cores used\n"
        "  published n256: {:.1f} frames/s over {} of them, {:.2f} cores used: {:.1f}x\n"
        "  peak memory {:.1f} MiB after a tenth, {:.1f} MiB at the end\n",
        name, ours.frames_per_s, ours.frames, ours.cores_used, published.frames_per_s,
        published.frames, published.cores_used, t.ratio(), t.early_peak_mib, t.final_peak_mib);
}

std::optional<double> default_ratio(const BenchScene& scene) {
    return scene.ratio_to_published(scene.default_row());
}

bool is_slower(const BenchScene& before, const BenchScene& now, double margin) {
    constexpr double errors = 3.0;
    const auto then = default_ratio(before), ratio = default_ratio(now);
    if (!ratio || !then)
        return false;
    const double noise = errors * std::hypot(before.ratio_error, now.ratio_error);
    return std::log(*then / *ratio) > std::max(-std::log1p(-margin), noise);
}

}  // namespace

std::vector<BenchCheck> bench_checks(const BenchResult& result) {
    std::vector<BenchCheck> checks;
    for (const BenchScene& scene : all_scenes(result))
        add_error_checks(scene, checks);
    if (result.cloud)
        checks.push_back(at_most("cloud: poses refused", result.cloud->refused_poses, 0.0));
    for (const BenchScene& scene : result.scenes)
        add_speed_checks(scene, checks);
    if (const auto& t = result.throughput) {
        checks.push_back(
            at_least("throughput over the published method's", t->ratio(), throughput_ratio));
        checks.push_back(
            at_least("throughput: cores used", t->by_default.cores_used, min_cores_used));
        checks.push_back(at_most("throughput: poses refused", t->refused, 0.0));
        checks.push_back(at_most("throughput: growth of peak memory after a tenth",
                                 t->final_peak_mib / t->early_peak_mib, max_memory_growth));
    }
    return checks;
}

std::string bench_csv(const BenchResult& result) {
    return csv_of(rows_table(result), "{:.6g}");
}

std::string bench_markdown(const BenchResult& result) {
    const ResultTable table = rows_table(result);
    const std::vector<std::string> headings = headings_of(table);
    std::string text = fmt::format("| {} |\n|", fmt::join(headings, " | "));
    for (std::size_t i = 0; i < headings.size(); ++i)
        text += "---|";
    for (const std::vector<std::string>& cells : texts_of(table))
        text += fmt::format("\n| {} |", fmt::join(cells, " | "));
    return text + "\n";
}

std::string bench_plot(const std::vector<BenchScene>& scenes) {
    std::vector<SvgPlot> panels;
    for (const BenchScene& scene : scenes)
        panels.push_back(panel(scene));
    return svg_panels(panels, 2, 640, 360);
}

std::string bench_json(const BenchResult& result) {
    Json json = {{"etalon", bench_kind},
                 {"machine", machine_name()},
                 {"compiler", compiler_with_flags()},
                 {"rows", json_rows(rows_table(result))}};
    for (const BenchScene& scene : result.scenes)
        json["scenes"].push_back({{"scene", scene.name},
                                  {"default_cpu_ms", scene.default_row().cpu_ms},
                                  {"ratio", or_null(scene.ratio_to_published(scene.default_row()))},
                                  {"ratio_error", scene.ratio_error},
                                  {"cache_ms", scene.cache_ms},
                                  {"refined_pixels", scene.refined_pixels},
                                  {"baseline_ns_per_ray", scene.ns_per_ray},
                                  {"left_out", scene.left_out}});
    add_present(json, "throughput", result.throughput, throughput_json);
    add_present(json, "wide_throughput", result.wide_throughput, throughput_json);
    json["checks"] = bench_checks(result);
    return text_of(json);
}

std::string pareto_words(const BenchScene& scene) {
    std::string front;
    const BenchRow* better = nullptr;
    for (const BenchRow& row : scene.rows) {
        const auto beaten = [&](const BenchRow& by) { return beats(by, row); };
        if (std::none_of(scene.rows.begin(), scene.rows.end(), beaten))
            front += (front.empty() ? "" : ", ") + row_name(row);
        if (beats(row, scene.default_row()))
            better = &row;
    }
    return fmt::format("{}: default is {} the front: {} {}faster and more exact\n  front: {}\n",
                       scene.name, better ? "not on" : "on", better ? row_name(*better) : "nothing",
                       better ? "is " : "is both ", front);
}

std::string bench_text(const BenchResult& result) {
    std::string text =
        text_table(rows_table(result), {"p99", "edge shift, px", "ns per refined px"}) + "\n";
    for (const BenchScene& scene : all_scenes(result))
        text += scene_words(scene);
    text += "\n";
    for (const BenchScene& scene : result.scenes)
        text += pareto_words(scene);
    if (result.throughput)
        text += "\n" + throughput_words("throughput", *result.throughput);
    if (result.wide_throughput)
        text += throughput_words("throughput from near focus to far", *result.wide_throughput);
    return text;
}

BenchBefore read_bench(const std::filesystem::path& path) {
    const JsonEntry root(read_text(path), {path.string()});
    if (!root.has("etalon") || root.at("etalon").text() != bench_kind)
        root.fail(std::string("is not of ") + bench_kind);
    BenchBefore before{root.at("machine").text(), root.at("compiler").text(), {}};
    for (const JsonEntry& entry : root.at("scenes").items()) {
        BenchScene& scene = before.scenes.emplace_back();
        scene.name = entry.at("scene").text();
        const double ms = entry.at("default_cpu_ms").number(positive);
        scene.rows = {{scene.name, "default", "0.1", ms, {}}};
        if (const JsonEntry ratio = entry.at("ratio"); !ratio.is_null())
            scene.rows.push_back(
                {scene.name, "published", published_setting, ms * ratio.number(positive), {}});
        scene.ratio_error = entry.at("ratio_error").number(non_negative);
    }
    return before;
}

std::vector<SpeedChange> speed_changes(const BenchBefore& before, const BenchResult& now,
                                       double margin) {
    std::vector<SpeedChange> changes;
    for (const BenchScene& scene : now.scenes) {
        const auto old = std::ranges::find(before.scenes, scene.name, &BenchScene::name);
        if (old != before.scenes.end())
            changes.push_back({*old, scene, is_slower(*old, scene, margin)});
    }
    return changes;
}

std::string against_text(const BenchBefore& before, const std::vector<SpeedChange>& changes) {
    const auto ms_of = [](const BenchScene& scene) { return scene.default_row().cpu_ms; };
    const ColumnsOf<SpeedChange> columns = {
        {"", [](const auto& change) { return change.now.name; }, "scene"},
        {"", [=](const auto& change) { return ms_of(change.before); }, "CPU ms then", "", "{:.3f}"},
        {"", [=](const auto& change) { return ms_of(change.now); }, "now", "", "{:.3f}"},
        {"", [](const auto& change) { return default_ratio(change.before); }, "ratio then", "",
         "{:.2f}"},
        {"", [](const auto& change) { return default_ratio(change.now); }, "ratio now", "",
         "{:.2f}"},
        {"", [](const auto& change) { return change.is_slower ? "SLOWER" : ""; }, "judged"}};
    return fmt::format("against {}\n  {}\n{}", before.machine, before.compiler,
                       text_table(table_of(columns, changes)));
}

}  // namespace etalon
