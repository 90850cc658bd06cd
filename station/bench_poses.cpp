#include "station/bench_poses.h"

#include <numbers>

#include "calib/projector.h"
#include "core/errors.h"
#include "sim/marker_view.h"
#include "sim/pose_sampling.h"

namespace etalon {
namespace {

constexpr double nearest_mm = 150.0, farthest_mm = 1500.0;
constexpr double largest_tilt = 70.0 * std::numbers::pi / 180.0;
constexpr double margin_px = 20.0;
constexpr int dimensions = 6;

// The grid's centre at the pixel and depth that the first three coordinates say.
std::optional<Rigid> drawn_pose(const Projector& projector, const CellGrid& grid,
                                const std::vector<double>& u) {
    const CameraModel& camera = projector.camera();
    const auto x = projector.unproject({u[0] * camera.width, u[1] * camera.height});
    if (!x)
        return std::nullopt;
    const double z = nearest_mm + u[2] * (farthest_mm - nearest_mm);
    const double direction = 2.0 * std::numbers::pi * u[4];
    const Eigen::AngleAxisd tilt(u[3] * largest_tilt,
                                 Eigen::Vector3d(std::cos(direction), std::sin(direction), 0.0));
    const Eigen::AngleAxisd turn(2.0 * std::numbers::pi * u[5], Eigen::Vector3d::UnitZ());
    const Eigen::Quaterniond rotation(tilt * turn);
    const Eigen::Vector3d centre = grid.point_mm(0.5 * grid.columns(), 0.5 * grid.rows());
    return Rigid{rotation, z * x->homogeneous() - rotation * centre};
}

// The whole front in front of the lens, seen by all of it, inside the image.
bool is_seen(const Projector& projector, const CellGrid& grid, const Rigid& pose) {
    const CameraModel& camera = projector.camera();
    const Eigen::Vector3d inward = pose.rotation * Eigen::Vector3d::UnitZ();
    const double lens_mm = camera.lens ? aperture_of(camera).radius_mm : 0.0;
    if (!(inward.dot(pose.translation) > lens_mm * inward.head<2>().norm()))
        return false;
    for (const int u : {0, grid.columns()})
        for (const int v : {0, grid.rows()}) {
            const auto pixel = projector.project(pose * grid.point_mm(u, v));
            if (!pixel || pixel->x() < margin_px || pixel->y() < margin_px ||
                pixel->x() > camera.width - 1 - margin_px ||
                pixel->y() > camera.height - 1 - margin_px)
                return false;
        }
    return true;
}

}  // namespace

std::vector<Rigid> spread_poses(const CameraModel& camera, const CellGrid& grid, int count,
                                std::uint64_t seed) {
    const Projector projector(camera);
    const HaltonSequence sequence(dimensions, seed);
    std::vector<Rigid> poses;
    const auto wanted = static_cast<std::size_t>(count);
    for (std::uint64_t index = 1; poses.size() < wanted; ++index) {
        if (index > 1000 * (poses.size() + 1))
            throw NumericalError("the marker hardly fits into the camera's view");
        const auto pose = drawn_pose(projector, grid, sequence.point(index));
        if (pose && is_seen(projector, grid, *pose))
            poses.push_back(*pose);
    }
    return poses;
}

}  // namespace etalon
