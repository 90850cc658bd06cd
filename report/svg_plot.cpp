#include "report/svg_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <tuple>

#include "core/file/text.h"

namespace etalon {
namespace {

constexpr double left = 62, right = 14, bottom = 44;  // margins, px; the upper one is the legend's

using Kind = PlotLayer::Kind;

// By color: class of the page's style sheet (report/html.cpp), and colour in a file of its own.
constexpr std::pair<const char*, const char*> color_styles[] = {
    {"blue", "#0072b2"},   {"orange", "#e69f00"}, {"green", "#009e73"}, {"red", "#d55e00"},
    {"purple", "#aa4f8b"}, {"sky", "#3f9fd8"},    {"gray", "#8a949b"}};

const char* css_class(Color color) {
    return color_styles[static_cast<std::size_t>(color)].first;
}

// The step of 1, 2 or 5 times a power of ten that gives at most `most` ticks.
double tick_step(double low, double high, int most) {
    const double raw = (high - low) / most;
    const double power = std::pow(10.0, std::floor(std::log10(raw)));
    for (const double factor : {1.0, 2.0, 5.0})
        if (factor * power >= raw)
            return factor * power;
    return 10.0 * power;
}

// Logarithms of round numbers on an axis from 10^low to 10^high: those of a linear axis for less
// than a decade, else 1, 2 and 5 of every decade, or only the decades where there are many.
std::vector<double> log_ticks(double low, double high, int most) {
    std::vector<double> values;
    if (high - low < 1.0) {
        for (const double value : axis_ticks(std::pow(10.0, low), std::pow(10.0, high), most))
            values.push_back(std::log10(value));
        return values;
    }
    for (double decade = std::floor(low); decade <= high; decade += 1.0)
        for (const double factor : {1.0, 2.0, 5.0}) {
            const double tick = decade + std::log10(factor);
            if (tick >= low && tick <= high && (factor == 1.0 || high - low < 2.5))
                values.push_back(tick);
        }
    return values;
}

std::vector<std::pair<double, std::string>> labelled_ticks(const std::pair<double, double>& range,
                                                           int most, bool is_log) {
    const auto [low, high] = range;
    std::vector<std::pair<double, std::string>> ticks;
    for (const double tick : is_log ? log_ticks(low, high, most) : axis_ticks(low, high, most))
        ticks.emplace_back(tick, fmt::format("{:.4g}", is_log ? std::pow(10.0, tick) : tick));
    return ticks;
}

// Of more marks than this, all that a picture can tell is drawn: of those in the same square of the
// picture one, so that none that stands alone is lost. Of arrows the longest, of points the first.
constexpr std::size_t max_marks = 400;
constexpr double point_square_px = 6.0, arrow_square_px = 16.0;

std::vector<std::size_t> finite_marks(const PlotLayer& layer) {
    std::vector<std::size_t> finite;
    for (std::size_t i = 0; i < layer.xs.size(); ++i)
        if (std::isfinite(layer.xs[i]) && std::isfinite(layer.ys[i]))
            finite.push_back(i);
    return finite;
}

struct Extent {
    double low = std::numeric_limits<double>::infinity();
    double high = -std::numeric_limits<double>::infinity();

