#include "compare/detect/board/shape_grid.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <set>

#include "compare/detect/detector_adaptors.h"

namespace etalon {
namespace {

using Outline = std::vector<cv::Point>;

// Of an ellipse with these second moments every point of the outline is 2 standard deviations away.
bool is_ellipse(const Outline& outline, const Eigen::Vector2d& centre,
                const Eigen::Matrix2d& spread, double short_half_axis) {
    constexpr double shape = 0.11, steps_px = 0.6;  // a square's corners are 0.22 away
    const double allowed = shape + steps_px / short_half_axis;
    const Eigen::Matrix2d inverse = spread.inverse();
    return std::ranges::all_of(outline, [&](const cv::Point& point) {
        const Eigen::Vector2d arm = Eigen::Vector2d(point.x, point.y) - centre;
        return std::abs(0.5 * std::sqrt(arm.dot(inverse * arm)) - 1.0) < allowed;
    });
}

// Outlines run through the centres of border pixels: 0.5 px inside the true one.
std::optional<DarkShape> ellipse_of(const Outline& outline) {
    constexpr double min_area_px2 = 8.0, max_axes_ratio = 6.0;
    const cv::Moments moments = cv::moments(outline);
    if (!(moments.m00 >= min_area_px2))
        return std::nullopt;
    const Eigen::Vector2d centre(moments.m10 / moments.m00, moments.m01 / moments.m00);
    Eigen::Matrix2d spread;  // second moments of the area within, over the area
    spread << moments.mu20, moments.mu11, moments.mu11, moments.mu02;
    spread /= moments.m00;
    const double mean = 0.5 * spread.trace(),
                 apart = std::sqrt(std::max(0.0, mean * mean - spread.determinant()));
    const double longer = 2.0 * std::sqrt(mean + apart),
                 shorter = 2.0 * std::sqrt(std::max(0.0, mean - apart));
    if (!(longer < max_axes_ratio * shorter) || !is_ellipse(outline, centre, spread, shorter))
        return std::nullopt;
    return DarkShape{centre, std::numbers::pi * (longer + 0.5) * (shorter + 0.5)};
}

// Clockwise as seen, the image's y down; where the diagonals cross is the image of the middle.
std::optional<DarkShape> square_of(const Outline& outline) {
    constexpr double min_area_px2 = 40.0, bend = 0.03;  // of the outline's length
    Outline corners;
    cv::approxPolyDP(outline, corners, bend * cv::arcLength(outline, true), true);
    if (corners.size() != 4 || !cv::isContourConvex(corners))
        return std::nullopt;
    const double area = cv::contourArea(corners, /*oriented=*/true);
    if (!(std::abs(area) >= min_area_px2))
        return std::nullopt;
    if (area < 0.0)
        std::ranges::reverse(corners);
    DarkShape square;
    square.area_px2 = std::abs(area);
    for (const cv::Point& corner : corners)
        square.corners.emplace_back(corner.x, corner.y);
    const Eigen::Vector2d one = square.corners[2] - square.corners[0],
                          other = square.corners[3] - square.corners[1],
                          apart = square.corners[1] - square.corners[0];
    square.centre = square.corners[0] + cross(apart, other) / cross(one, other) * one;
    return square;
}

// Pixels of the halved image in those of the whole one.
Eigen::Vector2d in_whole(const Eigen::Vector2d& pixel, double factor) {
    return (factor * (pixel.array() + 0.5) - 0.5).matrix();
}

// In the image halved so often, by the mean in a window of so many px a side.
std::vector<DarkShape> find_shapes(ShapeKind kind, const cv::Mat& image, int halvings, int window) {
    constexpr double darker_by = 6.0;  // of 255: less is noise
    cv::Mat halved = image;
    for (int i = 0; i < halvings; ++i)
        cv::resize(halved, halved, {}, 0.5, 0.5, cv::INTER_AREA);
    cv::Mat dark;
    cv::adaptiveThreshold(halved, dark, 255, cv::ADAPTIVE_THRESH_MEAN_C, cv::THRESH_BINARY_INV,
                          window, darker_by);
    std::vector<Outline> outlines;
    std::vector<cv::Vec4i> relatives;  // the last is the outline that this one is a hole in
    cv::findContours(dark, outlines, relatives, cv::RETR_CCOMP, cv::CHAIN_APPROX_NONE);
    const double factor = 1 << halvings;
    std::vector<DarkShape> found;
    for (std::size_t i = 0; i < outlines.size(); ++i) {
        if (relatives[i][3] >= 0)
            continue;
        auto shape = kind == ShapeKind::ellipse ? ellipse_of(outlines[i]) : square_of(outlines[i]);
        if (!shape)
            continue;
        shape->centre = in_whole(shape->centre, factor);
        shape->area_px2 *= factor * factor;
        for (Eigen::Vector2d& corner : shape->corners)
            corner = in_whole(corner, factor);
        found.push_back(std::move(*shape));
    }
    return found;
}

constexpr double max_miss = 0.25;  // of a step, from where a point is expected

bool are_alike(const DarkShape& a, const DarkShape& b) {
    const auto [less, more] = std::minmax(a.area_px2, b.area_px2);
    return less > 0.5 * more;
}

// Shapes by squares of the image, to find those around a place.
class Neighbourhood {
public:
    explicit Neighbourhood(const std::vector<DarkShape>& points) : points_(points) {
        for (std::size_t i = 0; i < points.size(); ++i)
            squares_[square_of(points[i].centre)].push_back(i);
    }

