#include "study/pair_matrix.h"

#include <fmt/format.h>

#include <cstring>

#include "core/file/text.h"
#include "report/svg_plot.h"
#include "study/pair_matrix.css.h"
#include "study/pair_matrix.js.h"

namespace etalon {
namespace {

// Never empty, and a little larger than [low, high].
Interval padded(double low, double high, double share) {
    const double room = high > low ? share * (high - low) : std::max(0.5, 0.1 * std::abs(low));
    return {low - room, high + room};
}

Interval bulk(const std::vector<double>& values) {
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    const double middle = median(values);
    const double reach = PairMatrix::robust_deviations * median_deviation(values);
    // More than half of the values alike say nothing of the others' scatter.
    if (reach == 0.0)
        return padded(*low, *high, 0.04);
    return padded(std::max(*low, middle - reach), std::min(*high, middle + reach), 0.04);
}

std::size_t cell(const Interval& axis, double value, std::size_t cells) {
    const double place = (value - axis.low) / (axis.high - axis.low) * static_cast<double>(cells);
    return static_cast<std::size_t>(std::clamp(place, 0.0, static_cast<double>(cells) - 1.0));
}

// Row 0 above the axis, 1 to PairMatrix::rows inside it, the next below.
std::size_t row(const Interval& axis, double error) {
    if (error > axis.high)
        return 0;
    if (error < axis.low)
        return PairMatrix::rows + 1;
    return PairMatrix::rows - cell(axis, error, PairMatrix::rows);
}

// One end of a bin along a degree of freedom.
double bin_low(const Interval& freedom, std::size_t bin) {
    const double width = (freedom.high - freedom.low) / PairMatrix::bins;
    return freedom.low + width * static_cast<double>(bin);
}

void find_axes(PairMatrix& matrix, std::span<const PoseComponents> truth,
               const DetectorErrors& errors) {
    for (std::size_t k = 0; k < pose_component_count; ++k) {
        const auto [low, high] = std::minmax_element(
            truth.begin(), truth.end(),
            [k](const PoseComponents& one, const PoseComponents& two) { return one[k] < two[k]; });
        matrix.freedoms[k] = padded((*low)[k], (*high)[k], 0.0);
        std::vector<double> values;
        for (const auto& error : errors)
            if (error)
                values.push_back(error->measures[k]);
        matrix.errors[k] = bulk(values);
    }
}

void add(PairMatrix& matrix, const PoseComponents& truth, const DetectedError& detected) {
    for (std::size_t e = 0; e < pose_component_count; ++e) {
        const double error = detected.measures[e];
        const std::size_t r = row(matrix.errors[e], error);
        const bool is_above = r == 0, is_below = r > PairMatrix::rows;
        matrix.above[e] += is_above;
        matrix.below[e] += is_below;
        for (std::size_t f = 0; f < pose_component_count; ++f) {
            PairPanel& panel = matrix.panels[e][f];
            const Interval& freedom = matrix.freedoms[f];
            const std::size_t column = cell(freedom, truth[f], PairMatrix::columns);
            ++panel.counts[r * PairMatrix::columns + column];
            PairBin& bin = panel.bins[cell(freedom, truth[f], PairMatrix::bins)];
            bin.all.add(error);
            if (!is_above && !is_below)
                bin.inside.add(error);
        }
    }
}

// "true x / mm" and "X error / mm".
std::string freedom_label(std::size_t component) {
    constexpr std::array names{"x", "y", "z", "roll", "pitch", "yaw"};
    return fmt::format("true {} / {}", names.at(component), error_measures.at(component).unit);
}

std::string error_label(std::size_t component) {
    return fmt::format("{} error / {}", error_measures.at(component).name,
                       error_measures.at(component).unit);
}

// Of a panel, in the units of its <svg>: the density's cells are 2 x 2, two rows at the top and the
// bottom are the rims for what lies beyond the axis, with an empty row between.
constexpr double panel_width = 2.0 * PairMatrix::columns,
                 panel_height = 2.0 * (PairMatrix::rows + 6), panel_rim = 6.0;

// In a page every panel has the data that enlarging needs, and every bin its <title>.
enum class PairPicture { in_page, stand_alone };

constexpr double gap = 12, left = 74, right = 52, top = 64, bottom = 62;
constexpr double picture_width = left + 6 * panel_width + 5 * gap + right;
constexpr double picture_height = top + 6 * panel_height + 5 * gap + bottom;

double panel_x(std::size_t freedom) {
    return left + static_cast<double>(freedom) * (panel_width + gap);
}
double panel_y(std::size_t error) {
    return top + static_cast<double>(error) * (panel_height + gap);
}

double across(const Interval& axis, double value) {
    return panel_width * (value - axis.low) / (axis.high - axis.low);
}
double down(const Interval& axis, double value) {
    return panel_rim +
           (panel_height - 2.0 * panel_rim) * (axis.high - value) / (axis.high - axis.low);
}

// Of five or more; fewer stay as they are.
std::vector<double> every_second(const std::vector<double>& values) {
    if (values.size() < 5)
        return values;
    std::vector<double> kept;
    for (std::size_t i = 0; i < values.size(); i += 2)
        kept.push_back(values[i]);
    return kept;
}

// At least three of them where round numbers allow; angles over a wide range at parts of a turn.
// A tick a hundredth beyond the axis is one at its end: sampled poses come no nearer.
std::vector<double> ticks(const Interval& axis, std::size_t component) {
    const double span = axis.high - axis.low, low = axis.low - 0.01 * span,
                 high = axis.high + 0.01 * span;
    if (component < 3 || span < 60.0) {
        const std::vector<double> few = axis_ticks(low, high, 4);
        return few.size() >= 3 ? few : every_second(axis_ticks(low, high, 6));
    }
    const double step = span > 300.0 ? 120.0 : span > 185.0 ? 90.0 : span > 95.0 ? 45.0 : 30.0;
    std::vector<double> values;
    for (double tick = std::ceil(low / step) * step; tick <= high; tick += step)
        values.push_back(tick);
    return values;
}

using Colour = std::array<double, 3>;  // red, green, blue

// Sequential schemes of ColorBrewer (Harrower and Brewer, The Cartographic Journal 40, 2003): Blues
// inside the axis, Oranges beyond it, from the level at which single poses are still seen.
constexpr std::array<Colour, 4> blues{{{158, 202, 225}, {66, 146, 198}, {8, 81, 156}, {5, 36, 88}}};
constexpr std::array<Colour, 4> oranges{
    {{253, 174, 107}, {241, 105, 19}, {200, 66, 2}, {127, 39, 4}}};

Colour mixed(const std::array<Colour, 4>& scheme, double level) {
    const double place = std::clamp(level, 0.0, 1.0) * 3.0;
    const auto i = std::min<std::size_t>(static_cast<std::size_t>(place), 2);
    const double part = place - static_cast<double>(i);
    Colour colour{};
    for (std::size_t c = 0; c < 3; ++c)
        colour[c] = (1.0 - part) * scheme[i][c] + part * scheme[i + 1][c];
    return colour;
}

// From 0 for one pose to 1 for the fullest cell, in steps (a picture of few colours is small).
double log_level(std::uint32_t count, std::uint32_t highest) {
    constexpr double steps = 24.0;
    if (highest < 2)
        return 0.5;
    return std::round(steps * std::log(count) / std::log(highest)) / steps;
}

cv::Vec4b pixel(std::uint32_t count, std::uint32_t highest, bool inside) {
    if (count == 0)
        return {0, 0, 0, 0};
    const Colour colour = mixed(inside ? blues : oranges, log_level(count, highest));
    return {static_cast<unsigned char>(colour[2]), static_cast<unsigned char>(colour[1]),
            static_cast<unsigned char>(colour[0]), 255};
}

// One pixel per cell, transparent where there is no pose.
cv::Mat density(const PairPanel& panel, std::uint32_t highest) {
    constexpr int last = static_cast<int>(PairMatrix::rows) + 5;
    cv::Mat picture(last + 1, static_cast<int>(PairMatrix::columns), CV_8UC4, cv::Scalar::all(0));
    for (std::size_t r = 0; r < PairMatrix::rows + 2; ++r)
        for (std::size_t c = 0; c < PairMatrix::columns; ++c) {
            const bool inside = r > 0 && r <= PairMatrix::rows;
            const auto colour = pixel(panel.counts[r * PairMatrix::columns + c], highest, inside);
            const int x = static_cast<int>(c), y = static_cast<int>(r) + 2;
            if (inside)
                picture.at<cv::Vec4b>(y, x) = colour;
            else
                for (const int rim : {r == 0 ? 0 : last - 1, r == 0 ? 1 : last})
                    picture.at<cv::Vec4b>(rim, x) = colour;
        }
    return picture;
}

// Through the bins' middles at mean + deviations * standard deviation; broken where a bin has none,
// and a dot (a line of no length with round ends) where its neighbours have none.
std::string bin_path(const PairPanel& panel, const Interval& freedom, const Interval& error,
                     double deviations) {
    std::string path;
    bool pen_down = false;
    for (std::size_t i = 0; i < panel.bins.size(); ++i) {
        const PairBin& bin = panel.bins[i];
        const auto mean = bin.inside.mean(), deviation = bin.inside.standard_deviation();
        if (!mean || (deviations != 0.0 && !deviation)) {
            pen_down = false;
            continue;
        }
        const double value = *mean + (deviations != 0.0 ? deviations * *deviation : 0.0);
        path += fmt::format("{}{:.1f} {:.1f}{}", pen_down ? "L" : "M",
                            across(freedom, 0.5 * (bin_low(freedom, i) + bin_low(freedom, i + 1))),
                            std::clamp(down(error, value), panel_rim, panel_height - panel_rim),
                            pen_down ? "" : "h0");
        pen_down = true;
    }
    return path;
}

std::string spread_text(const RunningMoments& moments) {
    if (!moments.standard_deviation())
        return moments.mean() ? fmt::format("{:.3g}", *moments.mean()) : "none";
    return fmt::format("{:.3g} ± {:.3g}", *moments.mean(), *moments.standard_deviation());
}

std::string bin_text(const PairBin& bin, double low, double high, std::size_t e, std::size_t f) {
    const std::size_t beyond = bin.all.count() - bin.inside.count();
    std::string text = fmt::format("{}: {:.4g} to {:.4g}\n{} poses\n{}: {}", freedom_label(f), low,
                                   high, bin.all.count(), error_label(e), spread_text(bin.inside));
    if (beyond > 0)
        text += fmt::format("\n{} beyond the axis; with them {}", beyond, spread_text(bin.all));
    return text;
}

class Picture {
public:
    Picture(const PairMatrix& matrix, PairPicture kind)
        : matrix_(matrix), kind_(kind), highest_(matrix.highest_count()) {}

