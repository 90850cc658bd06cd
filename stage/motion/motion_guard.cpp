#include "stage/motion/motion_guard.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace etalon {
namespace {

using Positions = std::vector<double>;

constexpr double turn = 2.0 * std::numbers::pi;
constexpr double seconds_per_stop = 0.2;   // what coming to rest between two motions costs
constexpr std::size_t max_split_axes = 8;  // 3^8 motions are looked at

bool is_rotary(const Axis& axis) {
    return axis.kind == Axis::Kind::rotary;
}

double clearance(const Axis& axis) {
    return is_rotary(axis) ? clearance_deg * rad_per_deg : clearance_mm;
}

// Whether [low, high] reaches into the side, which a rotary axis meets again at every turn.
bool reaches_into(const Axis& axis, double low, double high, const AxisInterval& side,
                  double margin) {
    const double from = side.low - margin, to = side.high + margin;
    if (!is_rotary(axis) || !std::isfinite(from) || !std::isfinite(to))
        return low < to && high > from;
    return std::floor((low - to) / turn) + 1.0 < (high - from) / turn;
}

// ---- What a motion meets

class Space {
public:
    Space(std::span<const Axis> axes, const MotionRules& rules) : axes_(axes), rules_(rules) {}

    std::span<const Axis> axes() const { return axes_; }
    const std::vector<ForbiddenBox>& boxes() const { return rules_.forbidden; }

    // Whether the box that the two points span comes nearer to a forbidden one than `margin`, a
    // function of the axis' number.
    template <class Margin>
    bool meets(const ForbiddenBox& box, std::span<const double> a, std::span<const double> b,
               Margin margin) const {
        for (std::size_t i = 0; i < axes_.size(); ++i)
            if (!reaches_into(axes_[i], std::min(a[i], b[i]), std::max(a[i], b[i]), box.sides[i],
                              margin(i)))
                return false;
        return true;
    }

    // The first box that is in the way, with `share` of the clearance; null: none.
    const ForbiddenBox* obstacle(std::span<const double> a, std::span<const double> b,
                                 double share) const {
        const auto margin = [&](std::size_t i) { return share * clearance(axes_[i]); };
        for (const ForbiddenBox& box : rules_.forbidden)
            if (meets(box, a, b, margin))
                return &box;
        return nullptr;
    }
    bool is_free(const Positions& a, const Positions& b) const {
        return obstacle(a, b, 0.5) == nullptr;
    }

    MotionSegment segment(const Positions& from, const Positions& to) const {
        MotionSegment segment{from, to};
        if (!rules_.slow_margin.empty())
            for (const ForbiddenBox& box : rules_.forbidden)
                if (meets(box, from, to, [&](std::size_t i) { return rules_.slow_margin[i]; }))
                    segment.near.push_back(box.name);
        if (!segment.near.empty())
            segment.speed_share = rules_.slow_share;
        double longest_s = 0.0;
        for (std::size_t i = 0; i < axes_.size(); ++i)
            longest_s = std::max(longest_s, std::abs(to[i] - from[i]) / axes_[i].speed);
        segment.time = duration_of(longest_s / segment.speed_share);
        return segment;
    }

private:
    std::span<const Axis> axes_;
    const MotionRules& rules_;
};

using Path = std::vector<MotionSegment>;

double seconds(const Path& path) {
    double sum = 0.0;
    for (const MotionSegment& segment : path)
        sum += std::chrono::duration<double>(segment.time).count() + seconds_per_stop;
    return sum;
}

// ---- Some axes after others

// The quickest way on which every axis moves once, straight from start to end, alone or together
// with others: a shortest path over the sets of axes that have already moved.
class OrderSearch {
public:
    OrderSearch(const Space& space, const Positions& from, const Positions& to)
        : space_(space), from_(from), to_(to) {
        for (std::size_t i = 0; i < from.size(); ++i)
            if (from[i] != to[i])
                moving_.push_back(i);
    }

    std::optional<Path> path() {
        if (moving_.size() > max_split_axes)
            return space_.is_free(from_, to_) ? std::optional(Path{space_.segment(from_, to_)})
                                              : std::nullopt;
        const std::size_t all = (std::size_t{1} << moving_.size()) - 1;
        best_.assign(all + 1, {});
        best_[0] = {0.0, 0};
        for (std::size_t moved = 0; moved < all; ++moved)
            if (best_[moved].seconds < std::numeric_limits<double>::infinity())
                extend(moved, all & ~moved);
        return walk_back(all);
    }

private:
    struct Step {
        double seconds = std::numeric_limits<double>::infinity();
        std::size_t before = 0;
    };