    // Calls `use(index)` for all points within `radius` px.
    template <class Use>
    void around(const Eigen::Vector2d& place, double radius, Use use) const {
        const auto [x0, y0] = square_of(place.array() - radius);
        const auto [x1, y1] = square_of(place.array() + radius);
        for (int x = x0; x <= x1; ++x)
            for (int y = y0; y <= y1; ++y)
                if (const auto square = squares_.find({x, y}); square != squares_.end())
                    for (const std::size_t i : square->second)
                        if ((points_[i].centre - place).norm() <= radius)
                            use(i);
    }

private:
    static constexpr double side_px = 32.0;

    static std::pair<int, int> square_of(const Eigen::Vector2d& place) {
        return {static_cast<int>(std::floor(place.x() / side_px)),
                static_cast<int>(std::floor(place.y() / side_px))};
    }

    const std::vector<DarkShape>& points_;
    std::map<std::pair<int, int>, std::vector<std::size_t>> squares_;
};

struct PlaceLess {
    bool operator()(const Eigen::Vector2i& a, const Eigen::Vector2i& b) const {
        return std::pair(a.x(), a.y()) < std::pair(b.x(), b.y());
    }
};
// Shapes by their place in steps; the second step is clockwise of the first as seen.
using Lattice = std::map<Eigen::Vector2i, std::size_t, PlaceLess>;

class Growth {
public:
    Growth(const std::vector<DarkShape>& points, const Neighbourhood& near,
           const std::vector<bool>& taken)
        : points_(points), near_(near), taken_(taken) {}

    // The places reached from a point; few where it has no two steps.
    Lattice from(std::size_t seed, bool is_narrow) {
        const auto steps = first_steps(seed, is_narrow);
        if (!steps)
            return {};
        place(seed, {0, 0}, *steps);
        while (!open_.empty()) {
            const Node node = open_.front();
            open_.pop_front();
            spread(node);
        }
        return std::move(places_);
    }

private:
    struct Node {
        Eigen::Vector2i place;
        Eigen::Matrix2d steps;  // columns: px a step
    };

    // Of alike points around, the nearest and the next in another direction that both go on on the
    // other side; in a narrow lattice, of two rows, none does across them.
    std::optional<Eigen::Matrix2d> first_steps(std::size_t seed, bool is_narrow) const {
        constexpr double reach = 6.0;  // in square roots of the area: 3.4 diameters
        const DarkShape& here = points_[seed];
        std::vector<Eigen::Vector2d> arms;
        near_.around(here.centre, reach * std::sqrt(here.area_px2), [&](std::size_t i) {
            if (i != seed && !taken_[i] && are_alike(here, points_[i]))
                arms.push_back(points_[i].centre - here.centre);
        });
        std::ranges::sort(arms, {}, [](const Eigen::Vector2d& arm) { return arm.norm(); });
        const auto goes_on = [&](const Eigen::Vector2d& arm) {
            return std::ranges::any_of(arms, [&](const Eigen::Vector2d& other) {
                return (arm + other).norm() < max_miss * arm.norm();
            });
        };
        std::vector<Eigen::Vector2d> both_ways;
        std::ranges::copy_if(arms, std::back_inserter(both_ways), goes_on);
        if (!is_narrow || both_ways.empty())
            return steps_along(both_ways);
        arms.insert(arms.begin(), both_ways.front());
        return steps_along(arms);
    }

