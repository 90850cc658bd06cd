#include "sim/marker/stag_pattern.h"

#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "sim/marker/cell_grid.h"

namespace etalon {
namespace {

constexpr double code_radius = 0.35;
// Published in units of the code's diameter: of a disc, and of one that joins two of them.
constexpr double disc_radius = 0.062482177287080 * 2.0 * code_radius;
constexpr double joint_radius = 0.7 * disc_radius;
constexpr double joined_below = 4.0 * disc_radius;  // distance of the centres

struct PolarPoint {
    double radius;  // in code diameters
    double angle;   // from x to the marker's upper edge
};

// A quadrant is symmetric about its diagonal.
std::array<PolarPoint, stag_bits_a_quarter> first_quadrant() {
    constexpr double right = std::numbers::pi / 2.0;
    return {{{0.088363142525988, right / 2.0},
             {0.206935928182607, 0.459275804122858},
             {0.206935928182607, right - 0.459275804122858},
             {0.313672146827381, 0.200579720495241},
             {0.327493143484516, 0.591687617505840},
             {0.327493143484516, right - 0.591687617505840},
             {0.313672146827381, right - 0.200579720495241},
             {0.437421957035861, 0.145724938287167},
             {0.437226762361658, 0.433363129825345},
             {0.430628029742607, right / 2.0},
             {0.437226762361658, right - 0.433363129825345},
             {0.437421957035861, right - 0.145724938287167}}};
}

std::array<Eigen::Vector2d, stag_bits> all_quadrants() {
    std::array<Eigen::Vector2d, stag_bits> points;
    std::size_t i = 0;
    for (int quarter = 0; quarter < 4; ++quarter)
        for (const PolarPoint& point : first_quadrant()) {
            const double angle = point.angle + quarter * std::numbers::pi / 2.0;
            points[i++] = 2.0 * code_radius * point.radius *
                          Eigen::Vector2d(std::cos(angle), -std::sin(angle));
        }
    return points;
}

// A disc given in sides of the marker, from its centre.
void draw_disc(cv::Mat& cells, const Eigen::Vector2d& centre, double radius, float radiance) {
    constexpr double cell = 1.0 / stag_cells_a_side;
    const Eigen::Vector2d middle = centre / cell + Eigen::Vector2d::Constant(cells.cols / 2.0);
    fill_disc(cells, middle, Eigen::Vector2d::Constant(radius / cell), radiance);
}

bool is_black(StagCode code, std::size_t point) {
    return (code >> point & 1) != 0;
}

void draw_code_discs(cv::Mat& cells, StagCode code) {
    const auto& points = stag_code_points();
    for (std::size_t i = 0; i < points.size(); ++i)
        draw_disc(cells, points[i], disc_radius, is_black(code, i) ? black : white);
}

void join_black_discs(cv::Mat& cells, StagCode code) {
    const auto& points = stag_code_points();
    for (std::size_t i = 0; i < points.size(); ++i)
        for (std::size_t j = 0; j < i; ++j)
            if (is_black(code, i) && is_black(code, j) &&
                (points[i] - points[j]).norm() < joined_below)
                draw_disc(cells, (points[i] + points[j]) / 2.0, joint_radius, black);
}

// Every cell takes the colour of most of those around it, which removes slivers between discs.
void round_off(cv::Mat& cells) {
    constexpr int reach = 5, passes = 5;  // 12 of 800 pixels a side in the generator
    cv::Mat kernel(2 * reach + 1, 2 * reach + 1, CV_32FC1, cv::Scalar::all(0.0));
    for (int y = -reach; y <= reach; ++y)
        for (int x = -reach; x <= reach; ++x)
            kernel.at<float>(reach + y, reach + x) = x * x + y * y <= reach * reach ? 1.0f : 0.0f;
    const double half = cv::sum(kernel)[0] / 2.0;
    for (int pass = 0; pass < passes; ++pass) {
        cv::Mat whites;
        cv::filter2D(cells, whites, CV_32F, kernel);
        cv::threshold(whites, cells, half, white, cv::THRESH_BINARY);
    }
}

// The code on white, as large as the disk; it does not reach the disk's edge.
cv::Mat code_cells(StagCode code) {
    constexpr int side = static_cast<int>(2.0 * stag_circle_radius * stag_cells_a_side);
    cv::Mat cells(side, side, CV_32FC1, cv::Scalar::all(white));
    draw_code_discs(cells, code);
    join_black_discs(cells, code);
    draw_code_discs(cells, code);
    round_off(cells);
    draw_code_discs(cells, code);
    return cells;
}

}  // namespace

const std::array<Eigen::Vector2d, stag_bits>& stag_code_points() {
    static const std::array<Eigen::Vector2d, stag_bits> points = all_quadrants();
    return points;
}

cv::Mat stag_cells(StagCode code) {
    constexpr int border = stag_cells_a_side / 8, whole = stag_cells_a_side + 2 * border;
    static_assert(border == stag_border * stag_cells_a_side);
    cv::Mat cells(whole, whole, CV_32FC1, cv::Scalar::all(white));
    cells(cv::Rect(border, border, stag_cells_a_side, stag_cells_a_side))
        .setTo(cv::Scalar::all(black));
    draw_disc(cells, Eigen::Vector2d::Zero(), stag_circle_radius, white);
    const cv::Mat inside = code_cells(code);
    const int corner = (whole - inside.cols) / 2;
    cv::Mat middle = cells(cv::Rect(corner, corner, inside.cols, inside.rows));
    cv::min(inside, middle, middle);
    return cells;
}

}  // namespace etalon
