#include "sim/tiles/cell_coverage.h"

#include <array>
#include <numbers>

#include "sim/tiles/cell_sum.h"

namespace etalon {
namespace {

struct RingRule {
    int rings;
    std::array<double, 4> area, weight;  // enclosed share of the disk's area; share of the weight
};

// Gauss-Legendre on [0, 1] (Abramowitz and Stegun, table 25.4).
constexpr std::array<RingRule, 4> ring_rules{{
    {1, {0.5}, {1.0}},
    {2, {0.2113248654051871, 0.7886751345948129}, {0.5, 0.5}},
    {3,
     {0.1127016653792583, 0.5, 0.8872983346207417},
     {0.2777777777777778, 0.4444444444444444, 0.2777777777777778}},
    {4,
     {0.0694318442029737, 0.3300094782075719, 0.6699905217924281, 0.9305681557970263},
     {0.1739274225687269, 0.3260725774312731, 0.3260725774312731, 0.1739274225687269}},
}};

}  // namespace

std::vector<LensPoint> lens_points(double radius_mm, int rings, int spokes) {
    if (spokes == 0)
        return {{Eigen::Vector2d::Zero(), 1.0}};
    const RingRule& rule = ring_rules[static_cast<std::size_t>(rings - 1)];
    std::vector<LensPoint> points;
    for (int ring = 0; ring < rings; ++ring) {
        const auto r = static_cast<std::size_t>(ring);
        const double radius = radius_mm * std::sqrt(rule.area[r]);
        for (int spoke = 0; spoke < spokes; ++spoke) {
            const double turn = spoke + 0.25 + 0.5 * (ring % 2);
            const double angle = 2.0 * std::numbers::pi * turn / spokes;
            points.push_back(
                {{radius * std::cos(angle), radius * std::sin(angle)}, rule.weight[r] / spokes});
        }
    }
    return points;
}

// Returns the index of the cell before the first line that crosses the box.
int CellCoverage::cut_box(int axis, int first, int last, const Eigen::Vector2d& x,
                          const SensorPoint& point, const Eigen::Matrix2d& sides,
                          const Eigen::Vector2d& l, std::vector<SquareCut>& cuts) const {
    cuts.clear();
    int base = first;
    for (int i = first + 1; i <= last; ++i) {
        const LensLine line = view_.lens_line(axis, i, point);
        const double offset = line.offset + line.slope.dot(l);
        const Eigen::Vector2d gradient = sides.transpose() * view_.line_gradient(axis, i, x, l);
        const double reach = 0.5 * gradient.cwiseAbs().sum();
        if (offset >= reach) {
            base = i;
            cuts.clear();
        } else if (offset <= -reach) {
            break;
        } else {
            cuts.push_back(square_cut(gradient, offset));
        }
    }
    return base;
}

double CellCoverage::over(const Eigen::Vector2d& x, const Eigen::Matrix2d& sides,
                          const CellRange& range) {
    if (range.is_single())
        return view_.cell(range.first_column, range.first_row);
    const SensorPoint point = view_.sensor_point(x);
    double sum = 0.0;
    for (const LensPoint& p : points_) {
        const int column = cut_box(0, range.first_column, range.last_column, x, point, sides,
                                   p.l_mm, column_cuts_);
        const int row =
            cut_box(1, range.first_row, range.last_row, x, point, sides, p.l_mm, row_cuts_);
        sum +=
            p.weight * sum_of_cells(view_, column, row, column_cuts_, row_cuts_, square_wedge_area);
    }
    return sum;
}

}  // namespace etalon
