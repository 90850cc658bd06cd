#include "report/heat_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "core/file/text.h"
#include "report/svg_plot.h"

namespace etalon {
namespace {

constexpr double left_px = 44, top_px = 12, bottom_px = 36, map_width = 420, scale_width = 14,
                 right_px = 66;

struct Colour {
    double red, green, blue;
};

// Every eighth of viridis.
constexpr std::array<Colour, 9> viridis{{{68, 1, 84},
                                         {71, 44, 122},
                                         {59, 81, 139},
                                         {44, 113, 142},
                                         {33, 144, 141},
                                         {39, 173, 129},
                                         {92, 200, 99},
                                         {170, 220, 50},
                                         {253, 231, 37}}};

std::string colour(double share) {
    const double place = std::clamp(share, 0.0, 1.0) * (viridis.size() - 1.0);
    const auto below = std::min(static_cast<std::size_t>(place), viridis.size() - 2);
    const double part = place - static_cast<double>(below);
    const auto mixed = [&](double Colour::*channel) {
        return static_cast<int>(std::lround((1.0 - part) * viridis[below].*channel +
                                            part * viridis[below + 1].*channel));
    };
    return fmt::format("#{:02x}{:02x}{:02x}", mixed(&Colour::red), mixed(&Colour::green),
                       mixed(&Colour::blue));
}

// From image coordinates to those of the drawing.
struct Placement {
    double scale;

    double x(double pixel) const { return left_px + scale * (pixel + 0.5); }
    double y(double pixel) const { return top_px + scale * (pixel + 0.5); }
};

constexpr double seam = 0.5;  // that neighbours overlap by, so that no gap shows

std::string cell(const HeatMap& map, std::size_t i, const Placement& place) {
    const Eigen::Vector2d& centre = map.centres[i];
    const double x0 = place.x(std::max(-0.5, centre.x() - 0.5 * map.cell_width));
    const double x1 = place.x(std::min(map.image_width - 0.5, centre.x() + 0.5 * map.cell_width));
    const double y0 = place.y(std::max(-0.5, centre.y() - 0.5 * map.cell_height));
    const double y1 = place.y(std::min(map.image_height - 0.5, centre.y() + 0.5 * map.cell_height));
    return fmt::format(
        "<rect x='{:.1f}' y='{:.1f}' width='{:.1f}' height='{:.1f}' fill='{}'><title>({:.0f}, "
        "{:.0f}): {:.3f} {}</title></rect>",
        x0, y0, x1 - x0 + seam, y1 - y0 + seam, colour(map.values[i] / map.highest), centre.x(),
        centre.y(), map.values[i], escape_html(map.unit));
}

// Image coordinates at the border, at round numbers.
std::string axes(const HeatMap& map, const Placement& place) {
    const int longer = std::max(map.image_width, map.image_height);
    const double step = round_scale(longer / 4.0);
    std::string text;
    const double end_y = place.y(map.image_height - 0.5);
    for (double tick = 0; tick < map.image_width; tick += step)
        text += fmt::format("<text x='{:.1f}' y='{:.1f}' text-anchor='middle'>{:g}</text>",
                            place.x(tick), end_y + 16, tick);
    for (double tick = 0; tick < map.image_height; tick += step)
        text += fmt::format("<text x='{:.1f}' y='{:.1f}' text-anchor='end'>{:g}</text>",
                            left_px - 6, place.y(tick) + 4, tick);
    return text + fmt::format("<text x='{:.1f}' y='{:.1f}' text-anchor='middle'>x / {}</text>",
                              left_px + 0.5 * map_width, end_y + 32, escape_html(map.axis_unit));
}

std::string scale_bar(const HeatMap& map, double height) {
    constexpr int steps = 32;
    const double x = left_px + map_width + 12;
    std::string text;
    for (int i = 0; i < steps; ++i)
        text += fmt::format("<rect x='{:.1f}' y='{:.2f}' width='{}' height='{:.2f}' fill='{}'/>", x,
                            top_px + height * (1.0 - (i + 1.0) / steps), scale_width,
                            height / steps + 0.3, colour((i + 0.5) / steps));
    for (const double share : {0.0, 0.5, 1.0})
        text += fmt::format("<text x='{:.1f}' y='{:.1f}'>{:.2g}{}</text>", x + scale_width + 5,
                            top_px + height * (1.0 - share) +
                                (share == 1.0   ? 10
                                 : share == 0.0 ? 0
                                                : 4),
                            share * map.highest, share == 1.0 ? " " + map.unit : "");
    return text;
}

}  // namespace

std::string heat_map_svg(const HeatMap& map) {
    const Placement place{map_width / map.image_width};
    const double height = place.scale * map.image_height;
    std::string text = fmt::format(
        "<svg class='plot' viewBox='0 0 {:.0f} {:.0f}' role='img' aria-label='map over the image'>"
        "<g shape-rendering='crispEdges'>",
        left_px + map_width + 12 + scale_width + right_px, top_px + height + bottom_px);
    for (std::size_t i = 0; i < map.centres.size(); ++i)
        text += cell(map, i, place);
    text += "</g>";
    text += fmt::format("<rect class='axis' x='{}' y='{}' width='{}' height='{:.1f}'/>", left_px,
                        top_px, map_width, height);
    return text + axes(map, place) + scale_bar(map, height) + "</svg>";
}

}  // namespace etalon
