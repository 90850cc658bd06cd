#include "compare/detect/board/point_lattice.h"

#include <fmt/format.h>
#include <opencv2/calib3d.hpp>

#include <Eigen/Dense>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <set>

namespace etalon {
namespace {

constexpr double max_miss = 0.25;  // of a step, from where a point is expected

bool are_alike(const DarkShape& a, const DarkShape& b) {
    const auto [less, more] = std::minmax(a.area_px2, b.area_px2);
    return less > 0.5 * more;
}

// Points by squares of the image, to find those around a place.
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
using Places = std::map<Eigen::Vector2i, std::size_t, PlaceLess>;

// One lattice being grown.
class Growth {
public:
    Growth(const std::vector<DarkShape>& points, const Neighbourhood& near,
           const std::vector<bool>& taken)
        : points_(points), near_(near), taken_(taken) {}

    // The places reached from a point; few where it has no two steps.
    Places from(std::size_t seed, bool is_narrow) {
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
    // other side; in a lattice of two rows, a narrow one, none does across them.
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
            const double cross = arms[0].x() * arms[i].y() - arms[0].y() * arms[i].x();
            if (std::abs(cross) < min_sine * arms[0].norm() * arms[i].norm())
                continue;
            Eigen::Matrix2d steps;
            steps << arms[0], cross > 0.0 ? arms[i] : Eigen::Vector2d(-arms[i]);
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

    // The steps at a place from what is known on both of its sides, or else those it was found
    // with.
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
    Places places_;
    std::set<std::size_t> used_;
    std::deque<Node> open_;
};

struct Bounds {
    Eigen::Vector2i low, high;