    static std::optional<Eigen::Matrix2d> steps_along(const std::vector<Eigen::Vector2d>& arms) {
        constexpr double min_sine = 0.3;
        for (std::size_t i = 1; i < arms.size(); ++i) {
            const double turn = cross(arms[0], arms[i]);
            if (std::abs(turn) < min_sine * arms[0].norm() * arms[i].norm())
                continue;
            Eigen::Matrix2d steps;
            steps << arms[0], turn > 0.0 ? arms[i] : Eigen::Vector2d(-arms[i]);
            return steps;
        }
        return std::nullopt;
    }

    void place(std::size_t point, const Eigen::Vector2i& at, const Eigen::Matrix2d& steps) {
        places_[at] = point;
        used_.insert(point);
        open_.push_back({at, steps});
    }

    const Eigen::Vector2d* seen_at(const Eigen::Vector2i& at) const {
        const auto found = places_.find(at);
        return found == places_.end() ? nullptr : &points_[found->second].centre;
    }

    // From what is known on both sides of a place, or else the steps it was found with.
    Eigen::Matrix2d steps_at(const Node& node) const {
        Eigen::Matrix2d steps = node.steps;
        const Eigen::Vector2d here = *seen_at(node.place);
        for (int axis = 0; axis < 2; ++axis) {
            const Eigen::Vector2i one = Eigen::Vector2i::Unit(axis);
            const Eigen::Vector2d *before = seen_at(node.place - one),
                                  *after = seen_at(node.place + one);
            if (before && after)
                steps.col(axis) = 0.5 * (*after - *before);
            else if (before || after)
                steps.col(axis) = before ? here - *before : *after - here;
        }
        return steps;
    }

    void spread(const Node& node) {
        const Eigen::Matrix2d steps = steps_at(node);
        if (!(std::abs(steps.determinant()) > 1.0))
            return;
        const Eigen::Vector2d here = *seen_at(node.place);
        for (const Eigen::Vector2i& way : {Eigen::Vector2i(1, 0), Eigen::Vector2i(0, 1),
                                           Eigen::Vector2i(-1, 0), Eigen::Vector2i(0, -1)}) {
            const Eigen::Vector2i there = node.place + way;
            if (places_.contains(there))
                continue;
            if (const auto point = nearest(here + steps * way.cast<double>(), steps, node.place))
                place(*point, there, steps);
        }
    }

    // The free point nearest to where one is expected, in steps.
    std::optional<std::size_t> nearest(const Eigen::Vector2d& expected,
                                       const Eigen::Matrix2d& steps,
                                       const Eigen::Vector2i& from) const {
        const DarkShape& known = points_[places_.at(from)];
        const Eigen::Matrix2d inverse = steps.inverse();
        double smallest = max_miss;
        std::optional<std::size_t> best;
        near_.around(expected, max_miss * steps.norm(), [&](std::size_t i) {
            const double miss = (inverse * (points_[i].centre - expected)).norm();
            if (miss < smallest && !taken_[i] && !used_.contains(i) &&
                are_alike(known, points_[i])) {
                smallest = miss;
                best = i;
            }
        });
        return best;
    }

