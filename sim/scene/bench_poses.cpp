#include "sim/scene/bench_poses.h"

#include "calib/camera/projector.h"
#include "core/geometry/units.h"
#include "core/program/errors.h"
#include "sim/scene/marker_view.h"
#include "sim/scene/pose_sampling.h"
#include "sim/scene/pose_volume.h"

namespace etalon {
namespace {

constexpr double margin_px = 20.0;
constexpr int dimensions = 6;
constexpr double full_turn = 360.0 * rad_per_deg;

Eigen::Quaterniond about(double angle, const Eigen::Vector3d& axis) {
    return Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis));
}

// From the last three coordinates of a point: a tilt about an axis in the image plane, then a turn.
Eigen::Quaterniond tilted_any_way(const std::vector<double>& u, double max_tilt) {
    const double direction = full_turn * u[4];
    const Eigen::Vector3d axis(std::cos(direction), std::sin(direction), 0.0);
    return about(u[3] * max_tilt, axis) * about(full_turn * u[5], Eigen::Vector3d::UnitZ());
}

// The grid's centre at the pixel and depth that the first three coordinates say.
std::optional<Rigid> drawn_pose(const Projector& projector, const CellGrid& grid,
                                const std::vector<double>& u, const SeenVolume& volume) {
    const CameraModel& camera = projector.camera();
    const auto x = projector.unproject({u[0] * camera.width, u[1] * camera.height});
    if (!x)
        return std::nullopt;
    const double z = volume.nearest_mm + u[2] * (volume.farthest_mm - volume.nearest_mm);
    const Eigen::Quaterniond rotation = tilted_any_way(u, volume.max_tilt);
    const Eigen::Vector3d centre = grid.point_mm(0.5 * grid.columns(), 0.5 * grid.rows());
    return Rigid{rotation, z * x->homogeneous() - rotation * centre};
}

}  // namespace

std::vector<Rigid> volume_poses(const CameraModel& camera, const CellGrid& grid, int count,
                                std::uint64_t seed, const SeenVolume& volume) {
    const Projector projector(camera);
    const HaltonSequence sequence(dimensions, seed);
    std::vector<Rigid> poses;
    const auto wanted = static_cast<std::size_t>(count);
    for (std::uint64_t index = 1; poses.size() < wanted; ++index) {
        if (index > 1000 * (poses.size() + 1))
            throw NumericalError("the marker hardly fits into the camera's view");
        const auto pose = drawn_pose(projector, grid, sequence.point(index), volume);
        if (pose && is_in_view(projector, grid, *pose, margin_px))
            poses.push_back(*pose);
    }
    return poses;
}

std::vector<Rigid> spread_poses(const CameraModel& camera, const CellGrid& grid, int count,
                                std::uint64_t seed) {
    return volume_poses(camera, grid, count, seed, {150.0, 1500.0, 70.0 * rad_per_deg});
}

std::vector<Rigid> study_poses(const CameraModel& camera, const CellGrid& grid, int count,
                               std::uint64_t seed) {
    constexpr Interval to_either_side{-45.0 * rad_per_deg, 45.0 * rad_per_deg};
    const PoseVolume volume{.z_mm = {500.0, 1500.0},
                            .roll = to_either_side,
                            .pitch = to_either_side,
                            .yaw = {-180.0 * rad_per_deg, 180.0 * rad_per_deg},
                            .margin_px = margin_px};
    PoseSampler sampler(camera, {&grid, 1}, volume, SequenceKind::halton, seed);
    std::vector<Rigid> poses;
    while (poses.size() < static_cast<std::size_t>(count))
        poses.push_back(sampler.next().camera_from_marker);
    return poses;
}

}  // namespace etalon
