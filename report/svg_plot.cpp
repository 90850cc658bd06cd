#include "report/svg_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "core/file/text.h"

namespace etalon {
namespace {

constexpr double left = 62, right = 14, bottom = 44;  // margins, px; the upper one is the legend's

// By ink: the class of the page's style sheet (report/html.cpp), and the colour of a file without a
// page.
struct InkStyle {
    const char *css_class, *colour;
};
constexpr std::array<InkStyle, 7> ink_styles{{{"blue", "#0072b2"},
                                              {"orange", "#e69f00"},
                                              {"green", "#009e73"},
                                              {"red", "#d55e00"},
                                              {"purple", "#aa4f8b"},
                                              {"sky", "#3f9fd8"},
                                              {"gray", "#8a949b"}}};

const char* css_class(Color ink) {
    return ink_styles.at(static_cast<std::size_t>(ink)).css_class;
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

std::vector<double> ticks(double low, double high, int most, bool logarithmic) {
    return logarithmic ? log_ticks(low, high, most) : axis_ticks(low, high, most);
}

std::string tick_label(double tick, bool logarithmic) {
    return fmt::format("{:.4g}", logarithmic ? std::pow(10.0, tick) : tick);
}

// Along an axis: the values, or their logarithms.
std::vector<double> placed(std::span<const double> values, bool logarithmic) {
    std::vector<double> result(values.begin(), values.end());
    if (logarithmic)
        for (double& value : result)
            value = std::log10(value);
    return result;
}

// Of more marks than this, all that a picture can tell is drawn: of those in the same square of the
// picture one, so that none that stands alone is lost. Of arrows the longest, of points the first.
constexpr std::size_t max_marks = 400;
constexpr double point_square_px = 6.0, arrow_square_px = 16.0;

template <class Layer>
std::vector<std::size_t> finite_marks(const Layer& layer) {
    std::vector<std::size_t> finite;
    for (std::size_t i = 0; i < layer.xs.size(); ++i)
        if (std::isfinite(layer.xs[i]) && std::isfinite(layer.ys[i]))
            finite.push_back(i);
    return finite;
}

// Of each square of `side` px the one with the largest score, the first of several; in their order.
template <class Place, class Score>
std::vector<std::size_t> one_a_square(const std::vector<std::size_t>& all, double side, Place place,
                                      Score score) {
    std::map<std::pair<double, double>, std::size_t> best;
    for (const std::size_t i : all) {
        const Eigen::Vector2d at = place(i);
        const auto [there, is_new] =
            best.try_emplace({std::floor(at.x() / side), std::floor(at.y() / side)}, i);
        if (!is_new && score(i) > score(there->second))
            there->second = i;
    }
    std::vector<std::size_t> kept;
    for (const auto& [square, i] : best)
        kept.push_back(i);
    std::ranges::sort(kept);
    return kept;
}

std::string title(const std::string& note) {
    return note.empty() ? "" : "<title>" + escape_html(note) + "</title>";
}

// The style sheet of reports (report/html.cpp) in its light colours, for a file without a page.
std::string stand_alone_style() {
    std::string style =
        "<style>.plot{font:12px 'DejaVu Sans',Arial,sans-serif}.plot text{fill:#222}"
        ".plot .grid{stroke:#ddd}.plot .axis{stroke:#888;fill:none}.plot .area{opacity:.2}";
    for (const auto& [name, colour] : ink_styles)
        style += fmt::format(
            ".{0} .mark,.{0} .area{{fill:{1}}}.{0} .stroke{{stroke:{1};fill:none}}", name, colour);
    return style + "</style><rect width='100%' height='100%' fill='#fff'/>";
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

void Series::add(double x, double y, double low, double high, std::string note) {
    add(x, y, std::move(note));
    lows.push_back(low);
    highs.push_back(high);
}

void Arrows::add(const Eigen::Vector2d& at, const Eigen::Vector2d& along, std::string note) {
    xs.push_back(at.x());
    ys.push_back(at.y());
    dxs.push_back(along.x());
    dys.push_back(along.y());
    notes.push_back(std::move(note));
}

double Arrows::longest() const {
    double longest = 0.0;
    for (std::size_t i = 0; i < dxs.size(); ++i)
        longest = std::max(longest, std::hypot(dxs[i], dys[i]));
    return longest;
}

struct SvgPlot::Extent {
    double low = std::numeric_limits<double>::infinity();
    double high = -std::numeric_limits<double>::infinity();

    void include(double value) {
        if (!std::isfinite(value))
            return;
        low = std::min(low, value);
        high = std::max(high, value);
    }
    // Never empty, and a little larger than the data.
    Extent padded() const {
        if (!(low <= high))
            return {0.0, 1.0};
        const double room = high > low ? 0.05 * (high - low) : std::max(1e-9, 0.1 * std::abs(low));
        return {low - room, high + room};
    }
};

struct SvgPlot::Frame {
    Extent x, y;
    double top, width, height;  // of the inner area, px
    bool y_down;

    double px(double value) const { return left + width * (value - x.low) / (x.high - x.low); }
    double py(double value) const {
        const double along = (value - y.low) / (y.high - y.low);
        return top + height * (y_down ? along : 1.0 - along);
    }
    void equalise_scales();
};

SvgPlot::SvgPlot(std::string x_label, std::string y_label, int width, int height)
    : x_label_(std::move(x_label)), y_label_(std::move(y_label)), width_(width), height_(height) {}

void SvgPlot::set_size(int width, int height) {
    width_ = width;
    height_ = height;
}

void SvgPlot::set_image_axes() {
    image_axes_ = true;
}

void SvgPlot::set_log_axes() {
    log_x_ = log_y_ = true;
}

void SvgPlot::set_log_y_axis() {
    log_y_ = true;
}

void SvgPlot::set_y_range(double low, double high) {
    y_range_ = {low, high};
}

void SvgPlot::add_points(std::span<const double> xs, std::span<const double> ys, Color ink,
                         const std::string& name, const std::vector<std::string>& notes) {
    layers_.push_back(
        {Layer::Kind::points, placed(xs, log_x_), placed(ys, log_y_), {}, {}, ink, name, notes});
}

void SvgPlot::add_line(std::span<const double> xs, std::span<const double> ys, Color ink,
                       const std::string& name) {
    layers_.push_back(
        {Layer::Kind::line, placed(xs, log_x_), placed(ys, log_y_), {}, {}, ink, name, {}});
}

void SvgPlot::add_band(std::span<const double> xs, std::span<const double> lows,
                       std::span<const double> highs, Color ink, const std::string& name) {
    layers_.push_back({Layer::Kind::band,
                       placed(xs, log_x_),
                       placed(lows, log_y_),
                       placed(highs, log_y_),
                       {},
                       ink,
                       name,
                       {}});
}

void SvgPlot::add_bars(const std::vector<std::string>& categories, std::span<const double> values,
                       Color ink) {
    categories_ = categories;
    std::vector<double> places(values.size());
    for (std::size_t i = 0; i < places.size(); ++i)
        places[i] = static_cast<double>(i);
    layers_.push_back(
        {Layer::Kind::bars, places, {values.begin(), values.end()}, {}, {}, ink, "", categories});
}

void SvgPlot::add_points(const Series& series, Color ink, const std::string& name) {
    add_points(series.xs, series.ys, ink, name, series.notes);
}

void SvgPlot::add_line(const Series& series, Color ink, const std::string& name) {
    add_line(series.xs, series.ys, ink, name);
}

void SvgPlot::add_curve(const Series& series, Color ink, const std::string& name) {
    add_line(series, ink, "");
    add_points(series, ink, name);
}

void SvgPlot::add_band(const Series& series, Color ink, const std::string& name) {
    add_band(series.xs, series.lows, series.highs, ink, name);
}

void SvgPlot::add_arrows(const Arrows& arrows, double magnification, Color ink,
                         const std::string& name) {
    Layer layer{Layer::Kind::arrows, arrows.xs, arrows.ys, arrows.dxs,
                arrows.dys,          ink,       name,      arrows.notes};
    for (std::vector<double>* components : {&layer.us, &layer.vs})
        for (double& component : *components)
            component *= magnification;
    layers_.push_back(std::move(layer));
}

void SvgPlot::show_image(int width, int height) {
    image_axes_ = true;
    const double x = width - 0.5, y = height - 0.5;
    add_line(std::array{-0.5, x, x, -0.5, -0.5}, std::array{-0.5, -0.5, y, y, -0.5}, Color::gray,
             "");
}

void SvgPlot::add_level(double y, Color ink, const std::string& label) {
    layers_.push_back({Layer::Kind::level, {}, placed({&y, 1}, log_y_), {}, {}, ink, label, {}});
}

void SvgPlot::Layer::include_in(Extent& x, Extent& y) const {
    for (std::size_t i = 0; i < ys.size(); ++i) {
        y.include(ys[i]);
        if (i < xs.size())
            x.include(xs[i]);
        if (kind == Kind::band)
            y.include(us[i]);
        if (kind == Kind::arrows) {
            x.include(xs[i] + us[i]);
            y.include(ys[i] + vs[i]);
        }
    }
    if (kind == Kind::bars) {
        y.include(0.0);
        x.include(-0.6);
        x.include(static_cast<double>(xs.size()) - 0.4);
    }
}

// Widens the extent that has room to spare until both scales are equal.
void SvgPlot::Frame::equalise_scales() {
    const double scale = std::max((x.high - x.low) / width, (y.high - y.low) / height);
    const auto widen = [scale](Extent& extent, double pixels) {
        const double middle = 0.5 * (extent.low + extent.high);
        extent = {middle - 0.5 * scale * pixels, middle + 0.5 * scale * pixels};
    };
    widen(x, width);
    widen(y, height);
}

SvgPlot::Frame SvgPlot::frame() const {
    Extent x, y;
    for (const Layer& layer : layers_)
        layer.include_in(x, y);
    const double top = 26.0 + 16.0 * (legend_places().rows - 1);
    Frame frame{x.padded(), y.padded(), top, width_ - left - right, height_ - top - bottom,
                image_axes_};
    if (y_range_)
        frame.y = {y_range_->first, y_range_->second};
    if (image_axes_)
        frame.equalise_scales();
    return frame;
}

std::string SvgPlot::axes(const Frame& f) const {
    std::string text;
    const double x0 = left, x1 = left + f.width, y0 = f.top, y1 = f.top + f.height;
    for (const double tick : ticks(f.y.low, f.y.high, 6, log_y_)) {
        const double y = f.py(tick);
        text += fmt::format("<line class='grid' x1='{}' x2='{}' y1='{:.1f}' y2='{:.1f}'/>", x0, x1,
                            y, y);
        text += fmt::format("<text x='{}' y='{:.1f}' text-anchor='end'>{}</text>", x0 - 6, y + 4,
                            tick_label(tick, log_y_));
    }
    if (categories_.empty()) {
        for (const double tick : ticks(f.x.low, f.x.high, 8, log_x_)) {
            const double x = f.px(tick);
            text += fmt::format("<line class='grid' y1='{}' y2='{}' x1='{:.1f}' x2='{:.1f}'/>", y0,
                                y1, x, x);
            text += fmt::format("<text x='{:.1f}' y='{}' text-anchor='middle'>{}</text>", x,
                                y1 + 16, tick_label(tick, log_x_));
        }
    }
    for (std::size_t i = 0; i < categories_.size(); ++i)
        text += fmt::format("<text x='{:.1f}' y='{}' text-anchor='middle'>{}</text>",
                            f.px(static_cast<double>(i)), y1 + 16, escape_html(categories_[i]));
    text += fmt::format("<rect class='axis' x='{}' y='{}' width='{}' height='{}'/>", x0, y0,
                        f.width, f.height);
    text += fmt::format("<text x='{:.1f}' y='{}' text-anchor='middle'>{}</text>", 0.5 * (x0 + x1),
                        height_ - 8, escape_html(x_label_));
    text += fmt::format(
        "<text transform='translate(14 {:.1f}) rotate(-90)' text-anchor='middle'>{}</text>",
        0.5 * (y0 + y1), escape_html(y_label_));
    return text;
}

std::string SvgPlot::mark(const Layer& layer, std::size_t i, const Frame& f) const {
    const double x = f.px(layer.xs[i]), y = f.py(layer.ys[i]);
    const std::string note = title(i < layer.notes.size() ? layer.notes[i] : std::string());
    if (layer.kind == Layer::Kind::points)
        return fmt::format("<circle class='mark' cx='{:.1f}' cy='{:.1f}' r='3'>{}</circle>", x, y,
                           note);
    if (layer.kind == Layer::Kind::bars) {
        const double zero = f.py(0.0), half = 0.36 * (f.px(1.0) - f.px(0.0));
        return fmt::format(
            "<rect class='mark' x='{:.1f}' y='{:.1f}' width='{:.1f}' height='{:.1f}'>{}</rect>",
            x - half, std::min(y, zero), 2 * half, std::abs(zero - y), note);
    }
    return fmt::format(
        "<g><path class='stroke' stroke-width='1.5' d='M{:.1f} {:.1f}L{:.1f} {:.1f}'/>"
        "<circle class='mark' cx='{:.1f}' cy='{:.1f}' r='2.5'/>{}</g>",
        x, y, f.px(layer.xs[i] + layer.us[i]), f.py(layer.ys[i] + layer.vs[i]), x, y, note);
}

std::string SvgPlot::marks(const Layer& layer, const Frame& f) const {
    std::vector<std::size_t> shown = finite_marks(layer);
    const bool is_arrows = layer.kind == Layer::Kind::arrows;
    const double square = is_arrows ? arrow_square_px : point_square_px;
    if (shown.size() > max_marks && layer.kind != Layer::Kind::bars)
        shown = one_a_square(
            shown, square,
            [&](std::size_t i) { return Eigen::Vector2d(f.px(layer.xs[i]), f.py(layer.ys[i])); },
            [&](std::size_t i) { return is_arrows ? std::hypot(layer.us[i], layer.vs[i]) : 0.0; });
    std::string text;
    for (const std::size_t i : shown)
        text += mark(layer, i, f);
    return text;
}

// What a layer of too many marks says of itself.
std::string SvgPlot::thinning() const {
    const auto is_thinned = [](const Layer& layer) {
        return (layer.kind == Layer::Kind::points || layer.kind == Layer::Kind::arrows) &&
               finite_marks(layer).size() > max_marks;
    };
    const auto thinned = std::ranges::find_if(layers_, is_thinned);
    if (thinned == layers_.end())
        return "";
    const bool is_arrows = thinned->kind == Layer::Kind::arrows;
    return fmt::format(
        "<text x='{}' y='17' font-size='10' text-anchor='end'>{} {}, one a {:g} px square</text>",
        width_ - right, thinned->xs.size(), is_arrows ? "arrows" : "points",
        is_arrows ? arrow_square_px : point_square_px);
}

std::string SvgPlot::path(const Layer& layer, const Frame& f) const {
    std::string path;
    const auto append = [&](double x, double y) {
        if (std::isfinite(x) && std::isfinite(y))
            path += fmt::format("{}{:.1f} {:.1f}", path.empty() ? "M" : "L", f.px(x), f.py(y));
    };
    for (std::size_t i = 0; i < layer.xs.size(); ++i)
        append(layer.xs[i], layer.ys[i]);
    if (layer.kind == Layer::Kind::line)
        return "<path class='stroke' stroke-width='1.8' d='" + path + "'/>";
    for (std::size_t i = layer.xs.size(); i-- > 0;)
        append(layer.xs[i], layer.us[i]);
    return "<path class='area' d='" + path + "Z'/>";
}

std::string SvgPlot::level(const Layer& layer, const Frame& f) const {
    const double y = f.py(layer.ys[0]), end = left + f.width;
    return fmt::format(
        "<line class='stroke' stroke-dasharray='6 4' stroke-width='1.5' x1='{}' x2='{}' "
        "y1='{:.1f}' y2='{:.1f}'/><text x='{}' y='{:.1f}' text-anchor='end'>{}</text>",
        left, end, y, y, end - 4, y - 5, escape_html(layer.name));
}

std::string SvgPlot::layer(const Layer& layer, const Frame& f) const {
    std::string shapes;
    switch (layer.kind) {
        case Layer::Kind::points:
        case Layer::Kind::bars:
        case Layer::Kind::arrows:
            shapes = marks(layer, f);
            break;
        case Layer::Kind::line:
        case Layer::Kind::band:
            shapes = path(layer, f);
            break;
        case Layer::Kind::level:
            shapes = level(layer, f);
            break;
    }
    return fmt::format("<g class='{}'>{}</g>", css_class(layer.ink), shapes);
}

// From left to right, in as many rows as the names need.
SvgPlot::LegendPlaces SvgPlot::legend_places() const {
    LegendPlaces places;
    double x = left;
    for (const Layer& layer : layers_) {
        if (layer.name.empty() || layer.kind == Layer::Kind::level)
            continue;
        const double entry = 30.0 + 6.6 * static_cast<double>(layer.name.size());
        if (x > left && x + entry > width_) {
            x = left;
            ++places.rows;
        }
        places.entries.emplace_back(&layer, Eigen::Vector2d(x, 16.0 * (places.rows - 1)));
        x += entry;
    }
    return places;
}

std::string SvgPlot::legend() const {
    std::string text;
    for (const auto& [layer, place] : legend_places().entries)
        text += fmt::format(
            "<g class='{}'><rect class='mark' x='{:.1f}' y='{:g}' width='10' height='10' rx='2'/>"
            "</g><text x='{:.1f}' y='{:g}'>{}</text>",
            css_class(layer->ink), place.x(), place.y() + 8.0, place.x() + 15.0, place.y() + 17.0,
            escape_html(layer->name));
    return text;
}

std::string SvgPlot::svg(bool stand_alone) const {
    const Frame f = frame();
    std::string text =
        fmt::format("<svg class='plot' viewBox='0 0 {} {}' role='img' aria-label='{} against {}'>",
                    width_, height_, escape_html(y_label_), escape_html(x_label_));
    text += axes(f);
    for (const Layer& each : layers_)
        text += layer(each, f);
    text += thinning() + legend() + "</svg>";
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

}  // namespace etalon
