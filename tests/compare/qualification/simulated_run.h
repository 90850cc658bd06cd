// A qualification run at corner level: a true camera and stage on one side, what the station
// believes on the other, and no pixels in between. The truth never passes through compare/.
#pragma once

#include <functional>
#include <numbers>

#include "compare/qualification/qualification.h"
#include "core/statistics/random.h"
#include "stage/axes/kinematics.h"
#include "tests/calib/cameras.h"

namespace etalon {

using Corners = std::vector<Eigen::Vector2d>;
using test::corners_at;

struct SimulatedRun {
    // What the station believes.
    CameraModel camera;
    std::vector<Eigen::Vector3d> points_mm = {
        {-40, -40, 0}, {40, -40, 0}, {40, 40, 0}, {-40, 40, 0}};
    std::vector<Axis> axes;
    std::vector<std::array<double, 2>> volume;  // per axis
    int training = 30, hold_out = 40;
    std::optional<std::uint64_t> plan_seed;  // nothing: another plan for every seed of the noise
    Rigid nominal_carriage_from_marker;
    bool look_for_causes = false;
    Limits limits{"demo", {{quantity::position_rms, 0.16}, {quantity::position_max, 0.45}}};

    // The truth.
    CameraModel true_camera;
    std::vector<Axis> true_axes;  // directions differ where the stage is not square
    std::vector<double> true_scale{1, 1, 1, 1};
    Rigid camera_from_base, carriage_from_marker;
    double marker_scale = 1.0, marker_twist_mm = 0.0;  // corners up and down in turn
    // Of the axes where they stop, from what they read, and of the marker before the camera; `pose`
    // counts from 0.
    std::function<void(std::vector<double>& q, std::size_t pose)> misread = [](auto&, auto) {};
    std::function<Rigid(const Rigid&, std::size_t pose)> moved = [](const Rigid& at, auto) {
        return at;
    };
    // Of the corners in photographs and not in renders.
    std::function<Corners(const Corners&)> seen = [](const Corners& c) { return c; };
    double noise_px = 0.01;           // of a corner's coordinate, averaged over the frames
    double repeatability_mm = 0.002;  // of each linear axis
    // What the detector adds to true corners, in photo and render alike.
    std::function<Corners(const Corners&)> detector = [](const Corners& c) { return c; };
};

inline Axis demo_axis(const std::string& name, Axis::Kind kind, const Eigen::Vector3d& direction) {
    Axis axis{name, kind, direction};
    axis.scale_uncertainty = 20e-6;
    axis.repeatability = kind == Axis::Kind::linear ? 0.002 : 2e-5;
    return axis;
}

inline Rigid demo_mount() {
    return {rotation_from_vector({22.0 * rad_per_deg, 0.0, 0.0}), {5.0, -7.0, 20.0}};
}

// The demo's station: a wide-angle camera looks along z at an 80 mm tag on an XYZ + Rz stage.
inline SimulatedRun demo_run() {
    SimulatedRun run;
    run.camera = test::camera_with(512, 384, {431.0, 431.0, 253.7, 194.2},
                                   {.k1 = -0.286, .k2 = 0.057, .k3 = 0.112});
    using enum Axis::Kind;
    run.axes = {demo_axis("x", linear, {1, 0, 0}), demo_axis("y", linear, {0, 1, 0}),
                demo_axis("z", linear, {0, 0, 1}), demo_axis("rz", rotary, {0, 0, 1})};
    run.volume = {{-120, 120}, {-80, 80}, {-150, 150}, {-std::numbers::pi, std::numbers::pi}};
    run.nominal_carriage_from_marker = demo_mount();
    run.plan_seed = 6;
    run.true_camera = run.camera;
    run.true_axes = run.axes;
    run.camera_from_base = {rotation_from_vector({0.02, -0.03, 0.01}), {4.0, -3.0, 480.0}};
    run.carriage_from_marker = left_perturbed(
        demo_mount(), (Vector6d() << 0.01, -0.007, 0.013, 0.3, -0.2, 0.5).finished());
    return run;
}

// The same stage before a fisheye of 190 degrees, and so much of a turn off its axis, rad: 20 to 70
// degrees, or with 1.35 from 60 to 95.
inline SimulatedRun wide_run(double aside = 0.67) {
    SimulatedRun run = demo_run();
    run.camera = test::camera_with(800, 600, {226.0, 226.0, 395.7, 304.2},
                                   {.k1 = 0.031, .k2 = -0.014, .k3 = 0.0021, .k7 = -2e-4});
    run.camera.projection.kind = Projection::equidistant;
    run.true_camera = run.camera;
    run.volume = {{-115, 115}, {-80, 80}, {-75, 110}, {-std::numbers::pi, std::numbers::pi}};
    run.camera_from_base.rotation = rotation_from_vector({0.16, aside, -0.04});
    run.camera_from_base.translation =
        run.camera_from_base.rotation * Eigen::Vector3d(9.0, -14.0, 350.0);
    return run;
}

// The same without any noise.
inline SimulatedRun without_noise(SimulatedRun run) {
    run.noise_px = run.repeatability_mm = 0.0;
    return run;
}

// Every corner moved by `shift`.
inline Corners moved_by(Corners corners, const Eigen::Vector2d& shift) {
    for (Eigen::Vector2d& corner : corners)
        corner += shift;
    return corners;
}

// Every corner of a square moved from the middle by so much.
inline Corners moved_outwards(Corners corners, double px) {
    const Eigen::Vector2d middle = (corners[0] + corners[1] + corners[2] + corners[3]) / 4.0;
    for (Eigen::Vector2d& corner : corners)
        corner += px * (corner - middle).normalized();
    return corners;
}

// Halton's sequence with a random shift; training poses first.
inline std::vector<std::vector<double>> positions(const SimulatedRun& run, std::uint64_t seed) {
    constexpr int primes[] = {2, 3, 5, 7};
    std::vector<std::vector<double>> all;
    for (int i = 1; i <= run.training + run.hold_out; ++i) {
        std::vector<double> q;
        for (std::size_t k = 0; k < run.axes.size(); ++k) {
            double value = 0.0, weight = 1.0;
            for (int rest = i; rest > 0; rest /= primes[k])
                value += (weight /= primes[k]) * (rest % primes[k]);
            value += RandomStream(seed, static_cast<std::uint32_t>(k)).uniform();
            const auto [low, high] = run.volume[k];
            q.push_back(low + (value - std::floor(value)) * (high - low));
        }
        all.push_back(q);
    }
    return all;
}

// Where the marker truly is with the axes reading q; stage noise from `random`.
inline Rigid true_pose(const SimulatedRun& run, std::vector<double> q, RandomStream& random,
                       std::size_t pose) {
    run.misread(q, pose);
    for (std::size_t k = 0; k < q.size(); ++k) {
        q[k] *= run.true_scale[k];
        if (run.axes[k].kind == Axis::Kind::linear)
            q[k] += run.repeatability_mm * random.normal();
    }
    return run.moved(
        run.camera_from_base * base_from_carriage(run.true_axes, q) * run.carriage_from_marker,
        pose);
}

// What the camera truly sees with the axes reading q; noise keyed by (seed, pose).
inline Corners photo(const SimulatedRun& run, const std::vector<double>& q, std::uint64_t seed,
                     std::size_t pose) {
    RandomStream random(seed, 100, pose);
    const Rigid truth = true_pose(run, q, random, pose);
    std::vector<Eigen::Vector3d> points = run.points_mm;
    for (Eigen::Vector3d& point : points) {
        point *= run.marker_scale;
        point.z() += run.marker_twist_mm * (point.x() * point.y() > 0.0 ? 1.0 : -1.0);
    }
    const Projector camera(run.true_camera, Projector(run.camera));
    Corners corners = run.seen(run.detector(corners_at(camera, points, truth)));
    for (Eigen::Vector2d& corner : corners)
        corner += run.noise_px * Eigen::Vector2d{random.normal(), random.normal()};
    return corners;
}

// A photometric reading of the same photograph by a camera that is as it should be: the truth with
// noise of a fifth of the corners', and no detector in between.
inline PhotometricReading reading(const SimulatedRun& run, const std::vector<double>& q,
                                  std::uint64_t seed, std::size_t pose) {
    RandomStream stage_noise(seed, 100, pose), noise(seed, 101, pose);
    const Vector6d deviation = (Vector6d() << 2e-4, 2e-4, 3e-5, 2e-3, 2e-3, 1.5e-2).finished();
    Vector6d error;
    for (int k = 0; k < 6; ++k)
        error[k] = deviation[k] * noise.normal();
    return {left_perturbed(true_pose(run, q, stage_noise, pose), error),
            Matrix6d(deviation.cwiseAbs2().asDiagonal())};
}

inline DeclaredStageTerm scale_term(const SimulatedRun& run, std::vector<std::vector<double>> all,
                                    std::size_t axis) {
    DeclaredStageTerm term{.error = {"stage scale " + run.axes[axis].name, "1", 1e-4, {}},
                           .in_budget = true,
                           .standard_uncertainty = run.axes[axis].scale_uncertainty};
    for (std::vector<double>& q : all) {
        q[axis] *= 1.0 + 1e-4;
        term.error.base_from_carriage.push_back(base_from_carriage(run.axes, q));
    }
    term.error.is_linear_scale = run.axes[axis].kind == Axis::Kind::linear;
    return term;
}

inline DeclaredStageTerm squareness_term(const SimulatedRun& run,
                                         const std::vector<std::vector<double>>& all,
                                         std::size_t first, std::size_t second) {
    std::vector<Axis> leaning = run.axes;
    leaning[second].direction += 1e-4 * leaning[first].direction;
    leaning[second].direction.normalize();
    const std::string axes = run.axes[first].name + run.axes[second].name;
    DeclaredStageTerm term{.error = {"stage squareness " + axes, "rad", 1e-4, {}}};
    for (const std::vector<double>& q : all)
        term.error.base_from_carriage.push_back(base_from_carriage(leaning, q));
    return term;
}

// Side from which an axis came to each pose; the first one from below.
inline std::vector<int> approaches(const std::vector<std::vector<double>>& all, std::size_t axis) {
    std::vector<int> sides{1};
    for (std::size_t i = 1; i < all.size(); ++i)
        sides.push_back(all[i][axis] > all[i - 1][axis] ? 1 : -1);
    return sides;
}

inline StageAxisMotion axis_motion(const SimulatedRun& run,
                                   const std::vector<std::vector<double>>& all, std::size_t axis) {
    const bool is_linear = run.axes[axis].kind == Axis::Kind::linear;
    StageAxisMotion motion{run.axes[axis].name, is_linear, is_linear ? 0.01 : 1e-4};
    motion.approach = approaches(all, axis);
    for (std::vector<double> q : all) {
        motion.position.push_back(q[axis]);
        const Rigid read = base_from_carriage(run.axes, q);
        for (std::size_t way = 0; is_linear && way < 2; ++way) {
            Rigid aside = read;
            aside.translation[static_cast<Eigen::Index>((axis + 1 + way) % 3)] += motion.step;
            motion.aside[way].push_back(aside);
        }
        q[axis] += motion.step;
        motion.advanced.push_back(base_from_carriage(run.axes, q));
    }
    return motion;
}

// `run` must outlive the input.
inline QualificationInput input_of(const SimulatedRun& run, std::uint64_t seed) {
    QualificationInput input;
    input.camera = &run.camera;
    input.points_mm = run.points_mm;
    const std::vector<std::vector<double>> all = positions(run, run.plan_seed.value_or(seed));
    for (std::size_t i = 0; i < all.size(); ++i) {
        VisitedPose pose;
        pose.hold_out = static_cast<int>(i) >= run.training;
        pose.index = static_cast<int>(i);
        pose.base_from_carriage = base_from_carriage(run.axes, all[i]);
        pose.corners = photo(run, all[i], seed, i);
        if (run.noise_px > 0.0)
            pose.corner_noise = CornerNoise{run.noise_px * run.noise_px, 16.0};
        pose.settled_s = 2.0 * static_cast<double>(i);
        if (pose.hold_out)
            pose.photometric = reading(run, all[i], seed, i);
        input.poses.push_back(pose);
    }
    input.nominal_carriage_from_marker = run.nominal_carriage_from_marker;
    input.render_and_detect = [&run, projector = Projector(run.camera)](
                                  const Rigid& camera_from_marker) -> std::optional<Corners> {
        return run.detector(corners_at(projector, run.points_mm, camera_from_marker));
    };
    for (std::size_t k = 0; k < run.axes.size(); ++k)
        input.stage_terms.push_back(scale_term(run, all, k));
    for (std::size_t k = 0; k < 3; ++k)
        for (std::size_t m = k + 1; m < 3; ++m)
            input.stage_terms.push_back(squareness_term(run, all, k, m));
    for (std::size_t k = 0; k < run.axes.size(); ++k)
        input.axis_motions.push_back(axis_motion(run, all, k));
    for (const Axis& axis : run.axes)
        input.repeatability.push_back({axis.name, 0.002});
    input.marker_size_uncertainty = 20e-6;
    input.marker_flatness_mm = 0.01;
    input.temperature = DeclaredTemperature{0.5, 9e-6, 11e-6};
    input.limits = run.limits;
    input.options.look_for_causes = run.look_for_causes;
    input.options.seed = seed;
    return input;
}

inline QualificationInput demo_input(std::uint64_t seed = 1) {
    static const SimulatedRun run = demo_run();
    return input_of(run, seed);
}

inline const AcceptanceCondition& condition(const Qualification& result, const std::string& name) {
    return *std::ranges::find(result.conditions, name, &AcceptanceCondition::name);
}

}  // namespace etalon
