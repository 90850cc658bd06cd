#include "sim/marker/board_pattern.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/program/errors.h"
#include "sim/marker/tag_pattern.h"

namespace etalon {
namespace {

constexpr double max_cells = 16e6;
constexpr int max_cells_a_period = 256;

// The cells of a board whose pattern repeats after `period` mm, `count` cells to a period.
struct Drawing {
    CellGrid grid;

    // Fills a rectangle given in the board's frame; edges go to the nearest cell border.
    void fill(const Eigen::Vector2d& low_mm, const Eigen::Vector2d& high_mm, float radiance) {
        const Eigen::Vector2i low = border(low_mm), high = border(high_mm);
        grid.cells(cv::Rect(low.x(), low.y(), high.x() - low.x(), high.y() - low.y()))
            .setTo(cv::Scalar::all(radiance));
    }

    Eigen::Vector2i border(const Eigen::Vector2d& point_mm) const {
        const Eigen::Vector2d cells = (point_mm - grid.corner_mm).cwiseQuotient(grid.cell_mm);
        return cells.array().round().cast<int>();
    }
};

Drawing blank(const Eigen::Vector2d& low_mm, const Eigen::Vector2d& high_mm,
              const Eigen::Vector2d& cell_mm) {
    const Eigen::Vector2i size =
        (high_mm - low_mm).cwiseQuotient(cell_mm).array().round().matrix().cast<int>();
    return {{cv::Mat(size.y(), size.x(), CV_32FC1, cv::Scalar::all(white)), low_mm, cell_mm}};
}

// Into how many cells a period is cut so that all edges (mm from its start) are borders of cells:
// the fewest, or else those with the smallest error. A board has one period more than columns.
int cells_a_period(int columns, int rows, double period_mm, const std::vector<double>& edges_mm,
                   double allowed_mm) {
    const int most = static_cast<int>(
        std::min<double>(max_cells_a_period, std::sqrt(max_cells / (columns + 1) / (rows + 1))));
    int best = 0;
    double smallest = allowed_mm;
    for (int count = 1; count <= most; ++count) {
        double worst = 0.0;
        for (const double edge : edges_mm) {
            const double cells = edge / period_mm * count;
            worst = std::max(worst, std::abs(cells - std::round(cells)) * period_mm / count);
        }
        if (worst < smallest) {
            best = count;
            smallest = worst;
        }
        if (worst < 1e-9 * period_mm)
            return count;
    }
    if (best == 0)
        throw ConfigError({}, fmt::format("edges cannot be drawn to {:.3g} mm with {} cells to {} "
                                          "mm: take a smaller board or lengths with a simple ratio",
                                          allowed_mm, most, period_mm));
    return best;
}

// The same where a tag's cells begin at `first_mm`.
int cells_a_period_of_tags(int columns, int rows, double period_mm, double first_mm, int tag_cells,
                           double tag_cell_mm) {
    std::vector<double> edges;
    for (int i = 0; i <= tag_cells; ++i)
        edges.push_back(first_mm + i * tag_cell_mm);
    return cells_a_period(columns, rows, period_mm, edges, tag_cell_mm / 20.0);
}

// A tag's cells into the square [low, low + side].
void draw_tag(Drawing& drawing, const cv::Mat& cells, const Eigen::Vector2d& low_mm,
              double side_mm) {
    const double cell = side_mm / cells.cols;
    for (int y = 0; y < cells.rows; ++y)
        for (int x = 0; x < cells.cols; ++x)
            drawing.fill(low_mm + Eigen::Vector2d(x, y) * cell,
                         low_mm + Eigen::Vector2d(x + 1, y + 1) * cell, cells.at<float>(y, x));
}

std::array<Eigen::Vector2d, 4> square_mm(const Eigen::Vector2d& low, double side) {
    return {low, low + Eigen::Vector2d(side, 0), low + Eigen::Vector2d(side, side),
            low + Eigen::Vector2d(0, side)};
}

std::vector<Eigen::Vector3d> point_grid(int columns, int rows, double spacing) {
    std::vector<Eigen::Vector3d> points;
    for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column)
            points.emplace_back(column * spacing, row * spacing, 0.0);
    return points;
}

// The corners of squares that stand `period` apart, as a grid of 2 columns x 2 rows.
std::vector<Eigen::Vector3d> corner_grid(int columns, int rows, double square, double period) {
    std::vector<Eigen::Vector3d> points;
    for (int row = 0; row < 2 * rows; ++row)
        for (int column = 0; column < 2 * columns; ++column)
            points.emplace_back(column / 2 * period + column % 2 * square,
                                row / 2 * period + row % 2 * square, 0.0);
    return points;
}

// The black square with its border of one cell, without what is around it.
cv::Mat aruco_cells(const std::string& dictionary, int id) {
    const TagPattern pattern = aruco_pattern(dictionary, id);
    return pattern.cells(cv::Rect(pattern.reference_start, pattern.reference_start,
                                  pattern.reference_cells, pattern.reference_cells));
}

// The black square with one more cell of border all around.
cv::Mat kalibr_cells(const std::string& family, int id) {
    const TagPattern pattern = apriltag_pattern(family, id);
    const cv::Mat& cells = pattern.cells;
    if (pattern.reference_start != 1 || cells.cols != pattern.reference_cells + 2)
        throw ConfigError({}, "the tags of " + family +
                                  " have data outside their square: a grid takes 36h11, 36h10, "
                                  "25h9 or 16h5");
    cv::Mat whole(cells.size(), CV_32FC1, cv::Scalar::all(black));
    const cv::Rect inside(1, 1, cells.cols - 2, cells.rows - 2);
    cells(inside).copyTo(whole(inside));
    return whole;
}

}  // namespace