    const std::vector<DarkShape>& points_;
    const Neighbourhood& near_;
    const std::vector<bool>& taken_;
    Lattice places_;
    std::set<std::size_t> used_;
    std::deque<Node> open_;
};

Eigen::AlignedBox2i bounds(const std::vector<Eigen::Vector2i>& places) {
    Eigen::AlignedBox2i box;
    for (const Eigen::Vector2i& place : places)
        box.extend(place);
    return box;
}

// Changes of basis that keep the sense of turning.
std::vector<Eigen::Matrix2i> changes_of_basis() {
    constexpr int most = 2;
    std::vector<Eigen::Matrix2i> changes;
    for (int a = -most; a <= most; ++a)
        for (int b = -most; b <= most; ++b)
            for (int c = -most; c <= most; ++c)
                for (int d = -most; d <= most; ++d)
                    if (a * d - b * c == 1)
                        changes.push_back((Eigen::Matrix2i() << a, b, c, d).finished());
    return changes;
}

// The largest lattices first, each of at least `least` shapes, every shape in one at most.
std::vector<Lattice> find_lattices(const std::vector<DarkShape>& shapes, std::size_t least) {
    const Neighbourhood near(shapes);
    std::vector<bool> taken(shapes.size(), false);
    std::vector<Lattice> lattices;
    for (const bool is_narrow : {false, true})
        for (std::size_t seed = 0; seed < shapes.size(); ++seed) {
            if (taken[seed])
                continue;
            Lattice lattice = Growth(shapes, near, taken).from(seed, is_narrow);
            if (lattice.size() < least)
                continue;
            for (const auto& [place, shape] : lattice)
                taken[shape] = true;
            lattices.push_back(std::move(lattice));
        }
    std::ranges::stable_sort(lattices, std::greater(), &Lattice::size);
    return lattices;
}

// The places that a board covers in a lattice, in its order, and the shapes seen there.
struct LaidBoard {
    std::vector<Eigen::Vector2i> covered;
    std::vector<std::optional<std::size_t>> shapes;
    std::size_t seen = 0;
};

// All shifts of the board under all changes of basis that see the most shapes, `least` or more.
std::vector<LaidBoard> best_ways(const Lattice& lattice, const std::vector<Eigen::Vector2i>& board,
                                 std::size_t least) {
    const Eigen::AlignedBox2i own = bounds(board);
    std::vector<LaidBoard> best;
    for (const Eigen::Matrix2i& change : changes_of_basis()) {
        std::vector<Eigen::Vector2i> changed;
        for (const auto& [place, shape] : lattice)
            changed.push_back(change * place);
        const Eigen::AlignedBox2i box = bounds(changed);
        const Eigen::Vector2i low = box.min() - own.min(), high = box.max() - own.max();
        const Eigen::Vector2i from = low.cwiseMin(high), to = low.cwiseMax(high);
        Eigen::Matrix2i back;  // the determinant is 1
        back << change(1, 1), -change(0, 1), -change(1, 0), change(0, 0);
        for (int x = from.x(); x <= to.x(); ++x)
            for (int y = from.y(); y <= to.y(); ++y) {
                LaidBoard way;
                for (const Eigen::Vector2i& place : board) {
                    way.covered.push_back(back * (place + Eigen::Vector2i(x, y)));
                    const auto found = lattice.find(way.covered.back());
                    const bool is_seen = found != lattice.end();
                    way.seen += is_seen;
                    way.shapes.push_back(is_seen ? std::optional(found->second) : std::nullopt);
                }
                if (way.seen < (best.empty() ? least : best[0].seen))
                    continue;
                if (!best.empty() && way.seen > best[0].seen)
                    best.clear();
                best.push_back(std::move(way));
            }
    }
    return best;
}

// Of all ways in which the board covers the same places, that with its first half at the upper
// left.
FoundShapes first_half_at_upper_left(const std::vector<DarkShape>& shapes,
                                     const std::vector<LaidBoard>& ways) {
    const auto place_of_first_half = [&](const LaidBoard& way) {
        Eigen::Vector2d sum(0.0, 0.0);
        double seen = 0.0;
        for (std::size_t i = 0; i < way.shapes.size() / 2; ++i)
            if (way.shapes[i]) {
                sum += shapes[*way.shapes[i]].centre;
                seen += 1.0;
            }
        return sum.sum() / seen;
    };
    FoundShapes found;
    for (const auto& shape : std::ranges::min_element(ways, {}, place_of_first_half)->shapes)
        found.shapes.push_back(shape ? std::optional(shapes[*shape]) : std::nullopt);
    return found;
}

}  // namespace

FoundShapes find_shape_grid(ShapeKind kind, const cv::Mat& image,
                            const std::vector<Eigen::Vector2i>& board) {
    constexpr int min_side_px = 100, narrow_window = 15, wide_window = 45;
    FoundShapes none{{}, "no grid is seen"};
    int coarsest = 0;
    while (std::min(image.cols, image.rows) >> (coarsest + 1) >= min_side_px)
        ++coarsest;
    for (int halvings = coarsest; halvings >= 0; --halvings)  // the finest sees dots of 5 px
        for (const int window : {wide_window, narrow_window}) {
            const std::vector<DarkShape> shapes = find_shapes(kind, image, halvings, window);
            for (const Lattice& lattice : find_lattices(shapes, board.size() / 3)) {
                const std::vector<LaidBoard> ways =
                    best_ways(lattice, board, (3 * board.size() + 3) / 4);
                const bool is_one_place = std::ranges::all_of(ways, [&](const LaidBoard& way) {
                    return std::ranges::is_permutation(way.covered, ways[0].covered);
                });
                if (!ways.empty() && is_one_place)
                    return first_half_at_upper_left(shapes, ways);
                none.reason =
                    fmt::format("{} points of a grid are seen, {} {}{}", lattice.size(),
                                ways.empty() ? "which are not the board's" : "in which a board of",
                                board.size(), ways.empty() ? "" : " has several places");
            }
        }
    return none;
}

}  // namespace etalon