    explicit Bounds(const std::vector<Eigen::Vector2i>& places)
        : low(places.front()), high(places.front()) {
        for (const Eigen::Vector2i& place : places) {
            low = low.cwiseMin(place);
            high = high.cwiseMax(place);
        }
    }
};

// Changes of basis that keep the sense of turning.
const std::vector<Eigen::Matrix2i>& changes_of_basis() {
    static const std::vector<Eigen::Matrix2i> all = [] {
        constexpr int most = 2;
        std::vector<Eigen::Matrix2i> changes;
        for (int a = -most; a <= most; ++a)
            for (int b = -most; b <= most; ++b)
                for (int c = -most; c <= most; ++c)
                    for (int d = -most; d <= most; ++d)
                        if (a * d - b * c == 1)
                            changes.push_back((Eigen::Matrix2i() << a, b, c, d).finished());
        return changes;
    }();
    return all;
}

Places changed(const PointLattice& lattice, const Eigen::Matrix2i& change) {
    Places places;
    for (const LatticePoint& each : lattice)
        places[change * each.place] = each.point;
    return places;
}

std::vector<Eigen::Vector2i> keys_of(const Places& places) {
    std::vector<Eigen::Vector2i> keys;
    for (const auto& [place, point] : places)
        keys.push_back(place);
    return keys;
}

BoardInLattice laid(const std::vector<Eigen::Vector2i>& board, const Places& places,
                    const Eigen::Vector2i& shift) {
    BoardInLattice way;
    for (const Eigen::Vector2i& place : board) {
        const auto found = places.find(place + shift);
        way.push_back(found == places.end() ? std::nullopt : std::optional(found->second));
    }
    return way;
}

std::size_t count_of(const BoardInLattice& way) {
    return static_cast<std::size_t>(
        std::ranges::count_if(way, [](const auto& point) { return point.has_value(); }));
}

struct LaidBoard {
    BoardInLattice way;
    std::set<Eigen::Vector2i, PlaceLess> covered;  // places of the lattice, seen or not
};

std::set<Eigen::Vector2i, PlaceLess> covered_by(const std::vector<Eigen::Vector2i>& board,
                                                const Eigen::Vector2i& shift,
                                                const Eigen::Matrix2i& change) {
    Eigen::Matrix2i back;  // the determinant is 1
    back << change(1, 1), -change(0, 1), -change(1, 0), change(0, 0);
    std::set<Eigen::Vector2i, PlaceLess> covered;
    for (const Eigen::Vector2i& place : board)
        covered.insert(back * (place + shift));
    return covered;
}

// All shifts of the board over the lattice under all changes of basis, those with the most points.
std::vector<LaidBoard> best_ways(const PointLattice& lattice,
                                 const std::vector<Eigen::Vector2i>& board, std::size_t at_least) {
    const Bounds of_board(board);
    std::vector<LaidBoard> best;
    std::size_t most = at_least;
    for (const Eigen::Matrix2i& change : changes_of_basis()) {
        const Places places = changed(lattice, change);
        const Bounds of_lattice(keys_of(places));
        const Eigen::Vector2i
            from = (of_lattice.low - of_board.low).cwiseMin(of_lattice.high - of_board.high),
            to = (of_lattice.low - of_board.low).cwiseMax(of_lattice.high - of_board.high);
        for (int x = from.x(); x <= to.x(); ++x)
            for (int y = from.y(); y <= to.y(); ++y) {
                BoardInLattice way = laid(board, places, {x, y});
                const std::size_t count = count_of(way);
                if (count < most)
                    continue;
                if (count > most)
                    best.clear();
                most = count;
                best.push_back({std::move(way), covered_by(board, {x, y}, change)});
            }
    }
    return best;
}

FoundShapes first_half_at_upper_left(const std::vector<DarkShape>& shapes,
                                     const std::vector<BoardInLattice>& ways) {
    // Of the whole first half: its first place may be hidden.
    const auto place_of_first_half = [&](const BoardInLattice& way) {
        Eigen::Vector2d sum(0.0, 0.0);
        double seen = 0.0;
        for (std::size_t i = 0; i < way.size() / 2; ++i)
            if (way[i]) {
                sum += shapes[*way[i]].centre;
                seen += 1.0;
            }
        return sum.sum() / seen;
    };
    FoundShapes found;
    for (const auto& point : *std::ranges::min_element(ways, {}, place_of_first_half))
        found.shapes.push_back(point ? std::optional(shapes[*point]) : std::nullopt);
    return found;
}

}  // namespace

std::vector<PointLattice> find_lattices(const std::vector<DarkShape>& points,
                                        std::size_t min_points) {
    const Neighbourhood near(points);
    std::vector<bool> taken(points.size(), false);
    std::vector<PointLattice> lattices;
    for (const bool is_narrow : {false, true})
        for (std::size_t seed = 0; seed < points.size(); ++seed) {
            if (taken[seed])
                continue;
            const Places places = Growth(points, near, taken).from(seed, is_narrow);
            if (places.size() < min_points)
                continue;
            PointLattice lattice;
            for (const auto& [place, point] : places) {
                lattice.push_back({place, point});
                taken[point] = true;
            }
            lattices.push_back(std::move(lattice));
        }
    std::ranges::stable_sort(lattices, std::greater(), &PointLattice::size);
    return lattices;
}

BoardMatch match_board(const PointLattice& lattice, const std::vector<Eigen::Vector2i>& board) {
    const std::size_t enough = (3 * board.size() + 3) / 4;
    const std::vector<LaidBoard> laid_boards = best_ways(lattice, board, enough);
    if (laid_boards.empty())
        return {{},
                fmt::format("{} points of a grid are seen, which are not the board's {}",
                            lattice.size(), board.size())};
    const bool is_one_place = std::ranges::all_of(laid_boards, [&](const LaidBoard& each) {
        return each.covered == laid_boards.front().covered;
    });
    if (!is_one_place)
        return {{},
                fmt::format("{} points of a grid are seen, in which a board of {} has several "
                            "places",
                            lattice.size(), board.size())};
    BoardMatch match;
    for (const LaidBoard& each : laid_boards)
        match.ways.push_back(each.way);
    return match;
}

FoundShapes find_board_of(FindShapes find, const cv::Mat& image,
                          const std::vector<Eigen::Vector2i>& board) {
    std::string reason = "no grid is seen";
    for (const ShapeScale& scale : shape_scales(image.size())) {
        const std::vector<DarkShape> shapes = find(image, scale);
        for (const PointLattice& lattice : find_lattices(shapes, board.size() / 3)) {
            const BoardMatch match = match_board(lattice, board);
            if (!match.ways.empty())
                return first_half_at_upper_left(shapes, match.ways);
            reason = match.reason;
        }
    }
    return {{}, reason};
}

std::optional<SeenPlane> SeenPlane::through(const std::vector<Eigen::Vector2d>& mm,
                                            const std::vector<Eigen::Vector2d>& pixels) {
    std::vector<cv::Point2d> from, to;
    for (std::size_t i = 0; i < mm.size(); ++i) {
        from.emplace_back(mm[i].x(), mm[i].y());
        to.emplace_back(pixels[i].x(), pixels[i].y());
    }
    const cv::Mat h = from.size() < 4 ? cv::Mat() : cv::findHomography(from, to, 0);
    if (h.empty())
        return std::nullopt;
    SeenPlane view;
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column)
            view.pixel_from_mm(row, column) = h.at<double>(row, column);
    return view;
}

Eigen::Vector2d SeenPlane::at(const Eigen::Vector2d& mm) const {
    return (pixel_from_mm * mm.homogeneous()).hnormalized();
}

Eigen::Matrix2d SeenPlane::px_per_mm(const Eigen::Vector2d& mm) const {
    const Eigen::Vector3d there = pixel_from_mm * mm.homogeneous();
    return (pixel_from_mm.topLeftCorner<2, 2>() -
            there.hnormalized() * pixel_from_mm.bottomLeftCorner<1, 2>()) /
           there.z();
}

}  // namespace etalon
