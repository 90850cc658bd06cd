#include "station/render/render_plan_text.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/file/text.h"
#include "report/json_text.h"
#include "station/render/render_view.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

constexpr std::size_t columns = 80;
constexpr std::size_t indent = 16;  // of everything but a row's name

const char* short_name(RenderMethod method) {
    const auto at =
        std::ranges::find(method_words, method, &std::pair<const char*, RenderMethod>::second);
    if (at != method_words.end())
        return at->first;
    if (method == RenderMethod::wedge_table)
        return "wedge table";
    return method == RenderMethod::edge_table ? "edge table" : "wave";
}

// A row of the table: its name, and text broken into as many lines as it needs.
std::string row(const std::string& name, const std::string& text) {
    std::string lines, line = fmt::format("  {:<{}}", name, indent - 3);
    for (const std::string& word : split(text, ' ')) {
        if (line.size() > indent && line.size() + 1 + word.size() > columns) {
            lines += line + "\n";
            line = std::string(indent - 1, ' ');
        }
        line += " " + word;
    }
    return lines + line + "\n";
}

// Of several markers: the tiles that were sampled alike together, of each omission the one that
// counts most.
std::vector<TileUse> added_up(const std::vector<TileUse>& used) {
    std::vector<TileUse> sums;
    for (const TileUse& use : used) {
        const auto alike = std::find_if(sums.begin(), sums.end(), [&](const TileUse& sum) {
            return sum.method == use.method && sum.lens_points == use.lens_points &&
                   sum.points_per_pixel_side == use.points_per_pixel_side;
        });
        if (alike == sums.end())
            sums.push_back(use);
        else
            alike->tiles += use.tiles;
    }
    return sums;
}

std::vector<LeftOut> largest_of_each(const std::vector<LeftOut>& left_out) {
    std::vector<LeftOut> largest;
    for (const LeftOut& left : left_out) {
        const auto same = std::find_if(largest.begin(), largest.end(), [&](const LeftOut& other) {
            return other.what == left.what;
        });
        if (same == largest.end())
            largest.push_back(left);
        else if (same->gray < left.gray)
            *same = left;
    }
    return largest;
}

std::string words(const TileUse& use) {
    if (use.method == RenderMethod::edge_table)
        return fmt::format("{:>8} by the table of edges", use.tiles);
    if (use.method == RenderMethod::wedge_table)
        return fmt::format("{:>8} by the table of edges and corners", use.tiles);
    const std::string lens = use.method == RenderMethod::exact_area
                                 ? fmt::format(", lens points {}", use.lens_points)
                                 : "";
    return fmt::format("{:>8} by {}, k = {}{}", use.tiles, short_name(use.method),
                       use.points_per_pixel_side, lens);
}

}  // namespace

std::string plan_table(const RenderPlan& plan) {
    std::string text = fmt::format("plan, for at most {:.3g} gray\n", plan.tolerance_gray);
    text += row("blur radius", fmt::format("{:.3g} to {:.3g} px", plan.min_blur_radius_px,
                                           plan.max_blur_radius_px));
    text += row("samples", plan.method == RenderMethod::wedge_table
                               ? fmt::format("none: a table, {:.2g} gray", plan.sampling_gray)
                               : fmt::format("{0} x {0} a pixel: {1:.2g} gray",
                                             plan.points_per_pixel_side, plan.sampling_gray));
    if (plan.border_gray > 0.0)
        text += row(
            "", fmt::format("{:.2g} gray more at the distortion model's end", plan.border_gray));
    text +=
        row("diffraction",
            plan.tail_reach_px > 0.0 ? fmt::format("to {:.0f} px", plan.tail_reach_px) : "no tail");
    std::string name = "tiles";
    for (const TileUse& use : added_up(plan.used))
        text += row(std::exchange(name, ""), words(use));
    text += row(name, fmt::format("{:>8} uniform: one number each", plan.uniform_tiles));
    name = "left out";
    for (const LeftOut& left : largest_of_each(plan.left_out))
        if (left.what != NeglectedEffect::uniform_tiles)  // told above
            text +=
                row(std::exchange(name, ""),
                    fmt::format("{}: {} ({:.2g} gray)", name_of(left.what), left.why, left.gray));
    return text;
}

std::string plan_json(const RenderPlan& plan) {
    const auto use_json = [](const TileUse& use) -> ordered_json {
        return {{"method", short_name(use.method)},
                {"k", use.points_per_pixel_side},
                {"lens_points", use.lens_points},
                {"tiles", use.tiles}};
    };
    const auto left_json = [](const LeftOut& left) -> ordered_json {
        return {{"what", name_of(left.what)}, {"why", left.why}, {"gray", left.gray}};
    };
    const ordered_json json{{"summary", plan.describe()},
                            {"tolerance_gray", plan.tolerance_gray},
                            {"sampling_gray", plan.sampling_gray},
                            {"border_gray", plan.border_gray},
                            {"blur_radius_px", {plan.min_blur_radius_px, plan.max_blur_radius_px}},
                            {"tail_reach_px", plan.tail_reach_px},
                            {"tiles", json_list(added_up(plan.used), use_json)},
                            {"uniform_tiles", plan.uniform_tiles},
                            {"left_out", json_list(largest_of_each(plan.left_out), left_json)},
                            {"instructions", plan.instructions}};
    return json.dump();
}

}  // namespace etalon
