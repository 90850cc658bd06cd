#include "station/setup/plan.h"

#include <fmt/format.h>

#include <numeric>

#include "compare/expect/expected_view.h"
#include "sim/scene/marker_view.h"
#include "sim/scene/pose_sampling.h"
#include "stage/axes/kinematics.h"

namespace etalon {
namespace {

// From trigger to image in hand, beyond the exposure: a guess that only the estimate uses.
constexpr std::chrono::milliseconds frame_overhead{30};

// A volume of which less than this part is free is a mistake rather than a wish.
constexpr long max_points_per_pose = 100;

// Axes whose interval is a point take no dimension of the sequence.
int dimensions_of(const PlanRequest& request) {
    return static_cast<int>(std::ranges::count_if(
        request.volume, [](const PlanRequest::Interval& i) { return i.low < i.high; }));
}

std::vector<double> target_of(const PlanRequest& request, const std::vector<double>& unit_point) {
    std::vector<double> target;
    auto coordinate = unit_point.begin();
    for (const auto& [low, high] : request.volume)
        target.push_back(low < high ? low + *coordinate++ * (high - low) : low);
    return target;
}

std::vector<PlannedPose> sampled_poses(const PlanRequest& request, std::span<const Axis> axes,
                                       const MotionRules& rules, const TargetFilter& is_useful) {
    const int hold_out = hold_out_poses(request);
    const int training = request.poses - hold_out;
    if (hold_out < 1 || training < 1)
        throw ConfigError(request.place,
                          fmt::format("{} poses with hold_out {} leave {} for "
                                      "training and {} for hold-out",
                                      request.poses, request.hold_out, training, hold_out));
    if (dimensions_of(request) == 0)
        throw ConfigError(request.place, "no axis moves");
    const HaltonSequence sequence(dimensions_of(request), request.seed);
    std::vector<PlannedPose> poses;
    const long last = max_points_per_pose * request.poses;
    for (long i = 0; i < last && poses.size() < static_cast<std::size_t>(request.poses); ++i) {
        const auto target = target_of(request, sequence.point(static_cast<std::uint64_t>(i)));
        if (is_clear(axes, rules, target) && (!is_useful || is_useful(target)))
            poses.push_back({target, std::ssize(poses) >= training});
    }
    if (poses.size() < static_cast<std::size_t>(request.poses))
        throw ConfigError(request.place, fmt::format("hardly any of it is clear of forbidden boxes "
                                                     "and seen by the camera: {} of {} points",
                                                     poses.size(), last));
    return poses;
}

// Where homing is expected to end.
std::vector<double> home_position(std::span<const Axis> axes) {
    std::vector<double> home;
    for (const Axis& axis : axes)
        home.push_back(std::clamp(0.0, axis.low, axis.high));
    return home;
}

SourcePlace place_of(const PlanRequest& request, std::size_t pose) {
    SourcePlace place = request.place;
    place.key += fmt::format(" (pose {})", pose + 1);
    return place;
}

// The order of the poses in which the way from where homing ends is short: nearest neighbours, then
// 2-opt (Croes 1958), which walks a stretch backwards where that saves time.
class ShortPath {
public:
    ShortPath(std::span<const Axis> axes, const std::vector<PlannedPose>& poses)
        : home_(poses.size()), seconds_((home_ + 1) * home_) {
        const std::vector<double> home = home_position(axes);
        for (std::size_t from = 0; from <= home_; ++from)
            for (std::size_t to = 0; to < home_; ++to)
                seconds_[from * home_ + to] =
                    std::chrono::duration<double>(
                        travel_time(axes, from == home_ ? home : poses[from].target,
                                    poses[to].target))
                        .count();
    }

    std::vector<std::size_t> find() {
        constexpr int max_sweeps = 30;  // a handful is enough in practice
        visit_nearest();
        for (int sweep = 0; sweep < max_sweeps && shorten(); ++sweep) {
        }
        return path_;
    }

private:
    double seconds(std::size_t from, std::size_t to) const { return seconds_[from * home_ + to]; }

    void visit_nearest() {
        std::vector<std::size_t> rest(home_);
        std::iota(rest.begin(), rest.end(), 0);
        for (std::size_t at = home_; !rest.empty(); at = path_.back()) {
            const auto nearest = std::ranges::min_element(
                rest, {}, [&](std::size_t next) { return seconds(at, next); });
            path_.push_back(*nearest);
            rest.erase(nearest);
        }
    }

