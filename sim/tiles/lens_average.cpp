#include "sim/tiles/lens_average.h"

namespace etalon {
namespace {

using std::numbers::pi;

// The sum of both closed-form methods (docs/rendering.md, "E") over a window: the aperture or a
// pixel's box. `column_cuts[n]` is its part beyond the line u = base_column + 1 + n, and so on. A
// cut has an `area`; wedge_area(a, b) is beyond both; fractions of the window.
template <class Cut, class WedgeArea>
double sum_of_cells(const MarkerView& view, int base_column, int base_row,
                    const std::vector<Cut>& column_cuts, const std::vector<Cut>& row_cuts,
                    WedgeArea wedge_area) {
    double sum = view.cell(base_column, base_row);
    int column = base_column;
    for (const Cut& cut : column_cuts) {
        ++column;
        sum += (view.cell(column, base_row) - view.cell(column - 1, base_row)) * cut.area;
    }
    int row = base_row;
    for (const Cut& row_cut : row_cuts) {
        ++row;
        sum += (view.cell(base_column, row) - view.cell(base_column, row - 1)) * row_cut.area;
        column = base_column;
        for (const Cut& cut : column_cuts) {
            ++column;
            const double mixed = view.cell(column, row) - view.cell(column - 1, row) -
                                 view.cell(column, row - 1) + view.cell(column - 1, row - 1);
            if (mixed != 0.0)
                sum += mixed * wedge_area(cut, row_cut);
        }
    }
    return sum;
}

// The chords cross at P inside the disk and b's normal lies counter-clockwise of a's by
// 0 < turn < pi.
double crossed_area(const DiskChord& a, const DiskChord& b, double turn, double sine,
                    double cosine) {
    // P's coordinate on a's chord, from its middle along the normal turned by +90 degrees, and on
    // b's. The second comes from the first: the errors of a tiny sine then cancel in the sum.
    const double s_a =
        std::clamp((a.offset * cosine - b.offset) / sine, -a.half_length, a.half_length);
    const double s_b = std::clamp(a.offset * sine + s_a * cosine, -b.half_length, b.half_length);
    // The arc is known without a choice between theta and theta + 2 pi.
    const double arc = a.half_angle + b.half_angle - turn;
    const double twice_area =
        arc + a.offset * (a.half_length - s_a) + b.offset * (b.half_length + s_b);
    return twice_area / (2.0 * pi);
}

}  // namespace

DiskChord disk_chord(const Eigen::Vector2d& normal, double offset) {
    DiskChord chord;
    chord.normal = normal;
    chord.offset = offset;
    chord.half_length = std::sqrt((1.0 - offset) * (1.0 + offset));
    chord.half_angle = std::atan2(chord.half_length, -offset);
    // Of a sliver, angle and chord cancel to third order: the difference must not come out
    // negative.
    chord.area = std::clamp((chord.half_angle + offset * chord.half_length) / pi, 0.0, 1.0);
    return chord;
}

double disk_wedge_area(const DiskChord& a, const DiskChord& b) {
    const double sine = a.normal.x() * b.normal.y() - a.normal.y() * b.normal.x();
    const double cosine = a.normal.dot(b.normal);
    if (sine < 0.0)
        return disk_wedge_area(b, a);
    const double turn = std::atan2(sine, cosine);
    // Where the chords do not cross, one of these angles is not negative. The largest decides, so
    // that rounding can only choose between cases with the same area.
    const double apart = turn - (a.half_angle + b.half_angle);
    const double around = a.half_angle + b.half_angle + turn - 2.0 * pi;
    const double a_inside_b = b.half_angle - a.half_angle - turn;
    const double b_inside_a = a.half_angle - b.half_angle - turn;
    const double largest = std::max({apart, around, a_inside_b, b_inside_a});
    double area;
    if (largest < 0.0)
        area = crossed_area(a, b, turn, sine, cosine);
    else if (largest == apart)
        area = 0.0;
    else if (largest == around)
        area = a.area + b.area - 1.0;
    else
        area = largest == a_inside_b ? a.area : b.area;
    const double least = std::max(0.0, a.area + b.area - 1.0);
    return std::clamp(area, least, std::max(least, std::min(a.area, b.area)));
}

namespace {

// The cuts of those lines behind the cells `first` to `last` that cross a window. Returns the cell
// before them. `line_at(i)` has a line's offset and reach, and makes its cut.
template <class LineAt, class Cut>
int cut_window(int first, int last, const LineAt& line_at, std::vector<Cut>& cuts) {
    cuts.clear();
    int base = first;
    for (int i = first + 1; i <= last; ++i) {
        const auto line = line_at(i);
        if (line.offset >= line.reach) {  // all of it lies beyond the line, and all before that
            base = i;
            cuts.clear();
        } else if (line.offset <= -line.reach) {  // nothing reaches it, nor any after it
            break;
        } else {
            cuts.push_back(line.cut());
        }
    }
    return base;
}

struct LineOfDisk {
    double offset, reach;
    Eigen::Vector2d normal;