    Positions position(std::size_t moved) const {
        Positions q = from_;
        for (std::size_t bit = 0; bit < moving_.size(); ++bit)
            if (moved >> bit & 1)
                q[moving_[bit]] = to_[moving_[bit]];
        return q;
    }

    // Moves every group of the axes that are left. (Larger groups come first and win ties.)
    void extend(std::size_t moved, std::size_t left) {
        const Positions here = position(moved);
        for (std::size_t group = left; group != 0; group = (group - 1) & left) {
            const Positions there = position(moved | group);
            if (!space_.is_free(here, there))
                continue;
            const double total = best_[moved].seconds + seconds({space_.segment(here, there)});
            if (total < best_[moved | group].seconds)
                best_[moved | group] = {total, moved};
        }
    }

    std::optional<Path> walk_back(std::size_t all) const {
        if (!std::isfinite(best_[all].seconds))
            return std::nullopt;
        Path path;
        for (std::size_t at = all; at != 0; at = best_[at].before)
            path.insert(path.begin(), space_.segment(position(best_[at].before), position(at)));
        return path;
    }

    const Space& space_;
    const Positions& from_;
    const Positions& to_;
    std::vector<std::size_t> moving_;
    std::vector<Step> best_;
};

// ---- Drawing back

// Where an axis is just clear of a forbidden box, inside its soft limits; rotary: the nearest turn.
Positions clear_positions(const Axis& axis, const std::vector<AxisInterval>& sides, double near) {
    Positions clear;
    for (const AxisInterval& side : sides)
        for (double edge : {side.low - clearance(axis), side.high + clearance(axis)}) {
            if (is_rotary(axis) && std::isfinite(edge))
                edge += turn * std::round((near - edge) / turn);
            if (edge >= axis.low && edge <= axis.high)
                clear.push_back(edge);
        }
    return clear;
}

std::optional<Path> by_way_of(const Space& space, const Positions& from, const Positions& to,
                              std::size_t axis, double clear) {
    Positions back = from, before = to;
    back[axis] = before[axis] = clear;
    if (!space.is_free(from, back) || !space.is_free(before, to))
        return std::nullopt;
    auto middle = OrderSearch(space, back, before).path();
    if (!middle)
        return std::nullopt;
    Path path = std::move(*middle);
    if (back != from)
        path.insert(path.begin(), space.segment(from, back));
    if (before != to)
        path.push_back(space.segment(before, to));
    return path;
}

std::optional<Path> drawing_back(const Space& space, const Positions& from, const Positions& to) {
    std::optional<Path> best;
    for (std::size_t i = 0; i < from.size(); ++i) {
        std::vector<AxisInterval> sides;
        for (const ForbiddenBox& box : space.boxes())
            sides.push_back(box.sides[i]);
        for (const double clear : clear_positions(space.axes()[i], sides, from[i])) {
            auto path = by_way_of(space, from, to, i, clear);
            if (path && (!best || seconds(*path) < seconds(*best)))
                best = std::move(path);
        }
    }
    return best;
}

// ---- Approaching from one side

bool ends_as_declared(std::span<const Axis> axes, const Path& path) {
    for (std::size_t i = 0; i < axes.size(); ++i) {
        double last = 0.0;
        for (const MotionSegment& segment : path)
            if (segment.to[i] != segment.from[i])
                last = segment.to[i] - segment.from[i];
        if (axes[i].approach != 0 && axes[i].approach * last < axes[i].overrun)
            return false;
    }
    return true;
}

Positions before_approach(std::span<const Axis> axes, Positions target) {
    for (std::size_t i = 0; i < axes.size(); ++i)
        target[i] -= axes[i].approach * axes[i].overrun;
    return target;
}

// ---- Words

std::string describe(std::span<const Axis> axes, std::span<const double> positions) {
    std::string text;
    for (std::size_t i = 0; i < axes.size(); ++i)
        text += fmt::format("{}{} {}", i == 0 ? "" : ", ", axes[i].name,
                            as_typed(axes[i], positions[i]));
    return text;
}

// ---- The parts of a plan

void require_outside(const Space& space, const Positions& start, const SourcePlace& place) {
    if (start.size() != space.axes().size() ||
        !std::ranges::all_of(start, [](double q) { return std::isfinite(q); }))
        throw ConfigError(place, "where the axes are is not known");
    if (const ForbiddenBox* box = space.obstacle(start, start, 0.5))
        throw ConfigError(place, fmt::format("the axes stand in the forbidden box '{}' ({}): bring "
                                             "them out with the controller's own means",
                                             box->name, describe(space.axes(), start)));
}

Path route(const Space& space, const Positions& from, const Positions& to,
           const SourcePlace& place) {
    auto path = OrderSearch(space, from, to).path();
    if (!path)
        path = drawing_back(space, from, to);
    if (!path)
        throw ConfigError(place,
                          fmt::format("no way was found from {} to {} past the forbidden "
                                      "box '{}'",
                                      describe(space.axes(), from), describe(space.axes(), to),
                                      space.obstacle(from, to, 0.5)->name));
    return *path;
}

void require_approach(const Space& space, const MotionRules& rules, const Positions& before,
                      const Positions& end, const SourcePlace& place) {
    SourcePlace overrun = place;
    overrun.key += " (overrun before the approach)";
    require_allowed(space.axes(), rules, before, overrun);
    if (const ForbiddenBox* box = space.obstacle(before, end, 0.5))
        throw ConfigError(overrun, fmt::format("the way from {} to {} meets the forbidden box '{}'",
                                               describe(space.axes(), before),
                                               describe(space.axes(), end), box->name));
}

// ---- Reading

ForbiddenBox read_box(const Value& value, std::span<const Axis> axes) {
    ForbiddenBox box{value.at("name").text(), {}};
    bool bounded = false;
    for (const Axis& axis : axes) {
        const auto side = value.with_names().find(axis.name);
        const auto ends = side ? std::optional(AxisUnits(axis.kind).interval(*side)) : std::nullopt;
        box.sides.push_back(ends ? AxisInterval{ends->front(), ends->back()} : AxisInterval{});
        bounded = bounded || side.has_value();
    }
    if (!bounded)
        value.fail("names no axis, and would forbid everything");
    return box;
}

void read_slow_zone(const Value& value, std::span<const Axis> axes, MotionRules& rules) {
    const Value margin = value.at("margin").with_names();
    for (const Axis& axis : axes) {
        const auto distance = margin.find(axis.name);
        const AxisUnits units(axis.kind);
        rules.slow_margin.push_back(
            distance ? distance->number(units.large().non_negative()) * units.per_large() : 0.0);
    }
    rules.slow_share = value.at("speed_share").number({1e-3, 1.0});
    if (rules.forbidden.empty())
        value.fail("there is no forbidden box to be near to");
}

}  // namespace