    std::string text() const {
        std::string svg = fmt::format(
            "<svg class='plot pairs' viewBox='0 0 {} {}' role='img' aria-label='pose errors of {} "
            "against the true pose'{}>",
            picture_width, picture_height, escape_html(matrix_.detector),
            in_page() ? "" : " xmlns:xlink='http://www.w3.org/1999/xlink'");
        svg += heading();
        if (matrix_.detected == 0)
            return svg + "</svg>";
        for (std::size_t e = 0; e < pose_component_count; ++e) {
            svg += row_labels(e);
            for (std::size_t f = 0; f < pose_component_count; ++f)
                svg += panel(e, f);
        }
        for (std::size_t f = 0; f < pose_component_count; ++f)
            svg += column_labels(f);
        return svg + footnote() + "</svg>";
    }

private:
    bool in_page() const { return kind_ == PairPicture::in_page; }

    std::string heading() const {
        std::string text =
            fmt::format("<text class='title' x='{}' y='22'>{}: {} of {} poses detected</text>",
                        left, escape_html(matrix_.detector), matrix_.detected, matrix_.poses);
        return matrix_.detected == 0 ? text : text + legend();
    }

    std::string legend() const {
        std::string text = fmt::format("<text x='{}' y='46'>poses per cell</text>", left);
        double x = left + 88;
        text += fmt::format("<text x='{}' y='46' text-anchor='end'>1</text>", x + 8);
        x += 12;
        text += ramp(blues, x, 38) + ramp(oranges, x, 43);
        text += fmt::format("<text x='{}' y='46'>{} (logarithmic)</text>", x + 126, highest_);
        x += 260;
        text += fmt::format(
            "<rect fill='#4292c6' x='{0}' y='36' width='12' height='12'/><text x='{1}' "
            "y='46'>inside the axis</text><rect fill='#f16913' x='{2}' y='36' width='12' "
            "height='12'/><text x='{3}' y='46'>beyond it (▲ ▼ how many)</text>",
            x, x + 17, x + 118, x + 135);
        x += 310;
        return text + fmt::format(
                          "<path class='mean' d='M{0} 42h26'/><text x='{1}' y='46'>mean</text>"
                          "<path class='spread' d='M{2} 42h26'/><text x='{3}' y='46'>± standard "
                          "deviation, inside</text>",
                          x, x + 32, x + 84, x + 116);
    }