    void include(double value) {
        if (!std::isfinite(value))
            return;
        low = std::min(low, value);
        high = std::max(high, value);
    }
    // Never empty, and a little larger than the data.
    std::pair<double, double> padded() const {
        if (!(low <= high))
            return {0.0, 1.0};
        const double room = high > low ? 0.05 * (high - low) : std::max(1e-9, 0.1 * std::abs(low));
        return {low - room, high + room};
    }
};

double length(const std::pair<double, double>& range) {
    return range.second - range.first;
}

// To this size about its middle.
void widen(std::pair<double, double>& range, double size) {
    const double middle = 0.5 * (range.first + range.second);
    range = {middle - 0.5 * size, middle + 0.5 * size};
}

void include(const PlotLayer& layer, Extent& x, Extent& y) {
    for (std::size_t i = 0; i < layer.ys.size(); ++i) {
        y.include(layer.kind == Kind::band ? layer.us[i] : layer.ys[i]);
        if (i < layer.xs.size())
            x.include(layer.xs[i]);
        if (layer.kind == Kind::band)
            y.include(layer.vs[i]);
        if (layer.kind == Kind::arrows) {
            x.include(layer.xs[i] + layer.us[i]);
            y.include(layer.ys[i] + layer.vs[i]);
        }
    }
    if (layer.kind == Kind::bars) {
        y.include(0.0);
        x.include(-0.6);
        x.include(static_cast<double>(layer.xs.size()) - 0.4);
    }
}

// The style sheet of reports (report/html.cpp) in its light colours, for a file without a page.
std::string stand_alone_style() {
    std::string style =
        "<style>.plot{font:12px 'DejaVu Sans',Arial,sans-serif}.plot text{fill:#222}"
        ".plot .grid{stroke:#ddd}.plot .axis{stroke:#888;fill:none}.plot .area{opacity:.2}";
    for (const auto& [name, colour] : color_styles)
        style += fmt::format(
            ".{0} .mark,.{0} .area{{fill:{1}}}.{0} .stroke{{stroke:{1};fill:none}}", name, colour);
    return style + "</style><rect width='100%' height='100%' fill='#fff'/>";
}

std::string text_element(double x, double y, const char* anchor, const std::string& text) {
    return fmt::format("<text x='{:.1f}' y='{:.1f}' text-anchor='{}'>{}</text>", x, y, anchor,
                       escape_html(text));
}

}  // namespace

std::vector<double> axis_ticks(double low, double high, int most) {
    const double step = tick_step(low, high, most);
    std::vector<double> values;
    for (double tick = std::ceil(low / step) * step; tick <= high + 1e-9 * step; tick += step)
        values.push_back(std::abs(tick) < 1e-9 * step ? 0.0 : tick);
    return values;
}

double round_scale(double value) {
    const double power = std::pow(10.0, std::floor(std::log10(value)));
    const double digit = value / power;
    return power * (digit >= 5.0 ? 5.0 : digit >= 2.0 ? 2.0 : 1.0);
}

void Series::add(double x, double y, std::string note) {
    xs.push_back(x);
    ys.push_back(y);
    notes.push_back(std::move(note));
}

void Series::add(double x, double y, double u, double v, std::string note) {
    add(x, y, std::move(note));
    us.push_back(u);
    vs.push_back(v);
}

double Series::longest() const {
    double longest = 0.0;
    for (std::size_t i = 0; i < us.size(); ++i)
        longest = std::max(longest, std::hypot(us[i], vs[i]));
    return longest;
}

struct SvgPlot::Frame {
    std::pair<double, double> x, y;  // what is shown, from low to high
    double top, width, height;       // of the inner area, px
    bool y_down;

    double px(double value) const { return left + width * (value - x.first) / length(x); }
    double py(double value) const {
        const double along = (value - y.first) / length(y);
        return top + height * (y_down ? along : 1.0 - along);
    }

