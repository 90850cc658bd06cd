// `etalon render --poses`: an image set.
#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "core/program/errors.h"
#include "report/json_text.h"
#include "station/render/image_set.h"
#include "station/render/render_set.h"
#include "station/shell/command_output.h"
#include "station/shell/signals.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

void print_summary(const RenderArguments& arguments, const SetResult& result, double seconds) {
    fmt::print(stderr, "{}: {} images rendered, {} were there, {} poses refused ({:.1f} s)\n",
               arguments.out.string(), result.rendered, result.already_there, result.refused,
               seconds);
    if (result.refused > 0)
        fmt::print(stderr, "{}\nthe reasons are in {}\n", result.first_refusal,
                   (arguments.out / "images.jsonl").string());
}

void print_json(const RenderArguments& arguments, const SetResult& result, double seconds) {
    const ordered_json json{{"etalon", "render-set/1"},    {"folder", arguments.out.string()},
                            {"rendered", result.rendered}, {"already_there", result.already_there},
                            {"refused", result.refused},   {"seconds", seconds}};
    fmt::print("{}\n", text_of(json));
}

}  // namespace

int run_render_merge(const RenderMergeArguments& arguments) {
    const MergedImages merged = merge_image_sets(arguments.shards, arguments.out);
    fmt::print(stderr, "{}: {} images merged, {} poses refused\n", arguments.out.string(),
               merged.images, merged.refused);
    if (arguments.json)
        fmt::print("{}\n", text_of(ordered_json{{"etalon", "render-merge/1"},
                                                {"folder", arguments.out.string()},
                                                {"images", merged.images},
                                                {"refused", merged.refused}}));
    return 0;
}

int run_render_set(const RenderArguments& arguments) {
    std::stop_source stop;
    const StopOnSignals signals(stop);
    if (arguments.explain)
        throw ConfigError({"--explain"},
                          "with --poses every image's plan is in the folder's images.jsonl");
    StderrProgress progress;
    const auto began = std::chrono::steady_clock::now();
    const SetResult result = render_set(arguments, stop.get_token(), progress);
    const double seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
    print_summary(arguments, result, seconds);
    if (!result.complete)
        throw Interrupted();
    if (result.rendered + result.already_there == 0)
        throw ConfigError({arguments.pose_file.string()}, "none of its poses can be rendered");
    if (arguments.json)
        print_json(arguments, result, seconds);
    return 0;
}

}  // namespace etalon