BoardPattern chessboard_pattern(int columns, int rows, double square) {
    BoardPattern board;
    // One square more than corners each way, and the white margin of a square's width around.
    cv::Mat cells(rows + 3, columns + 3, CV_32FC1, cv::Scalar::all(white));
    for (int row = 0; row <= rows; ++row)
        for (int column = row % 2; column <= columns; column += 2)
            cells.at<float>(row + 1, column + 1) = black;
    board.grid = {cells, {-2.0 * square, -2.0 * square}, {square, square}};
    board.points_mm = point_grid(columns, rows, square);
    board.detail_mm = square;
    return board;
}

std::vector<BoardTag> charuco_tags(int columns, int rows, double square, double marker,
                                   const CharucoLayout& layout) {
    std::vector<BoardTag> tags;
    const double margin = (square - marker) / 2.0;
    for (int row = 0; row < rows; ++row)
        for (int column = (row + (layout.white_corner ? 0 : 1)) % 2; column < columns; column += 2)
            tags.push_back(
                {layout.first_id + static_cast<int>(tags.size()),
                 square_mm({(column - 1) * square + margin, (row - 1) * square + margin}, marker)});
    return tags;
}

BoardPattern charuco_pattern(const std::string& dictionary, int columns, int rows, double square,
                             double marker, const CharucoLayout& layout) {
    const std::vector<BoardTag> tags = charuco_tags(columns, rows, square, marker, layout);
    const int tag_cells = aruco_cells(dictionary, 0).cols;
    const double margin = (square - marker) / 2.0, tag_cell = marker / tag_cells;
    const double cell =
        square / cells_a_period_of_tags(columns, rows, square, margin, tag_cells, tag_cell);
    const double around = std::round(margin / cell) * cell;  // the quiet zone of the outer markers
    const Eigen::Vector2d corner(-square - around, -square - around);
    Drawing drawing = blank(
        corner, Eigen::Vector2d((columns - 1) * square + around, (rows - 1) * square + around),
        {cell, cell});
    for (int row = 0; row < rows; ++row)
        for (int column = (row + (layout.white_corner ? 1 : 0)) % 2; column < columns; column += 2)
            drawing.fill(Eigen::Vector2d(column - 1, row - 1) * square,
                         Eigen::Vector2d(column, row) * square, black);
    for (const BoardTag& tag : tags)
        draw_tag(drawing, aruco_cells(dictionary, tag.id), tag.corners_mm[0], marker);
    return {drawing.grid, point_grid(columns - 1, rows - 1, square), tag_cell};
}

std::vector<BoardTag> aprilgrid_tags(int columns, int rows, double tag, double gap) {
    std::vector<BoardTag> tags;
    for (int row = rows - 1; row >= 0; --row)
        for (int column = 0; column < columns; ++column)
            tags.push_back({static_cast<int>(tags.size()),
                            square_mm(Eigen::Vector2d(column, row) * (tag + gap), tag)});
    return tags;
}

