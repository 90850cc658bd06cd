#include "sim/scene/pose_volume.h"

#include <fmt/format.h>

#include "core/geometry/units.h"
#include "core/program/errors.h"
#include "sim/scene/marker_view.h"

namespace etalon {
namespace {

constexpr double max_angle = 2.0 * std::numbers::pi;
constexpr std::uint64_t max_points_per_pose = 1000;
constexpr std::uint64_t min_seen = 10;  // poses before which no rate is judged: 1 in 400 passes

ConfigError refusal(const char* key, const std::string& why) {
    return ConfigError({"", 0, key}, why);
}

struct NamedInterval {
    const char* name;
    std::optional<Interval> interval;
    bool is_angle = false;
};

std::array<NamedInterval, 6> axes_of(const PoseVolume& v) {
    return {{{"x_mm", v.x_mm},
             {"y_mm", v.y_mm},
             {"z_mm", v.z_mm},
             {"roll", v.roll, true},
             {"pitch", v.pitch, true},
             {"yaw", v.yaw, true}}};
}

const PoseVolume& checked(const PoseVolume& volume) {
    for (const auto& [name, interval, is_angle] : axes_of(volume)) {
        const auto [low, high] = interval.value_or(Interval());
        if (!std::isfinite(high - low))
            throw refusal(name, fmt::format("from {} to {} is no finite interval", low, high));
        if (low > high)
            throw refusal(name, fmt::format("from {} to {}: the first is the larger", low, high));
        if (is_angle && (low < -max_angle || high > max_angle))
            throw refusal(name, fmt::format("from {} to {} rad is more than a full turn: degrees?",
                                            low, high));
    }
    if (!(volume.z_mm.low > 0.0))
        throw refusal(
            "z_mm", fmt::format("a depth of {} mm is not in front of the camera", volume.z_mm.low));
    if (!(volume.margin_px >= 0.0) || !std::isfinite(volume.margin_px))
        throw refusal("margin_px", fmt::format("{} is no margin in px", volume.margin_px));
    return volume;
}

std::array<bool, 6> moving_axes(const PoseVolume& volume) {
    std::array<bool, 6> moves{};
    const std::array<NamedInterval, 6> axes = axes_of(volume);
    for (std::size_t i = 0; i < axes.size(); ++i)
        moves[i] = !axes[i].interval || !axes[i].interval->is_fixed();
    return moves;
}

// A study of one repeated pose is one of a dimension that nothing uses.
int dimensions_of(const std::array<bool, 6>& moves, int extra) {
    if (extra < 0)
        throw NumericalError(fmt::format("{} extra dimensions", extra));
    return std::max(1, static_cast<int>(std::count(moves.begin(), moves.end(), true)) + extra);
}

// The point moved along x (axis 0) or y (axis 1) until its image has that column or row (damped
// Newton). Nothing where the camera sees no such point.
std::optional<Eigen::Vector3d> moved_to_pixel(const Projector& projector, Eigen::Vector3d p_camera,
                                              Eigen::Index axis, double pixel) {
    constexpr int max_steps = 40;
    constexpr double tolerance_px = 1e-9;
    double step = 0.0;
    for (int i = 0; i < max_steps; ++i) {
        const Eigen::Vector3d moved = p_camera + step * Eigen::Vector3d::Unit(axis);
        const auto image = projector.project_with_jacobian(moved);
        if (!image) {
            step *= 0.5;
            continue;
        }
        p_camera = moved;
        const double error = image->pixel[axis] - pixel, slope = image->jacobian(axis, axis);
        if (std::abs(error) < tolerance_px)
            return p_camera;
        if (!(slope > 0.0))
            return std::nullopt;
        step = -error / slope;
    }
    return std::nullopt;
}

}  // namespace

PoseSampler::PoseSampler(const CameraModel& camera, std::span<const CellGrid> grids,
                         const PoseVolume& volume, SequenceKind kind, std::uint64_t seed,
                         int extra_dimensions)
    : projector_(camera),
      volume_(checked(volume)),
      grids_(grids.begin(), grids.end()),
      moves_(moving_axes(volume)),
      extra_dimensions_(extra_dimensions),
      sequence_(kind, dimensions_of(moves_, extra_dimensions), seed) {
    if (grids_.empty())
        throw NumericalError("poses of no marker");
}

PoseSampler::Sample PoseSampler::next() {
    while (points_ < max_points_per_pose * std::max(seen_, min_seen)) {
        if (auto found = sample(points_++)) {
            ++seen_;
            return std::move(*found);
        }
    }
    throw NumericalError(fmt::format(
        "the camera sees the whole marker at {} of the first {} poses of the volume: 1 in 1000 or "
        "less",
        seen_, points_));
}

std::optional<PoseSampler::Sample> PoseSampler::sample(std::uint64_t index) const {
    const std::vector<double> point = sequence_.point(index);
    auto coordinate = point.begin();
    std::array<double, 6> u{};
    for (std::size_t axis = 0; axis < u.size(); ++axis)
        if (moves_[axis])
            u[axis] = *coordinate++;
    const auto p_camera = position(u);
    if (!p_camera)
        return std::nullopt;
    const Rigid pose{rotation_from_roll_pitch_yaw(
                         {volume_.roll.at(u[3]), volume_.pitch.at(u[4]), volume_.yaw.at(u[5])}),
                     *p_camera};
    for (const CellGrid& grid : grids_)
        if (!is_in_view(projector_, grid, pose, volume_.margin_px))
            return std::nullopt;
    return Sample{index, pose, {coordinate, coordinate + extra_dimensions_}};
}

std::optional<Eigen::Vector3d> PoseSampler::position(const std::array<double, 6>& u) const {
    const CameraModel& camera = projector_.camera();
    const auto &x_mm = volume_.x_mm, &y_mm = volume_.y_mm;
    const double z = volume_.z_mm.at(u[2]);
    const Eigen::Vector2d pixel(u[0] * camera.width - 0.5, u[1] * camera.height - 0.5);
    if (x_mm && y_mm)
        return Eigen::Vector3d(x_mm->at(u[0]), y_mm->at(u[1]), z);
    if (x_mm)
        return moved_to_pixel(projector_, {x_mm->at(u[0]), 0.0, z}, 1, pixel.y());
    if (y_mm)
        return moved_to_pixel(projector_, {0.0, y_mm->at(u[1]), z}, 0, pixel.x());
    const auto ray = projector_.unproject(pixel);
    if (!ray)
        return std::nullopt;
    const double scale = camera.projection.kind == Projection::telecentric ? 1.0 : z;
    return Eigen::Vector3d(scale * ray->x(), scale * ray->y(), z);
}

namespace {

constexpr double margin_px = 20.0;
constexpr double full_turn = 360.0 * rad_per_deg;

// From six coordinates: the grid's centre at a pixel and a depth, tilted about an axis in the image
// plane, then turned in its own.
std::optional<Rigid> drawn_pose(const Projector& projector, const CellGrid& grid,
                                const std::vector<double>& u, const SeenVolume& volume) {
    const CameraModel& camera = projector.camera();
    const auto x = projector.unproject({u[0] * camera.width, u[1] * camera.height});
    if (!x)
        return std::nullopt;
    const double z = volume.nearest_mm + u[2] * (volume.farthest_mm - volume.nearest_mm);
    const double direction = full_turn * u[4];
    const Eigen::Vector3d axis(std::cos(direction), std::sin(direction), 0.0);
    const Eigen::Quaterniond tilt(Eigen::AngleAxisd(u[3] * volume.max_tilt, axis));
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(full_turn * u[5], Eigen::Vector3d::UnitZ()));
    const Eigen::Quaterniond rotation = tilt * turn;
    const Eigen::Vector3d centre = grid.point_mm(0.5 * grid.columns(), 0.5 * grid.rows());
    return Rigid{rotation, z * x->homogeneous() - rotation * centre};
}

}  // namespace

std::vector<Rigid> volume_poses(const CameraModel& camera, const CellGrid& grid, int count,
                                std::uint64_t seed, const SeenVolume& volume) {
    const Projector projector(camera);
    const HaltonSequence sequence(6, seed);
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