    // One sweep; true if anything changed.
    bool shorten() {
        bool changed = false;
        for (std::size_t i = 0; i + 1 < path_.size(); ++i) {
            const std::size_t before = i == 0 ? home_ : path_[i - 1];
            for (std::size_t j = i + 1; j < path_.size(); ++j) {
                const auto onwards = [&](std::size_t from) {
                    return j + 1 == path_.size() ? 0.0 : seconds(from, path_[j + 1]);
                };
                const double now = seconds(before, path_[i]) + onwards(path_[j]);
                const double then = seconds(before, path_[j]) + onwards(path_[i]);
                if (then < now - 1e-9) {
                    std::reverse(path_.begin() + static_cast<std::ptrdiff_t>(i),
                                 path_.begin() + static_cast<std::ptrdiff_t>(j) + 1);
                    changed = true;
                }
            }
        }
        return changed;
    }

    std::size_t home_;  // as a row of the table: behind the poses
    std::vector<double> seconds_;
    std::vector<std::size_t> path_;
};

// Of the hold-out poses, evenly along the path, in reverse.
void add_repeats(const PlanRequest& request, std::vector<PlannedPose>& path) {
    std::vector<PlannedPose> judging;
    std::ranges::copy_if(path, std::back_inserter(judging), &PlannedPose::hold_out);
    const std::size_t count = static_cast<std::size_t>(request.repeats);
    if (count > judging.size())
        throw ConfigError({request.place.file, 0, "plan.repeats"},
                          fmt::format("must be at most {}, as many as are judged, not {}",
                                      judging.size(), count));
    for (std::size_t i = count; i-- > 0;)
        path.push_back(judging[(2 * i + 1) * judging.size() / (2 * count)]);
}

}  // namespace

Duration travel_time(std::span<const Axis> axes, std::span<const double> from,
                     std::span<const double> to) {
    double longest_s = 0.0;
    for (std::size_t i = 0; i < axes.size(); ++i)
        longest_s = std::max(longest_s, std::abs(to[i] - from[i]) / axes[i].speed);
    return duration_of(longest_s);
}

int hold_out_poses(const PlanRequest& request) {
    return static_cast<int>(std::lround(request.hold_out * request.poses));
}

Plan make_plan(const PlanRequest& request, std::span<const Axis> axes,
               std::chrono::microseconds exposure, const MotionRules& rules,
               const TargetFilter& is_useful) {
    if (request.volume.size() != axes.size())
        throw ConfigError(request.place, fmt::format("{} intervals for {} axes",
                                                     request.volume.size(), axes.size()));
    const std::vector<PlannedPose> poses = sampled_poses(request, axes, rules, is_useful);
    for (std::size_t i = 0; i < poses.size(); ++i)
        require_within_limits(axes, poses[i].target, place_of(request, i));
    Plan plan;
    for (const std::size_t next : ShortPath(axes, poses).find())
        plan.poses.push_back(poses[next]);
    add_repeats(request, plan.poses);
    number_poses(plan.poses);
    constexpr std::chrono::hours year(365 * 24);
    std::vector<double> at = home_position(axes);
    const Duration per_pose = request.settle + request.frames * (exposure + frame_overhead);
    for (std::size_t i = 0; i < plan.poses.size(); ++i) {
        const auto& target = plan.poses[i].target;
        plan.legs.push_back(plan_motion(axes, rules, at, target, place_of(request, i)));
        for (const MotionSegment& segment : plan.legs.back())
            plan.expected_duration += segment.time;
        plan.expected_duration += per_pose;
        if (plan.expected_duration > year)  // a speed or a time that is meant in another unit
            throw ConfigError(request.place, "the poses would take more than a year");
        at = target;
    }
    return plan;
}

void number_poses(std::vector<PlannedPose>& poses) {
    for (std::size_t i = 0; i < poses.size(); ++i) {
        poses[i].index = static_cast<int>(i);
        const auto same = std::ranges::find(poses, poses[i].target, &PlannedPose::target);
        const auto first = static_cast<std::size_t>(same - poses.begin());
        poses[i].repeats = first < i ? std::optional(first) : std::nullopt;
    }
}

Rigid expected_pose(const StationFile& station, const std::vector<double>& target) {
    return station.camera_from_base_nominal.value() *
           base_from_carriage(station.stage.axes, target) * station.carriage_from_marker_nominal;
}

Plan plan_of(const StationFile& station) {
    constexpr double margin = 0.02;  // of the width: the mounting is not quite as drawn
    TargetFilter is_seen;
    if (station.camera_from_base_nominal)
        is_seen = [&, projector = Projector(station.camera.model)](const auto& target) {
            const CameraModel& camera = projector.camera();
            const Rigid pose = expected_pose(station, target);
            return is_in_view(projector, station.marker.grid, pose, margin * camera.width) &&
                   is_rendered(station.marker.grid, pose, camera);
        };
    return make_plan(station.plan, station.stage.axes, station.camera.settings.exposure,
                     station.stage.rules, is_seen);
}

}  // namespace etalon