    static std::string ramp(const std::array<Colour, 4>& scheme, double x, double y) {
        constexpr int steps = 24;
        std::string text = "<g class='density' shape-rendering='crispEdges'>";
        for (int i = 0; i < steps; ++i) {
            const Colour colour = mixed(scheme, i / (steps - 1.0));
            text +=
                fmt::format("<rect x='{}' y='{}' width='5' height='5' fill='#{:02x}{:02x}{:02x}'/>",
                            x + 5 * i, y, static_cast<int>(colour[0]), static_cast<int>(colour[1]),
                            static_cast<int>(colour[2]));
        }
        return text + "</g>";
    }

    std::string row_labels(std::size_t e) const {
        const double y = panel_y(e), x = left + 6 * panel_width + 5 * gap + 6;
        std::string text = fmt::format(
            "<text class='label' transform='translate(16 {:.1f}) rotate(-90)' "
            "text-anchor='middle'>{}</text>",
            y + 0.5 * panel_height, error_label(e));
        for (const double tick : ticks(matrix_.errors[e], e))
            text += fmt::format("<text x='{:.1f}' y='{:.1f}' text-anchor='end'>{:.4g}</text>",
                                left - 6, y + down(matrix_.errors[e], tick) + 4, tick);
        return text + fmt::format(
                          "<text x='{0:.1f}' y='{1:.1f}'>▲ {2}</text><text x='{0:.1f}' "
                          "y='{3:.1f}'>▼ {4}</text>",
                          x, y + 10, matrix_.above[e], y + panel_height - 2, matrix_.below[e]);
    }