BoardPattern aprilgrid_pattern(const std::string& family, int columns, int rows, double tag,
                               double gap) {
    const int tag_cells = kalibr_cells(family, 0).cols;
    const double period = tag + gap, tag_cell = tag / tag_cells;
    const double cell =
        period / cells_a_period_of_tags(columns, rows, period, 0.0, tag_cells, tag_cell);
    // Around the outer tags their corner squares, and as much white again.
    const double around = 2.0 * (period - std::round(tag / cell) * cell);
    Drawing drawing =
        blank(Eigen::Vector2d(-around, -around),
              Eigen::Vector2d(columns * period - gap, rows * period - gap).array() + around,
              {cell, cell});
    for (int row = 0; row <= rows; ++row)
        for (int column = 0; column <= columns; ++column) {
            const Eigen::Vector2d high = Eigen::Vector2d(column, row) * period;
            drawing.fill(high - Eigen::Vector2d(gap, gap), high, black);
        }
    for (const BoardTag& placed : aprilgrid_tags(columns, rows, tag, gap))
        draw_tag(drawing, kalibr_cells(family, placed.id), placed.corners_mm[0], tag);

    return {drawing.grid, corner_grid(columns, rows, tag, period), std::min(tag_cell, gap)};
}

double nearest_circle_mm(CircleLayout layout, double spacing) {
    return layout == CircleLayout::asymmetric ? spacing * std::sqrt(2.0) : spacing;
}

std::vector<Eigen::Vector2i> circle_places(CircleLayout layout, int columns, int rows) {
    const bool by_halves = layout == CircleLayout::hexagonal;
    std::vector<Eigen::Vector2i> places;
    for (int row = 0; row < rows; ++row)
        for (int column = by_halves ? (rows - 1 - row) % 2 : 0; column < columns;
             column += by_halves ? 2 : 1)
            places.emplace_back(layout == CircleLayout::asymmetric ? 2 * column + row % 2 : column,
                                row);
    return places;
}

BoardPattern circles_pattern(CircleLayout layout, int columns, int rows, double spacing,
                             double diameter) {
    constexpr double cells_a_diameter = 128.0, min_cells_a_diameter = 24.0;
    constexpr double printable_cells = 3.9e6;  // as outlines: sim/marker/marker_print.h
    const bool hexagonal = layout == CircleLayout::hexagonal;
    const Eigen::Vector2d step = spacing * Eigen::Vector2d(hexagonal ? 0.5 : 1.0,
                                                           hexagonal ? std::sqrt(0.75) : 1.0),
                          margin = step.cwiseProduct(Eigen::Vector2d(hexagonal ? 2.0 : 1.0, 1.0));
    BoardPattern board;
    Eigen::Vector2d last = Eigen::Vector2d::Zero();
    for (const Eigen::Vector2i& place : circle_places(layout, columns, rows)) {
        const Eigen::Vector2d mm = step.cwiseProduct(place.cast<double>());
        board.points_mm.emplace_back(mm.x(), mm.y(), 0.0);
        last = last.cwiseMax(mm);
    }
    board.detail_mm = diameter / 10.0;  // what makes a disk round

    // A whole number of cells to a step.
    const double most = std::sqrt(printable_cells / ((last + 2.0 * margin) / spacing).prod());
    const double cells_a_spacing =
        std::floor(std::min(most, std::ceil(cells_a_diameter * spacing / diameter)));
    const Eigen::Vector2d cell =
        step.array() / (cells_a_spacing * step.array() / spacing - 1e-9).ceil();
    if (!(diameter / spacing * cells_a_spacing >= min_cells_a_diameter))
        throw ConfigError({}, fmt::format("too many circles, or too small ones for their spacing, "
                                          "to be drawn with {} cells to a diameter",
                                          min_cells_a_diameter));
    Drawing drawing = blank(-margin, last + margin, cell);
    for (const Eigen::Vector3d& centre : board.points_mm)
        fill_disc(drawing.grid.cells, drawing.border(centre.head<2>()).cast<double>(),
                  (diameter / 2.0 * cell.cwiseInverse()).eval(), black);
    board.grid = drawing.grid;
    return board;
}

BoardPattern squares_pattern(int columns, int rows, double square, double gap) {
    const double period = square + gap;
    const double cell = period / cells_a_period(columns, rows, period, {square}, square / 50.0);
    const double around = std::round(gap / cell) * cell;
    Drawing drawing =
        blank(Eigen::Vector2d(-around, -around),
              Eigen::Vector2d(columns * period - gap + around, rows * period - gap + around),
              {cell, cell});
    for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column) {
            const Eigen::Vector2d low = Eigen::Vector2d(column, row) * period;
            drawing.fill(low, low.array() + square, black);
        }
    return {drawing.grid, corner_grid(columns, rows, square, period), std::min(square, gap)};
}

}  // namespace etalon
