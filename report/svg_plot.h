// Plots for reports as SVG text: scatter, lines, bands, arrows, with ticks at 1-2-5 steps. Colours
// come from the page's style sheet (report/html.h), also in dark mode. A plot in a file of its own
// has its style in it. Every point shows its values when pointed at.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace etalon {

// The colours of the style sheet, safe for colour-blind readers (Okabe and Ito 2008).
enum class Color { blue, orange, green, red, purple, sky, gray };

// Round numbers in [low, high], low < high: at most `most` + 1, at steps of 1, 2 or 5 times 10^n.
std::vector<double> axis_ticks(double low, double high, int most);

// 1, 2 or 5 times a power of ten, not above `value` > 0: a magnification to draw something at.
double round_scale(double value);

// What a layer of a plot shows, collected point by point; notes are shown when pointed at.
struct Series {
    std::vector<double> xs, ys;
    std::vector<double> us, vs;  // low and high end of a band; an arrow's components, plot units
    std::vector<std::string> notes;

    void add(double x, double y, std::string note = "");
    void add(double x, double y, double u, double v, std::string note = "");
    void add(const Eigen::Vector2d& at, const Eigen::Vector2d& along, std::string note = "") {
        add(at.x(), at.y(), along.x(), along.y(), std::move(note));
    }
    bool empty() const { return xs.empty(); }
    double longest() const;  // of the arrows
};

// What SvgPlot draws one above the other.
struct PlotLayer : Series {
    enum class Kind { points, line, band, bars, arrows, level } kind;
    Color color;
    std::string name;
};

class SvgPlot {
public:
    // Size in CSS pixels; the picture scales with the page.
    SvgPlot(std::string x_label, std::string y_label, int width = 560, int height = 400);
    void set_size(int width, int height);
    // Equal scales on both axes (maps), y growing downwards as in an image.
    void set_image_axes() { is_image_ = true; }
    // Both axes logarithmic, or y alone, for everything but bars and arrows that is added
    // afterwards; coordinates that are not positive are left out.
    void set_log_axes() { is_log_x_ = is_log_y_ = true; }
    void set_log_y_axis() { is_log_y_ = true; }
    // Fixed ends of the axis; otherwise they follow the data.
    void set_y_range(double low, double high) { y_range_ = {low, high}; }

    // Coordinates that are not finite are left out. Of more than 400 points (arrows) one a square
    // of 6 px (16 px) is drawn, the first (the longest), and the plot says so.
    void add_points(const Series& series, Color color, const std::string& name);
    void add_line(const Series& series, Color color, const std::string& name);
    // Filled between low and high.
    void add_band(const Series& series, Color color, const std::string& name);
    // A line and its points.
    void add_curve(const Series& series, Color color, const std::string& name);
    // Bars from 0, one per category, drawn at x = 0, 1, 2...
    void add_bars(const std::vector<std::string>& categories, const std::vector<double>& values,
                  Color color);
    // Each as long as `magnification` times its own length.
    void add_arrows(const Series& arrows, double magnification, Color color,
                    const std::string& name);
    // Image axes, and the border of an image of this size, so that the plot shows all of it.
    void show_image(int width, int height);
    // A dashed line across the plot with a label, for limits.
    void add_level(double y, Color color, const std::string& label);

    // The <svg> element, with its own style when it is to stand alone.
    std::string svg(bool stand_alone = false) const;

private:
    struct Frame;  // the map from data to picture

    void add(PlotLayer layer);
    Frame frame(double top) const;
    std::string axes(const Frame& frame) const;
    std::string thinning() const;

    std::string x_label_, y_label_;
    int width_, height_;
    bool is_image_ = false, is_log_x_ = false, is_log_y_ = false;
    std::optional<std::pair<double, double>> y_range_;
    std::vector<std::string> categories_;
    std::vector<PlotLayer> layers_;
};

// An <svg class='plot'> element of a page made into a file of its own: namespace, style and paper.
// Its colours are plain ones, as tools for papers (librsvg, Inkscape, TeX) know no CSS variables.
std::string stand_alone_svg(std::string svg);

// Plots of this size side by side as one file, row by row.
std::string svg_panels(std::span<SvgPlot> plots, int columns, int width, int height);

// A map of a positive quantity over an image: coloured cells, a scale, the value under the pointer.
// Colours: "viridis" (Smith and van der Walt), safe for colour-blind readers.
struct HeatMap {
    // Centres of the cells in image coordinates, their size, and the image they lie in, all in px.
    std::vector<Eigen::Vector2d> centres;
    std::vector<double> values;
    double cell_width = 0.0, cell_height = 0.0;
    int image_width = 0, image_height = 0;
    double highest = 0.0;  // of the scale, which begins at 0
    std::string unit;
    std::string axis_unit = "px";  // of what the cells lie in, where that is no image
};

// The <svg> element. Cells are cut off at the image's border; places without a cell stay empty.
std::string heat_map_svg(const HeatMap& map);

}  // namespace etalon