    // Labels near a panel's edge stay within its width, or they would touch their neighbours.
    std::string column_labels(std::size_t f) const {
        const double x = panel_x(f), y = top + 6 * panel_height + 5 * gap;
        std::string text =
            fmt::format("<text class='label' x='{:.1f}' y='{:.1f}' text-anchor='middle'>{}</text>",
                        x + 0.5 * panel_width, y + 36, freedom_label(f));
        for (const double tick : ticks(matrix_.freedoms[f], f)) {
            const double place = across(matrix_.freedoms[f], tick);
            const char* anchor = place < 12 ? "start" : place > panel_width - 12 ? "end" : "middle";
            text += fmt::format("<text x='{:.1f}' y='{:.1f}' text-anchor='{}'>{:.4g}</text>",
                                x + place, y + 16, anchor, tick);
        }
        return text;
    }

    std::string panel(std::size_t e, std::size_t f) const {
        const Interval& freedom = matrix_.freedoms[f];
        const Interval& error = matrix_.errors[e];
        const PairPanel& data = matrix_.panels[e][f];
        std::string text = fmt::format("<g class='panel' transform='translate({} {})'{}>",
                                       panel_x(f), panel_y(e), in_page() ? page_data(e, f) : "");
        text +=
            fmt::format("<rect class='paper' width='{}' height='{}'/>", panel_width, panel_height);
        text += grid(e, f);
        text += fmt::format(
            "<image class='density' width='{}' height='{}' preserveAspectRatio='none' "
            "image-rendering='optimizeSpeed' {}='{}'/>",
            panel_width, panel_height, in_page() ? "href" : "xlink:href",
            png_data_uri(density(data, highest_)));
        const std::string mean = bin_path(data, freedom, error, 0.0);
        for (const double deviations : {-1.0, 1.0})
            text += fmt::format("<path class='spread' d='{}'/>",
                                bin_path(data, freedom, error, deviations));
        text += fmt::format("<path class='halo' d='{0}'/><path class='mean' d='{0}'/>", mean);
        text +=
            fmt::format("<rect class='axis' width='{}' height='{}'/>", panel_width, panel_height);
        if (in_page())
            text += bins(e, f);
        return text + "</g>";
    }

