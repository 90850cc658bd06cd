#include "bench/bench_against.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/config/json_entry.h"
#include "core/file/text.h"

namespace etalon {
namespace {

std::string ratio_text(const std::optional<double>& ratio) {
    return ratio ? fmt::format("{:.2f}", *ratio) : "-";
}

BenchBefore::Scene read_scene(const JsonEntry& entry) {
    BenchBefore::Scene scene;
    scene.name = entry.at("scene").text();
    scene.cpu_ms = entry.at("default_cpu_ms").number(positive);
    if (const JsonEntry ratio = entry.at("ratio"); !ratio.is_null())
        scene.ratio = ratio.number(positive);
    scene.ratio_error = entry.at("ratio_error").number(non_negative);
    return scene;
}

SpeedChange change_of(const BenchBefore::Scene& before, const BenchScene& now, double margin) {
    constexpr double errors = 3.0;
    SpeedChange change{now.name, before.cpu_ms, now.default_row().cpu_ms, before.ratio, {}, false};
    const double ratio = published_over_default(now);
    if (std::isnan(ratio) || !before.ratio)
        return change;
    change.ratio_now = ratio;
    const double noise = errors * std::hypot(before.ratio_error, now.ratio_error);
    change.is_slower = std::log(*before.ratio / ratio) > std::max(-std::log1p(-margin), noise);
    return change;
}

}  // namespace

BenchBefore read_bench(const std::filesystem::path& path) {
    const JsonEntry root(read_text(path), {path.string()});
    if (!root.has("etalon") || root.at("etalon").text() != bench_kind)
        root.fail(std::string("is not of ") + bench_kind);
    BenchBefore before{root.at("machine").text(), root.at("compiler").text(), {}};
    for (const JsonEntry& entry : root.at("scenes").items())
        before.scenes.push_back(read_scene(entry));
    return before;
}

std::vector<SpeedChange> speed_changes(const BenchBefore& before, const BenchResult& now,
                                       double margin) {
    std::vector<SpeedChange> changes;
    for (const BenchScene& scene : now.scenes) {
        const auto old = std::ranges::find(before.scenes, scene.name, &BenchBefore::Scene::name);
        if (old != before.scenes.end())
            changes.push_back(change_of(*old, scene, margin));
    }
    return changes;
}

std::string against_text(const BenchBefore& before, const std::vector<SpeedChange>& changes) {
    std::string text = fmt::format("against {}\n  {}\n", before.machine, before.compiler);
    text += fmt::format("{:<14} {:>10} {:>10} {:>10} {:>10}\n", "scene", "CPU ms then", "now",
                        "ratio then", "now");
    for (const SpeedChange& change : changes)
        text +=
            fmt::format("{:<14} {:>11.3f} {:>10.3f} {:>10} {:>10}{}\n", change.scene,
                        change.cpu_ms_before, change.cpu_ms_now, ratio_text(change.ratio_before),
                        ratio_text(change.ratio_now), change.is_slower ? "  SLOWER" : "");
    return text;
}

}  // namespace etalon
