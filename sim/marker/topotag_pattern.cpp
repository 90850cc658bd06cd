#include "sim/marker/topotag_pattern.h"

#include <algorithm>
#include <limits>

#include "core/program/errors.h"
#include "sim/marker/cell_grid.h"

namespace etalon {
namespace {

constexpr int pixels_of_round_cells = 28;  // of 16 to 64 the one with the best areas below 60

bool is_round(const std::string& family) {
    return family.ends_with("-circle");
}

void paint(cv::Mat& pixels, const TopotagShape& shape, int pixels_per_cell) {
    const Eigen::Vector2d centre =
        shape.centre * pixels_per_cell + Eigen::Vector2d(pixels.cols, pixels.rows) / 2.0;
    const double reach = shape.half_side * pixels_per_cell;
    const float radiance = shape.is_white ? 1.0f : 0.0f;
    if (shape.is_round)
        return fill_disc(pixels, centre, {reach, reach}, radiance);
    const auto first = [&](double middle) { return static_cast<int>(std::lround(middle - reach)); };
    const int side = static_cast<int>(std::lround(2.0 * reach));
    pixels(cv::Rect(first(centre.x()), first(centre.y()), side, side))
        .setTo(cv::Scalar::all(radiance));
}

}  // namespace

const std::vector<std::string>& topotag_families() {
    static const std::vector<std::string> families = {
        "3x3", "4x4", "5x5", "6x6", "3x3-circle", "4x4-circle", "5x5-circle", "6x6-circle"};
    return families;
}

int topotag_order(const std::string& family) {
    if (std::ranges::find(topotag_families(), family) == topotag_families().end())
        throw ConfigError({}, "unknown TopoTag family '" + family + "'");
    return family[0] - '0';
}

int topotag_count(const std::string& family) {
    constexpr int bits_of_an_int = std::numeric_limits<int>::digits;
    const int order = topotag_order(family), bits = order * order - 2;
    return bits < bits_of_an_int ? 1 << bits : std::numeric_limits<int>::max();
}

std::vector<Eigen::Vector2d> topotag_vertices(int order) {
    std::vector<Eigen::Vector2d> vertices;
    const double first = -topotag_spacing * (order - 1) / 2.0;
    for (int row = 0; row < order; ++row)
        for (int column = 0; column < order; ++column)
            vertices.emplace_back(first + topotag_spacing * column, first + topotag_spacing * row);
    vertices[1].x() -= topotag_spacing / 2.0;
    return vertices;
}

std::vector<TopotagShape> topotag_shapes(const std::string& family, int id) {
    const int order = topotag_order(family);
    const double white = topotag_white_side(order) / 2.0;
    std::vector<TopotagShape> shapes = {{{0, 0}, white + topotag_frame, false, false},
                                        {{0, 0}, white, false, true}};
    const std::vector<Eigen::Vector2d> vertices = topotag_vertices(order);
    for (const Eigen::Vector2d& vertex : vertices)
        shapes.push_back({vertex, topotag_node_half_side, is_round(family), false});
    for (std::size_t i = 0; i < vertices.size(); ++i) {
        const std::size_t weight = vertices.size() - 1 - i;  // of 6x6, 2^33 and less
        if (i < 2 || ((static_cast<long long>(id) >> weight) & 1) != 0)
            shapes.push_back({vertices[i], topotag_dot_half_side, is_round(family), true});
    }
    return shapes;
}

TopotagPattern topotag_pattern(const std::string& family, int id) {
    const std::vector<TopotagShape> shapes = topotag_shapes(family, id);
    const int cells =
        topotag_white_side(topotag_order(family)) + 2 * (topotag_frame + topotag_margin);
    TopotagPattern pattern;
    pattern.pixels_per_cell = is_round(family) ? pixels_of_round_cells : 1;
    pattern.pixels = cv::Mat(cells * pattern.pixels_per_cell, cells * pattern.pixels_per_cell,
                             CV_32FC1, cv::Scalar::all(1.0));
    for (const TopotagShape& shape : shapes)
        paint(pattern.pixels, shape, pattern.pixels_per_cell);
    return pattern;
}

}  // namespace etalon
