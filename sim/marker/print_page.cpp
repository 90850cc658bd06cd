#include "sim/marker/print_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double a4_short_mm = 210.0, a4_long_mm = 297.0;  // ISO 216
constexpr double margin_mm = 5.0;                          // what common printers leave blank
constexpr double footer_mm = 12.0;                         // below the grid: gap, bar, gap, caption
constexpr double bar_gap_mm = 3.0;                         // from the grid to the bar
constexpr double bar_height_mm = 1.5;
constexpr double max_font_mm = 3.5;
constexpr double letter_width = 0.6;  // of the em, on average and generously
constexpr std::size_t max_printed_cells = 4'000'000, max_corners = 2'000'000;

// IEC 61966-2-1.
double srgb_encoded(double radiance) {
    if (radiance <= 0.0031308)
        return 12.92 * radiance;
    return 1.055 * std::pow(radiance, 1.0 / 2.4) - 0.055;
}

cv::Size2d smallest_page(const CellGrid& grid) {
    const double width = grid.columns() * grid.cell_mm.x() + 2.0 * margin_mm;
    const double height = grid.rows() * grid.cell_mm.y() + 2.0 * margin_mm + footer_mm;
    return {std::max(width, 50.0 + 2.0 * margin_mm), height};
}

cv::Size2d page_size(cv::Size2d needed, bool own_size) {
    for (const cv::Size2d a4 :
         {cv::Size2d(a4_short_mm, a4_long_mm), cv::Size2d(a4_long_mm, a4_short_mm)}) {
        if (!own_size && needed.width <= a4.width && needed.height <= a4.height)
            return a4;
    }
    return needed;
}

// Directed edges of the boundary with the inside on their right (y down), by starting corner.
using Edges = std::map<std::pair<int, int>, std::vector<cv::Point>>;

Edges boundary_edges(const cv::Mat& mask) {
    const auto inside = [&](int x, int y) {
        return x >= 0 && y >= 0 && x < mask.cols && y < mask.rows &&
               mask.at<std::uint8_t>(y, x) != 0;
    };
    Edges edges;
    const auto add = [&](int y0, int x0, int y1, int x1) { edges[{y0, x0}].emplace_back(x1, y1); };
    for (int y = 0; y <= mask.rows; ++y) {
        for (int x = 0; x <= mask.cols; ++x) {
            const bool here = inside(x, y);
            if (here && !inside(x, y - 1))
                add(y, x, y, x + 1);
            if (!here && inside(x, y - 1))
                add(y, x + 1, y, x);
            if (here && !inside(x - 1, y))
                add(y + 1, x, y, x);
            if (!here && inside(x - 1, y))
                add(y, x, y + 1, x);
        }
    }
    return edges;
}

// Follows edges from corner to corner until back at the start; straight runs become one edge.
std::vector<cv::Point> take_loop(Edges& edges) {
    std::vector<cv::Point> loop;
    const cv::Point start(edges.begin()->first.second, edges.begin()->first.first);
    cv::Point at = start;
    do {
        const auto leaving = edges.find({at.y, at.x});
        const cv::Point next = leaving->second.back();
        leaving->second.pop_back();
        if (leaving->second.empty())
            edges.erase(leaving);
        const bool straight = loop.size() >= 2 &&
                              (loop.back() - loop[loop.size() - 2]).cross(next - loop.back()) == 0;
        if (loop.empty())
            loop.push_back(at);
        if (straight)
            loop.back() = next;
        else
            loop.push_back(next);
        at = next;
    } while (at != start);
    loop.pop_back();  // the start again
    return loop;
}

}  // namespace

PrintPage lay_out_page(const Marker& marker, bool own_size) {
    const CellGrid& grid = marker.grid;
    const cv::Size2d size = page_size(smallest_page(grid), own_size);
    PrintPage page;
    page.width_mm = size.width;
    page.height_mm = size.height;
    const double grid_width = grid.columns() * grid.cell_mm.x();
    const double grid_height = grid.rows() * grid.cell_mm.y();
    page.grid_mm = {(size.width - grid_width) / 2.0, (size.height - footer_mm - grid_height) / 2.0};
    const double bar_mm = size.width >= 100.0 + 2.0 * margin_mm ? 100.0 : 50.0;
    const double footer_top = size.height - margin_mm - footer_mm;
    page.scale_bar_mm = {margin_mm, footer_top + bar_gap_mm, bar_mm, bar_height_mm};
    page.caption = fmt::format("{}   (bar: {} mm)", marker.spec, bar_mm);
    page.caption_mm = {margin_mm, size.height - margin_mm - 1.0};
    page.font_mm = std::min(
        max_font_mm, (size.width - 2.0 * margin_mm) / (letter_width * double(page.caption.size())));
    return page;
}

Outline outline_of(const cv::Mat& mask) {
    Edges edges = boundary_edges(mask);
    Outline outline;
    while (!edges.empty())
        outline.push_back(take_loop(edges));
    return outline;
}

cv::Mat printed_shades(const Marker& marker) {
    cv::Mat shades(marker.grid.cells.size(), CV_8UC1);
    std::transform(
        marker.grid.cells.begin<float>(), marker.grid.cells.end<float>(),
        shades.begin<std::uint8_t>(), [](float radiance) {
            return static_cast<std::uint8_t>(std::floor(srgb_encoded(radiance) * 255.0 + 0.5));
        });
    return shades;
}

std::vector<PrintLayer> print_layers(const Marker& marker) {
    const auto refuse = [&] {
        throw ConfigError({marker.spec},
                          "has too many cells and shades to be drawn as outlines: "
                          "write a .png");
    };
    if (marker.grid.cells.total() > max_printed_cells)
        refuse();
    const cv::Mat shades = printed_shades(marker);
    const std::set<int, std::greater<>> grays(shades.begin<std::uint8_t>(),
                                              shades.end<std::uint8_t>());
    std::vector<PrintLayer> layers;
    std::size_t corners = 0;
    for (const int gray : grays) {
        if (gray == 255)
            continue;
        layers.push_back({gray, outline_of(shades <= gray)});
        for (const auto& loop : layers.back().outline)
            corners += loop.size();
        if (corners > max_corners)
            refuse();
    }
    return layers;
}

}  // namespace etalon