    std::string page_data(std::size_t e, std::size_t f) const {
        const Interval &freedom = matrix_.freedoms[f], &error = matrix_.errors[e];
        return fmt::format(
            " tabindex='0' role='button' aria-label='enlarge' data-name='{}' data-x='{}|{:.6g}|"
            "{:.6g}' data-y='{}|{:.6g}|{:.6g}'",
            escape_html(matrix_.detector), freedom_label(f), freedom.low, freedom.high,
            error_label(e), error.low, error.high);
    }

    std::string grid(std::size_t e, std::size_t f) const {
        std::string path;
        for (const double tick : ticks(matrix_.errors[e], e))
            path += fmt::format("M0 {:.1f}H{}", down(matrix_.errors[e], tick), panel_width);
        for (const double tick : ticks(matrix_.freedoms[f], f))
            path += fmt::format("M{:.1f} {}V{}", across(matrix_.freedoms[f], tick), panel_rim,
                                panel_height - panel_rim);
        return "<path class='grid' d='" + path + "'/>";
    }

    std::string bins(std::size_t e, std::size_t f) const {
        std::string text;
        const double width = panel_width / PairMatrix::bins;
        const Interval& freedom = matrix_.freedoms[f];
        for (std::size_t i = 0; i < PairMatrix::bins; ++i)
            text += fmt::format(
                "<rect class='bin' x='{}' width='{}' height='{}'><title>{}</title></rect>",
                width * static_cast<double>(i), width, panel_height,
                bin_text(matrix_.panels[e][f].bins[i], bin_low(freedom, i), bin_low(freedom, i + 1),
                         e, f));
        return text;
    }

    std::string footnote() const {
        return fmt::format(
            "<text class='note' x='{}' y='{}'>An error's axis spans its median ± {} robust "
            "standard deviations, or less where the data end before; what lies beyond is shown in "
            "the panels' rims.</text>",
            left, picture_height - 8, PairMatrix::robust_deviations);
    }