    std::string mark(const PlotLayer& layer, std::size_t i) const;
    std::string marks(const PlotLayer& layer) const;
    std::string path(const PlotLayer& layer) const;
    std::string level(const PlotLayer& layer) const;
};

SvgPlot::SvgPlot(std::string x_label, std::string y_label, int width, int height)
    : x_label_(std::move(x_label)), y_label_(std::move(y_label)), width_(width), height_(height) {}

void SvgPlot::set_size(int width, int height) {
    width_ = width;
    height_ = height;
}

// Along axes that may be logarithmic.
void SvgPlot::add(PlotLayer layer) {
    const auto take_logarithms = [](std::vector<double>& values) {
        for (double& value : values)
            value = std::log10(value);
    };
    if (is_log_x_)
        take_logarithms(layer.xs);
    if (is_log_y_)
        for (std::vector<double>* values : {&layer.ys, &layer.us, &layer.vs})
            take_logarithms(*values);
    layers_.push_back(std::move(layer));
}

void SvgPlot::add_points(const Series& series, Color color, const std::string& name) {
    add({series, Kind::points, color, name});
}

void SvgPlot::add_line(const Series& series, Color color, const std::string& name) {
    add({series, Kind::line, color, name});
}

void SvgPlot::add_band(const Series& series, Color color, const std::string& name) {
    add({series, Kind::band, color, name});
}

void SvgPlot::add_curve(const Series& series, Color color, const std::string& name) {
    add_line(series, color, "");
    add_points(series, color, name);
}

void SvgPlot::add_bars(const std::vector<std::string>& categories,
                       const std::vector<double>& values, Color color) {
    categories_ = categories;
    std::vector<double> places(values.size());
    std::iota(places.begin(), places.end(), 0.0);
    layers_.push_back({{places, values, {}, {}, categories}, Kind::bars, color, ""});
}

void SvgPlot::add_arrows(const Series& arrows, double magnification, Color color,
                         const std::string& name) {
    PlotLayer layer{arrows, Kind::arrows, color, name};
    for (std::vector<double>* components : {&layer.us, &layer.vs})
        for (double& component : *components)
            component *= magnification;
    layers_.push_back(std::move(layer));
}

void SvgPlot::show_image(int width, int height) {
    set_image_axes();
    Series border;
    for (const auto& [x, y] : {std::pair(0, 0), {width, 0}, {width, height}, {0, height}, {0, 0}})
        border.add(x - 0.5, y - 0.5);
    add_line(border, Color::gray, "");
}

void SvgPlot::add_level(double y, Color color, const std::string& label) {
    add({{{}, {y}}, Kind::level, color, label});
}

SvgPlot::Frame SvgPlot::frame(double top) const {
    Extent x, y;
    for (const PlotLayer& layer : layers_)
        include(layer, x, y);
    Frame frame{x.padded(), y.padded(), top, width_ - left - right, height_ - top - bottom,
                is_image_};
    if (y_range_)
        frame.y = *y_range_;
    if (is_image_) {
        const double scale =
            std::max(length(frame.x) / frame.width, length(frame.y) / frame.height);
        widen(frame.x, scale * frame.width);
        widen(frame.y, scale * frame.height);
    }
    return frame;
}

std::string SvgPlot::axes(const Frame& f) const {
    std::string text;
    const double x0 = left, x1 = left + f.width, y0 = f.top, y1 = f.top + f.height;
    for (const auto& [tick, label] : labelled_ticks(f.y, 6, is_log_y_))
        text += fmt::format("<path class='grid' d='M{} {:.1f}H{}'/>", x0, f.py(tick), x1) +
                text_element(x0 - 6, f.py(tick) + 4, "end", label);
    if (categories_.empty())
        for (const auto& [tick, label] : labelled_ticks(f.x, 8, is_log_x_))
            text += fmt::format("<path class='grid' d='M{:.1f} {}V{}'/>", f.px(tick), y0, y1) +
                    text_element(f.px(tick), y1 + 16, "middle", label);
    for (std::size_t i = 0; i < categories_.size(); ++i)
        text += text_element(f.px(static_cast<double>(i)), y1 + 16, "middle", categories_[i]);
    text += fmt::format("<rect class='axis' x='{}' y='{}' width='{}' height='{}'/>", x0, y0,
                        f.width, f.height);
    text += text_element(0.5 * (x0 + x1), height_ - 8, "middle", x_label_);
    return text + fmt::format(
                      "<text transform='translate(14 {:.1f}) rotate(-90)' "
                      "text-anchor='middle'>{}</text>",
                      0.5 * (y0 + y1), escape_html(y_label_));
}

std::string SvgPlot::Frame::mark(const PlotLayer& layer, std::size_t i) const {
    const double x = px(layer.xs[i]), y_px = py(layer.ys[i]);
    std::string note;
    if (i < layer.notes.size() && !layer.notes[i].empty())
        note = "<title>" + escape_html(layer.notes[i]) + "</title>";
    if (layer.kind == Kind::points)
        return fmt::format("<circle class='mark' cx='{:.1f}' cy='{:.1f}' r='3'>{}</circle>", x,
                           y_px, note);
    if (layer.kind == Kind::bars) {
        const double zero = py(0.0), half = 0.36 * (px(1.0) - px(0.0));
        return fmt::format(
            "<rect class='mark' x='{:.1f}' y='{:.1f}' width='{:.1f}' height='{:.1f}'>{}</rect>",
            x - half, std::min(y_px, zero), 2 * half, std::abs(zero - y_px), note);
    }
    return fmt::format(
        "<g><path class='stroke' stroke-width='1.5' d='M{0:.1f} {1:.1f}L{2:.1f} {3:.1f}'/>"
        "<circle class='mark' cx='{0:.1f}' cy='{1:.1f}' r='2.5'/>{4}</g>",
        x, y_px, px(layer.xs[i] + layer.us[i]), py(layer.ys[i] + layer.vs[i]), note);
}

std::string SvgPlot::Frame::marks(const PlotLayer& layer) const {
    std::vector<std::size_t> shown = finite_marks(layer);
    if (shown.size() > max_marks && layer.kind != Kind::bars) {
        const bool is_arrows = layer.kind == Kind::arrows;
        const double side = is_arrows ? arrow_square_px : point_square_px;
        const auto length = [&](std::size_t i) { return std::hypot(layer.us[i], layer.vs[i]); };
        std::map<std::pair<double, double>, std::size_t> best;  // of each square
        for (const std::size_t i : shown) {
            const auto [there, is_new] = best.try_emplace(
                {std::floor(px(layer.xs[i]) / side), std::floor(py(layer.ys[i]) / side)}, i);
            if (!is_new && is_arrows && length(i) > length(there->second))
                there->second = i;
        }
        shown.clear();
        for (const auto& [square, i] : best)
            shown.push_back(i);
        std::ranges::sort(shown);
    }
    std::string text;
    for (const std::size_t i : shown)
        text += mark(layer, i);
    return text;
}

// What a layer of too many marks says of itself.
std::string SvgPlot::thinning() const {
    for (const PlotLayer& layer : layers_) {
        const bool is_arrows = layer.kind == Kind::arrows;
        if ((is_arrows || layer.kind == Kind::points) && finite_marks(layer).size() > max_marks)
            return fmt::format(
                "<text x='{}' y='17' font-size='10' text-anchor='end'>{} {}, one a {:g} px "
                "square</text>",
                width_ - right, layer.xs.size(), is_arrows ? "arrows" : "points",
                is_arrows ? arrow_square_px : point_square_px);
    }
    return "";
}

std::string SvgPlot::Frame::path(const PlotLayer& layer) const {
    std::string path;
    const auto append = [&](double x_value, double y_value) {
        if (std::isfinite(x_value) && std::isfinite(y_value))
            path +=
                fmt::format("{}{:.1f} {:.1f}", path.empty() ? "M" : "L", px(x_value), py(y_value));
    };
    const bool is_line = layer.kind == Kind::line;
    for (std::size_t i = 0; i < layer.xs.size(); ++i)
        append(layer.xs[i], is_line ? layer.ys[i] : layer.us[i]);
    if (is_line)
        return "<path class='stroke' stroke-width='1.8' d='" + path + "'/>";
    for (std::size_t i = layer.xs.size(); i-- > 0;)
        append(layer.xs[i], layer.vs[i]);
    return "<path class='area' d='" + path + "Z'/>";
}

std::string SvgPlot::Frame::level(const PlotLayer& layer) const {
    const double at = py(layer.ys[0]), end = left + width;
    return fmt::format(
               "<path class='stroke' stroke-dasharray='6 4' stroke-width='1.5' d='M{} {:.1f}H{}'/>",
               left, at, end) +
           text_element(end - 4, at - 5, "end", layer.name);
}

namespace {

// From left to right, in as many rows as the names need.
struct Legend {
    std::string text;
    int rows = 1;
};

Legend legend_of(const std::vector<PlotLayer>& layers, int width) {
    Legend legend;
    double x = left;
    for (const PlotLayer& layer : layers) {
        if (layer.name.empty() || layer.kind == Kind::level)
            continue;
        const double entry = 30.0 + 6.6 * static_cast<double>(layer.name.size());
        if (x > left && x + entry > width) {
            x = left;
            ++legend.rows;
        }
        const double y = 16.0 * (legend.rows - 1);
        legend.text += fmt::format(
            "<g class='{}'><rect class='mark' x='{:.1f}' y='{:g}' width='10' height='10' rx='2'/>"
            "</g><text x='{:.1f}' y='{:g}'>{}</text>",
            css_class(layer.color), x, y + 8.0, x + 15.0, y + 17.0, escape_html(layer.name));
        x += entry;
    }
    return legend;
}

}  // namespace

std::string SvgPlot::svg(bool stand_alone) const {
    const Legend legend = legend_of(layers_, width_);
    const Frame f = frame(26.0 + 16.0 * (legend.rows - 1));
    std::string text =
        fmt::format("<svg class='plot' viewBox='0 0 {} {}' role='img' aria-label='{} against {}'>",
                    width_, height_, escape_html(y_label_), escape_html(x_label_));
    text += axes(f);
    for (const PlotLayer& layer : layers_) {
        const bool is_path = layer.kind == Kind::line || layer.kind == Kind::band;
        text += fmt::format("<g class='{}'>{}</g>", css_class(layer.color),
                            is_path                     ? f.path(layer)
                            : layer.kind == Kind::level ? f.level(layer)
                                                        : f.marks(layer));
    }
    text += thinning() + legend.text + "</svg>";
    return stand_alone ? stand_alone_svg(std::move(text)) : text;
}

std::string stand_alone_svg(std::string svg) {
    svg.insert(svg.find('>') + 1, stand_alone_style());
    return svg.insert(svg.find("<svg") + 4, " xmlns='http://www.w3.org/2000/svg'");
}

std::string svg_panels(std::span<SvgPlot> plots, int columns, int width, int height) {
    const int count = static_cast<int>(plots.size()), rows = (count + columns - 1) / columns;
    std::string text = fmt::format("<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {} {}'>",
                                   columns * width, rows * height);
    for (int i = 0; i < count; ++i) {
        SvgPlot& plot = plots[static_cast<std::size_t>(i)];
        plot.set_size(width, height);
        text += plot.svg(true).insert(
            4, fmt::format(" x='{}' y='{}' width='{}' height='{}'", i % columns * width,
                           i / columns * height, width, height));
    }
    return text + "</svg>\n";
}

namespace {

constexpr double map_left = 44, map_top = 12, map_bottom = 36, map_width = 420;
constexpr double scale_x = map_left + map_width + 12, scale_width = 14, scale_right = 66;

// Of viridis, of which every eighth is listed.
std::string viridis(double share) {
    constexpr int listed[9][3] = {{68, 1, 84},    {71, 44, 122},  {59, 81, 139},
                                  {44, 113, 142}, {33, 144, 141}, {39, 173, 129},
                                  {92, 200, 99},  {170, 220, 50}, {253, 231, 37}};
    const double place = std::clamp(share, 0.0, 1.0) * 8.0;
    const int below = std::min(static_cast<int>(place), 7);
    std::string colour = "#";
    for (int c = 0; c < 3; ++c)
        colour += fmt::format(
            "{:02x}",
            std::lround(std::lerp(listed[below][c], listed[below + 1][c], place - below)));
    return colour;
}

// Image coordinates at the border, at round numbers. `scale`: of the drawing to the image.
std::string map_axes(const HeatMap& map, double scale) {
    const double step = round_scale(std::max(map.image_width, map.image_height) / 4.0);
    const double end = map_top + scale * map.image_height;
    std::string text;
    for (double tick = 0; tick < map.image_width; tick += step)
        text += text_element(map_left + scale * (tick + 0.5), end + 16, "middle",
                             fmt::format("{:g}", tick));
    for (double tick = 0; tick < map.image_height; tick += step)
        text += text_element(map_left - 6, map_top + scale * (tick + 0.5) + 4, "end",
                             fmt::format("{:g}", tick));
    return text +
           text_element(map_left + 0.5 * map_width, end + 32, "middle", "x / " + map.axis_unit);
}

std::string colour_scale(const HeatMap& map, double height) {
    constexpr int steps = 32;
    std::string text;
    for (int i = 0; i < steps; ++i)
        text += fmt::format("<rect x='{:.1f}' y='{:.2f}' width='{}' height='{:.2f}' fill='{}'/>",
                            scale_x, map_top + height * (1.0 - (i + 1.0) / steps), scale_width,
                            height / steps + 0.3, viridis((i + 0.5) / steps));
    for (const auto& [share, down, unit] :
         {std::tuple(0.0, 0, std::string()), {0.5, 4, ""}, {1.0, 10, " " + map.unit}})
        text += text_element(scale_x + scale_width + 5, map_top + height * (1.0 - share) + down,
                             "start", fmt::format("{:.2g}{}", share * map.highest, unit));
    return text;
}

}  // namespace

std::string heat_map_svg(const HeatMap& map) {
    constexpr double seam = 0.5;  // that neighbours overlap by, so that no gap shows
    const double scale = map_width / map.image_width, height = scale * map.image_height;
    std::string text = fmt::format(
        "<svg class='plot' viewBox='0 0 {:.0f} {:.0f}' role='img' aria-label='map over the image'>"
        "<g shape-rendering='crispEdges'>",
        scale_x + scale_width + scale_right, map_top + height + map_bottom);
    const Eigen::Vector2d half(0.5 * map.cell_width, 0.5 * map.cell_height);
    const Eigen::Vector2d end(map.image_width - 0.5, map.image_height - 0.5);
    for (std::size_t i = 0; i < map.centres.size(); ++i) {
        const Eigen::Vector2d& centre = map.centres[i];
        const Eigen::Vector2d low = (centre - half).cwiseMax(-0.5);
        const Eigen::Vector2d size = scale * ((centre + half).cwiseMin(end) - low);
        text += fmt::format(
            "<rect x='{:.1f}' y='{:.1f}' width='{:.1f}' height='{:.1f}' fill='{}'><title>({:.0f}, "
            "{:.0f}): {:.3f} {}</title></rect>",
            map_left + scale * (low.x() + 0.5), map_top + scale * (low.y() + 0.5), size.x() + seam,
            size.y() + seam, viridis(map.values[i] / map.highest), centre.x(), centre.y(),
            map.values[i], escape_html(map.unit));
    }
    text += fmt::format("</g><rect class='axis' x='{}' y='{}' width='{}' height='{:.1f}'/>",
                        map_left, map_top, map_width, height);
    return text + map_axes(map, scale) + colour_scale(map, height) + "</svg>";
}

}  // namespace etalon
