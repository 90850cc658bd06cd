// Where the stage goes: poses spread over the volume, split into training and hold-out before
// anything is measured, in an order that keeps the travel short.
//
// Training and hold-out are two consecutive blocks of one digit-scrambled Halton sequence
// (sim/scene/pose_sampling.h): each block fills the volume evenly. (Every second point would not:
// base 2 alternates between the halves of the first axis.) The path visits both kinds mixed. At its
// end some hold-out poses are visited again, last first: most axes then come from the other side.
#pragma once

#include "station/setup/station_file.h"

namespace etalon {

struct Plan {
    std::vector<PlannedPose> poses;  // in the order of the run
    // How the stage gets to each pose from the one before, to the first from where homing is
    // expected to end (0, or the limit nearest to it). A run plans again from what it reads.
    std::vector<std::vector<MotionSegment>> legs;
    // Travel at the axes' speeds, settling and exposing; without homing and analysis.
    Duration expected_duration{};
};

// How many of the poses judge, without those that are visited again.
int hold_out_poses(const PlanRequest& request);

// Whether a target is of use; empty: every one is.
using TargetFilter = std::function<bool(const std::vector<double>& target)>;

// Deterministic in the request. Leaves out points in or near forbidden boxes and those that
// `is_useful` refuses. Throws ConfigError at request.place, naming axis and pose, for a pose beyond
// a soft limit or without a way, hardly any volume left, an empty side of the split, and more
// repeats than hold-out poses.
Plan make_plan(const PlanRequest& request, std::span<const Axis> axes,
               std::chrono::microseconds exposure, const MotionRules& rules = {},
               const TargetFilter& is_useful = {});

// The station's plan; with camera_mount only targets with the marker 2 % within the image.
Plan plan_of(const StationFile& station);

// camera_from_marker at a target as drawn; the station must state its camera_mount.
Rigid expected_pose(const StationFile& station, const std::vector<double>& target);

// Sets each pose's place in the plan, and which earlier one it repeats.
void number_poses(std::vector<PlannedPose>& poses);

// Time to go from one position to another with all axes moving together at their speeds.
Duration travel_time(std::span<const Axis> axes, std::span<const double> from,
                     std::span<const double> to);

}  // namespace etalon