MotionRules read_motion_rules(const Value& stage, std::span<const Axis> axes) {
    MotionRules rules;
    if (const auto forbidden = stage.find("forbidden"))
        for (const Value& box : forbidden->items())
            rules.forbidden.push_back(read_box(box, axes));
    if (const auto slow = stage.find("slow_near"))
        read_slow_zone(*slow, axes, rules);
    return rules;
}

bool is_clear(std::span<const Axis> axes, const MotionRules& rules,
              std::span<const double> target) {
    const Space space(axes, rules);
    const Positions end(target.begin(), target.end()), before = before_approach(axes, end);
    return !space.obstacle(end, end, 1.0) && !space.obstacle(before, before, 1.0) &&
           space.is_free(before, end);
}

void require_allowed(std::span<const Axis> axes, const MotionRules& rules,
                     std::span<const double> target, const SourcePlace& place) {
    require_within_limits(axes, target, place);
    if (const ForbiddenBox* box = Space(axes, rules).obstacle(target, target, 1.0))
        throw ConfigError(place, fmt::format("{} is in the forbidden box '{}' or too near to it",
                                             describe(axes, target), box->name));
}

std::vector<MotionSegment> plan_motion(std::span<const Axis> axes, const MotionRules& rules,
                                       std::span<const double> from, std::span<const double> target,
                                       const SourcePlace& place) {
    require_allowed(axes, rules, target, place);
    const Space space(axes, rules);
    const Positions start(from.begin(), from.end()), end(target.begin(), target.end());
    require_outside(space, start, place);
    Path path = route(space, start, end, place);
    if (!ends_as_declared(axes, path)) {
        const Positions before = before_approach(axes, end);
        require_approach(space, rules, before, end, place);
        path = route(space, start, before, place);
        path.push_back(space.segment(before, end));
    }
    if (path.empty())
        path.push_back(space.segment(start, end));
    return path;
}

}  // namespace etalon