    DiskChord cut() const { return disk_chord(normal, offset / reach); }
};

struct LineOfSquare {
    double offset, reach;
    Eigen::Vector2d gradient;

    SquareCut cut() const { return square_cut(gradient, offset); }
};

}  // namespace

double LensAverage::at(const Eigen::Vector2d& x, const CellRange& range) {
    if (range.is_single())
        return view_.cell(range.first_column, range.first_row);
    const SensorPoint point = view_.sensor_point(x);
    const auto lines = [&](int axis) {
        return [&, axis](int i) -> LineOfDisk {
            const LensLine line = view_.lens_line(axis, i, point);
            const double slope = line.slope.norm();
            return {line.offset, view_.aperture().radius_mm * slope, line.slope / slope};
        };
    };
    const int column = cut_window(range.first_column, range.last_column, lines(0), column_chords_);
    const int row = cut_window(range.first_row, range.last_row, lines(1), row_chords_);
    return sum_of_cells(view_, column, row, column_chords_, row_chords_, disk_wedge_area);
}

namespace {

// A convex outline; two cuts add at most two corners to a square's four.
struct Outline {
    std::array<Eigen::Vector2d, 6> corners;
    int count = 0;

    void add(const Eigen::Vector2d& corner) { corners[static_cast<std::size_t>(count++)] = corner; }
    const Eigen::Vector2d& at(int i) const { return corners[static_cast<std::size_t>(i % count)]; }
};

Outline clipped(const Outline& outline, const SquareCut& cut) {
    Outline kept;
    for (int i = 0; i < outline.count; ++i) {
        const Eigen::Vector2d &from = outline.at(i), &to = outline.at(i + 1);
        const double f = cut.offset + cut.gradient.dot(from);
        const double g = cut.offset + cut.gradient.dot(to);
        if (f >= 0.0)
            kept.add(from);
        // A convex outline changes sign at most twice; rounding must not add a third crossing.
        if ((f >= 0.0) != (g >= 0.0) && kept.count < 6)
            kept.add(from + f / (f - g) * (to - from));
    }
    return kept;
}

double area(const Outline& outline) {
    double twice = 0.0;
    for (int i = 0; i < outline.count; ++i) {
        const Eigen::Vector2d &p = outline.at(i), &q = outline.at(i + 1);
        twice += p.x() * q.y() - p.y() * q.x();
    }
    return twice / 2.0;
}

// Of the part that holds the square's centre: at least one half.
double major_area(double steep, double flat, double distance) {
    if (distance >= (steep + flat) / 2.0)
        return 1.0;
    if (distance <= (steep - flat) / 2.0)  // cuts two opposite sides: a trapezium
        return 0.5 + distance / steep;
    const double leg = (steep + flat) / 2.0 - distance;  // cuts off a corner
    return 1.0 - leg * leg / (2.0 * steep * flat);
}

}  // namespace

SquareCut square_cut(const Eigen::Vector2d& gradient, double offset) {
    const double gx = std::abs(gradient.x()), gy = std::abs(gradient.y());
    const double major = major_area(std::max(gx, gy), std::min(gx, gy), std::abs(offset));
    return {gradient, offset, offset >= 0.0 ? major : 1.0 - major};
}

// major_area() solved for the distance, for the part without the square's centre.
double offset_of_area(const Eigen::Vector2d& gradient, double area) {
    const double gx = std::abs(gradient.x()), gy = std::abs(gradient.y());
    const double steep = std::max(gx, gy), flat = std::min(gx, gy);
    const double minor = std::min(area, 1.0 - area);
    const double distance = 2.0 * steep * minor >= flat
                                ? (0.5 - minor) * steep
                                : (steep + flat) / 2.0 - std::sqrt(2.0 * steep * flat * minor);
    return area >= 0.5 ? distance : -distance;
}

double square_wedge_area(const SquareCut& a, const SquareCut& b) {
    Outline square;
    for (const auto& [x, y] : {std::pair{-0.5, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}})
        square.add({x, y});
    const Outline once = clipped(square, a);
    if (once.count < 3)
        return 0.0;
    const Outline both = clipped(once, b);
    if (both.count < 3)
        return 0.0;
    const double least = std::max(0.0, a.area + b.area - 1.0);
    return std::clamp(area(both), least, std::max(least, std::min(a.area, b.area)));
}

namespace {

struct GaussRule {
    std::array<double, 4> area, weight;  // enclosed share of the disk's area; share of the weight
};

// Gauss-Legendre on [0, 1] (Abramowitz and Stegun, table 25.4), with one to four nodes.
constexpr std::array<GaussRule, 4> gauss_rules{{
    {{0.5}, {1.0}},
    {{0.2113248654051871, 0.7886751345948129}, {0.5, 0.5}},
    {{0.1127016653792583, 0.5, 0.8872983346207417},
     {0.2777777777777778, 0.4444444444444444, 0.2777777777777778}},
    {{0.0694318442029737, 0.3300094782075719, 0.6699905217924281, 0.9305681557970263},
     {0.1739274225687269, 0.3260725774312731, 0.3260725774312731, 0.1739274225687269}},
}};

}  // namespace

std::vector<LensPoint> lens_points(double radius_mm, const LensRule& rule) {
    const auto [rings, spokes] = rule;
    if (spokes == 0)
        return {{Eigen::Vector2d::Zero(), 1.0}};
    const GaussRule& gauss = gauss_rules[static_cast<std::size_t>(rings - 1)];
    std::vector<LensPoint> points;
    for (int ring = 0; ring < rings; ++ring) {
        const auto r = static_cast<std::size_t>(ring);
        const double radius = radius_mm * std::sqrt(gauss.area[r]);
        for (int spoke = 0; spoke < spokes; ++spoke) {
            const double turn = spoke + 0.25 + 0.5 * (ring % 2);
            const double angle = 2.0 * std::numbers::pi * turn / spokes;
            points.push_back(
                {{radius * std::cos(angle), radius * std::sin(angle)}, gauss.weight[r] / spokes});
        }
    }
    return points;
}

double CellCoverage::over(const Eigen::Vector2d& x, const Eigen::Matrix2d& sides,
                          const CellRange& range) {
    if (range.is_single())
        return view_.cell(range.first_column, range.first_row);
    const SensorPoint point = view_.sensor_point(x);
    double sum = 0.0;
    for (const LensPoint& p : points_) {
        const auto lines = [&](int axis) {
            return [&, axis](int i) -> LineOfSquare {
                const LensLine line = view_.lens_line(axis, i, point);
                const Eigen::Vector2d gradient =
                    sides.transpose() * view_.line_gradient(axis, i, x, p.l_mm);
                return {line.offset + line.slope.dot(p.l_mm), 0.5 * gradient.cwiseAbs().sum(),
                        gradient};
            };
        };
        const int column =
            cut_window(range.first_column, range.last_column, lines(0), column_cuts_);
        const int row = cut_window(range.first_row, range.last_row, lines(1), row_cuts_);
        sum +=
            p.weight * sum_of_cells(view_, column, row, column_cuts_, row_cuts_, square_wedge_area);
    }
    return sum;
}

}  // namespace etalon
