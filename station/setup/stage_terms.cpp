#include "station/setup/stage_terms.h"

#include "stage/axes/kinematics.h"

namespace etalon {
namespace {

constexpr double relative_size = 1e-4;  // small enough for first order, far above rounding
constexpr double lean_rad = 1e-4;
constexpr double shift_mm = 1e-2;

// The stage at each visit with one of its axes changed as it is then.
using Change = std::function<void(Axis&, const VisitedPose&)>;
std::vector<Rigid> transforms(std::span<const Axis> axes, const std::vector<VisitedPose>& poses,
                              std::size_t changed, const Change& change) {
    std::vector<Rigid> all;
    for (const VisitedPose& pose : poses) {
        std::vector<Axis> wrong(axes.begin(), axes.end());
        change(wrong[changed], pose);
        all.push_back(base_from_carriage(wrong, pose.read_back));
    }
    return all;
}

DeclaredStageTerm scale_term(std::span<const Axis> axes, std::size_t axis,
                             const std::vector<VisitedPose>& poses) {
    const auto longer = [axis](Axis& wrong, const VisitedPose& pose) {
        wrong.zero -= relative_size * (pose.read_back.at(axis) - wrong.zero);
    };
    return {.error = {"stage scale " + axes[axis].name, "1", relative_size,
                      transforms(axes, poses, axis, longer), axes[axis].kind == Axis::Kind::linear},
            .in_budget = true,
            .standard_uncertainty = axes[axis].scale_uncertainty};
}

// The second axis leans towards the first one.
DeclaredStageTerm squareness_term(std::span<const Axis> axes, std::size_t first, std::size_t second,
                                  const std::vector<VisitedPose>& poses) {
    const auto lean = [&](Axis& wrong, const VisitedPose&) {
        wrong.direction = (wrong.direction + lean_rad * axes[first].direction).normalized();
    };
    return {.error = {"stage squareness " + axes[first].name + axes[second].name, "rad", lean_rad,
                      transforms(axes, poses, second, lean)}};
}

std::array<Eigen::Vector3d, 2> ways_across(const Axis& axis) {
    const Eigen::Vector3d first = axis.direction.unitOrthogonal();
    return {first, axis.direction.cross(first)};
}

// `change` makes the axis wrong by `size` in one of the two ways across its direction.
void add_both_ways(std::vector<DeclaredStageTerm>& terms, std::span<const Axis> axes,
                   std::size_t axis, const std::vector<VisitedPose>& poses, const StageError& kind,
                   double uncertainty,
                   const std::function<void(Axis&, const Eigen::Vector3d&)>& change) {
    constexpr std::array names = {", 1st way", ", 2nd way"};
    const auto ways = ways_across(axes[axis]);
    for (std::size_t i = 0; i < 2; ++i) {
        DeclaredStageTerm& term = terms.emplace_back(DeclaredStageTerm{
            .error = kind, .in_budget = true, .standard_uncertainty = uncertainty});
        term.error.name += " " + axes[axis].name + names[i];
        term.error.base_from_carriage = transforms(
            axes, poses, axis, [&](Axis& wrong, const VisitedPose&) { change(wrong, ways[i]); });
    }
}

void add_direction_terms(std::vector<DeclaredStageTerm>& terms, std::span<const Axis> axes,
                         std::size_t axis, const std::vector<VisitedPose>& poses) {
    if (axes[axis].direction_uncertainty)
        add_both_ways(terms, axes, axis, poses, {"stage direction", "rad", lean_rad, {}},
                      *axes[axis].direction_uncertainty,
                      [](Axis& wrong, const Eigen::Vector3d& across) {
                          wrong.direction = (wrong.direction + lean_rad * across).normalized();
                      });
    if (axes[axis].point_uncertainty)
        add_both_ways(terms, axes, axis, poses, {"stage point", "mm", shift_mm, {}},
                      *axes[axis].point_uncertainty,
                      [](Axis& wrong, const Eigen::Vector3d& across) {
                          wrong.point_mm += shift_mm * across;
                      });
}

// The carriage where all that an axis carries stands aside, in the frame of its direction.
std::vector<Rigid> moved_aside(std::span<const Axis> axes, const std::vector<VisitedPose>& poses,
                               std::size_t axis, const Eigen::Vector3d& shift) {
    std::vector<Rigid> all;
    for (const VisitedPose& pose : poses) {
        const Rigid before =
            base_from_carriage(axes.first(axis), std::span(pose.read_back).first(axis));
        Rigid moved = base_from_carriage(axes, pose.read_back);
        moved.translation += before.rotation * shift;
        all.push_back(moved);
    }
    return all;
}

std::vector<double> middle(const std::vector<VisitedPose>& poses) {
    std::vector<double> low = poses.front().read_back, high = low;
    for (const VisitedPose& pose : poses)
        for (std::size_t i = 0; i < low.size(); ++i) {
            low[i] = std::min(low[i], pose.read_back[i]);
            high[i] = std::max(high[i], pose.read_back[i]);
        }
    for (std::size_t i = 0; i < low.size(); ++i)
        low[i] = (low[i] + high[i]) / 2.0;
    return low;
}

// How far the marker's centre moves when one axis is `size` further than it reads.
double marker_shift(std::span<const Axis> axes, const std::vector<double>& q, std::size_t axis,
                    double size, const Rigid& carriage_from_marker) {
    std::vector<Axis> further(axes.begin(), axes.end());
    further[axis].zero -= size;
    const Eigen::Vector3d& centre = carriage_from_marker.translation;
    return (base_from_carriage(further, q) * centre - base_from_carriage(axes, q) * centre).norm();
}

// Root mean square over the visits.
double reading_uncertainty(const std::vector<VisitedPose>& poses, std::size_t axis) {
    double sum = 0.0;
    for (const VisitedPose& pose : poses)
        sum += std::pow(pose.read_back_uncertainty.at(axis), 2);
    return std::sqrt(sum / static_cast<double>(poses.size()));
}

}  // namespace

std::vector<DeclaredStageTerm> declared_stage_terms(std::span<const Axis> axes,
                                                    const std::vector<VisitedPose>& poses) {
    std::vector<DeclaredStageTerm> terms;
    for (std::size_t i = 0; i < axes.size(); ++i)
        terms.push_back(scale_term(axes, i, poses));
    for (std::size_t i = 0; i < axes.size(); ++i)
        for (std::size_t j = i + 1; j < axes.size(); ++j)
            if (axes[i].kind == Axis::Kind::linear && axes[j].kind == Axis::Kind::linear)
                terms.push_back(squareness_term(axes, i, j, poses));
    for (std::size_t i = 0; i < axes.size(); ++i)
        add_direction_terms(terms, axes, i, poses);
    return terms;
}

std::vector<DeclaredRepeatability> declared_repeatability(std::span<const Axis> axes,
                                                          const std::vector<VisitedPose>& poses,
                                                          const Rigid& carriage_from_marker) {
    std::vector<DeclaredRepeatability> terms;
    if (poses.empty())
        return terms;
    const std::vector<double> q = middle(poses);
    for (std::size_t i = 0; i < axes.size(); ++i) {
        DeclaredRepeatability term{axes[i].name, std::nullopt};
        if (const auto approach = approach_deviation(axes[i])) {
            const double size = std::hypot(*approach, reading_uncertainty(poses, i));
            term.marker_mm = marker_shift(axes, q, i, size, carriage_from_marker);
        }
        if (axes[i].read_noise)
            term.reading_mm = marker_shift(axes, q, i, *axes[i].read_noise, carriage_from_marker);
        terms.push_back(term);
    }
    return terms;
}

std::vector<DeclaredErrorMap> declared_error_maps(std::span<const Axis> axes,
                                                  const std::vector<VisitedPose>& poses,
                                                  const Rigid& carriage_from_marker) {
    std::vector<DeclaredErrorMap> maps;
    for (std::size_t i = 0; i < axes.size() && !poses.empty(); ++i) {
        if (!axes[i].errors)
            continue;
        DeclaredErrorMap map{axes[i].name};
        for (const VisitedPose& pose : poses) {
            const double size = axes[i].errors->at(pose.read_back[i]).value().uncertainty;
            const double shift = marker_shift(axes, pose.read_back, i, size, carriage_from_marker);
            map.marker_rms_mm += shift * shift / static_cast<double>(poses.size());
            map.marker_max_mm = std::max(map.marker_max_mm, shift);
        }
        map.marker_rms_mm = std::sqrt(map.marker_rms_mm);
        maps.push_back(map);
    }
    return maps;
}

std::vector<StageAxisMotion> stage_axis_motions(std::span<const Axis> axes,
                                                const std::vector<VisitedPose>& poses) {
    constexpr double step_rad = 1e-4;
    std::vector<StageAxisMotion> motions;
    for (std::size_t k = 0; k < axes.size() && !poses.empty(); ++k) {
        const bool is_linear = axes[k].kind == Axis::Kind::linear;
        StageAxisMotion motion{axes[k].name, is_linear, is_linear ? shift_mm : step_rad};
        motion.advanced = transforms(
            axes, poses, k, [&](Axis& wrong, const VisitedPose&) { wrong.zero -= motion.step; });
        for (const VisitedPose& pose : poses) {
            motion.position.push_back(pose.read_back[k]);
            if (pose.approach.size() == axes.size())
                motion.approach.push_back(pose.approach[k]);
        }
        for (std::size_t way = 0; is_linear && way < 2; ++way)
            motion.aside[way] =
                moved_aside(axes, poses, k, motion.step * ways_across(axes[k])[way]);
        motions.push_back(std::move(motion));
    }
    return motions;
}

std::vector<Rigid> stage_reach(const std::vector<Axis>& axes,
                               std::span<const PlanRequest::Interval> intervals) {
    std::vector<double> middle;
    for (const PlanRequest::Interval& interval : intervals)
        middle.push_back(0.5 * (interval.low + interval.high));
    std::vector<Rigid> reach = {base_from_carriage(axes, middle)};
    for (std::size_t i = 0; i < intervals.size(); ++i)
        for (const double share : {0.1, 0.35, 0.6, 0.85}) {  // no two half a turn apart
            std::vector<double> there = middle;
            there[i] = intervals[i].low + share * (intervals[i].high - intervals[i].low);
            reach.push_back(base_from_carriage(axes, there));
        }
    return reach;
}

std::vector<Rigid> stage_reach(const std::vector<Axis>& axes) {
    std::vector<PlanRequest::Interval> travel;
    for (const Axis& axis : axes)
        travel.push_back({axis.low, axis.high});
    return stage_reach(axes, travel);
}

}  // namespace etalon
