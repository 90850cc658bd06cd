#include "station/bench_poses.h"

#include <numbers>

#include "calib/projector.h"
#include "core/errors.h"
#include "sim/pose_sampling.h"
#include "station/marker_in_view.h"

namespace etalon {
namespace {

constexpr double margin_px = 20.0;
constexpr int dimensions = 6;
constexpr double degree = std::numbers::pi / 180.0, full_turn = 360.0 * degree;

struct Depths {
    double nearest_mm, farthest_mm;
};

Eigen::Quaterniond about(double angle, const Eigen::Vector3d& axis) {
    return Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis));
}

// From the last three coordinates of a point: a tilt about an axis in the image plane, then a turn.
Eigen::Quaterniond tilted_any_way(const std::vector<double>& u, double max_tilt) {
    const double direction = full_turn * u[4];
    const Eigen::Vector3d axis(std::cos(direction), std::sin(direction), 0.0);
    return about(u[3] * max_tilt, axis) * about(full_turn * u[5], Eigen::Vector3d::UnitZ());
}

Eigen::Quaterniond rolled_pitched_yawed(const std::vector<double>& u) {
    const auto within = [](double at, double limit) { return (2.0 * at - 1.0) * limit; };
    return about(within(u[5], 180.0 * degree), Eigen::Vector3d::UnitZ()) *
           about(within(u[4], 45.0 * degree), Eigen::Vector3d::UnitY()) *
           about(within(u[3], 45.0 * degree), Eigen::Vector3d::UnitX());
}

// The grid's centre at the pixel and depth that the first three coordinates say.
std::optional<Rigid> drawn_pose(const Projector& projector, const CellGrid& grid,
                                const std::vector<double>& u, const Depths& depths,
                                const Eigen::Quaterniond& rotation) {
    const CameraModel& camera = projector.camera();
    const auto x = projector.unproject({u[0] * camera.width, u[1] * camera.height});
    if (!x)
        return std::nullopt;
    const double z = depths.nearest_mm + u[2] * (depths.farthest_mm - depths.nearest_mm);
    const Eigen::Vector3d centre = grid.point_mm(0.5 * grid.columns(), 0.5 * grid.rows());
    return Rigid{rotation, z * x->homogeneous() - rotation * centre};
}

template <class Rotation>
std::vector<Rigid> seen_poses(const CameraModel& camera, const CellGrid& grid, int count,
                              std::uint64_t seed, const Depths& depths, const Rotation& rotation) {
    const Projector projector(camera);
    const HaltonSequence sequence(dimensions, seed);
    std::vector<Rigid> poses;
    const auto wanted = static_cast<std::size_t>(count);
    for (std::uint64_t index = 1; poses.size() < wanted; ++index) {
        if (index > 1000 * (poses.size() + 1))
            throw NumericalError("the marker hardly fits into the camera's view");
        const auto u = sequence.point(index);
        const auto pose = drawn_pose(projector, grid, u, depths, rotation(u));
        if (pose && is_in_view(projector, grid, *pose, margin_px))
            poses.push_back(*pose);
    }
    return poses;
}

}  // namespace

std::vector<Rigid> volume_poses(const CameraModel& camera, const CellGrid& grid, int count,
                                std::uint64_t seed, const SeenVolume& volume) {
    return seen_poses(
        camera, grid, count, seed, {volume.nearest_mm, volume.farthest_mm},
        [&](const std::vector<double>& u) { return tilted_any_way(u, volume.max_tilt); });
}

std::vector<Rigid> spread_poses(const CameraModel& camera, const CellGrid& grid, int count,
                                std::uint64_t seed) {
    return volume_poses(camera, grid, count, seed, {150.0, 1500.0, 70.0 * degree});
}

std::vector<Rigid> study_poses(const CameraModel& camera, const CellGrid& grid, int count,
                               std::uint64_t seed) {
    return seen_poses(camera, grid, count, seed, {500.0, 1500.0}, rolled_pitched_yawed);
}

}  // namespace etalon