    const PairMatrix& matrix_;
    PairPicture kind_;
    std::uint32_t highest_;
};

// Style rules of the picture; those of a page follow its colours.
std::string pair_matrix_style(PairPicture kind) {
    const bool is_page = kind == PairPicture::in_page;
    const char* paper = is_page ? "var(--card)" : "#fff";
    return fmt::format(
        ".pairs .title{{font-size:15px;font-weight:600}}.pairs .label{{font-weight:600}}.pairs "
        ".note{{font-size:11px}}.panel .paper{{fill:{}}}.panel "
        ".grid{{fill:none;stroke-width:1}}.panel image{{image-rendering:pixelated}}.plot "
        ".halo{{fill:none;stroke:{};stroke-width:4;stroke-linejoin:round;stroke-linecap:round}}."
        "plot .mean,.plot "
        ".spread{{fill:none;stroke:{};stroke-width:1.8;stroke-linejoin:round;stroke-linecap:round}}"
        ".plot .spread{{stroke-width:1.3;stroke-dasharray:4 3}}",
        paper, paper, is_page ? "var(--mean)" : "#d1131f");
}

std::string sized_script() {
    std::string text = std::string("<script>\n") + pair_matrix_js + "</script>\n";
    for (const auto& [word, value] : {std::pair("%RIM%", panel_rim / panel_height),
                                      {"%WIDTH%", panel_width},
                                      {"%HEIGHT%", panel_height}})
        text.replace(text.rfind(word), std::strlen(word), fmt::format("{:.6g}", value));
    return text;
}

}  // namespace

std::uint32_t PairMatrix::highest_count() const {
    std::uint32_t highest = 0;
    for (const auto& line : panels)
        for (const PairPanel& panel : line)
            for (const std::uint32_t count : panel.counts)
                highest = std::max(highest, count);
    return highest;
}

PairMatrix pair_matrix(const std::string& detector, std::span<const PoseComponents> truth,
                       const DetectorErrors& errors) {
    if (truth.size() != errors.size())
        throw NumericalError(
            fmt::format("pair matrix: {} true poses and {} errors", truth.size(), errors.size()));
    PairMatrix matrix;
    matrix.detector = detector;
    matrix.poses = errors.size();
    matrix.detected = static_cast<std::size_t>(std::count_if(
        errors.begin(), errors.end(), [](const auto& error) { return error.has_value(); }));
    if (matrix.detected == 0)
        return matrix;
    find_axes(matrix, truth, errors);
    for (auto& line : matrix.panels)
        for (PairPanel& panel : line) {
            panel.counts.resize(PairMatrix::columns * (PairMatrix::rows + 2));
            panel.bins.resize(PairMatrix::bins);
        }
    for (std::size_t i = 0; i < errors.size(); ++i)
        if (errors[i])
            add(matrix, truth[i], *errors[i]);
    return matrix;
}

std::string pair_matrix_svg(const PairMatrix& matrix) {
    std::string svg = stand_alone_svg(Picture(matrix, PairPicture::stand_alone).text());
    return svg.insert(svg.find("</style>"), pair_matrix_style(PairPicture::stand_alone));
}

void add_pair_matrices(HtmlPage& page, std::span<const PairMatrix> matrices) {
    if (matrices.empty())
        return;
    page.add_style(pair_matrix_style(PairPicture::in_page) + pair_matrix_css);
    std::string tabs, pages, rules;
    for (std::size_t i = 0; i < matrices.size(); ++i) {
        tabs += fmt::format(
            "<input type=\"radio\" name=\"pairs\" id=\"pairs{0}\"{1}><label for=\"pairs{0}\">{2}"
            "</label>",
            i, i == 0 ? " checked" : "", escape_html(matrices[i].detector));
        pages += fmt::format("<div class=\"pair-page pairs{}\">{}</div>", i,
                             Picture(matrices[i], PairPicture::in_page).text());
        rules += fmt::format("#pairs{0}:checked~.pairs{0}{{display:block}}", i);
    }
    page.add_style(rules);
    page.add_html("<div class=\"pair-tabs\">" + tabs + pages + "</div>" + sized_script());
}

}  // namespace etalon
