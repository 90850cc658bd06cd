// Errors of every kind that can be put into the truth of a simulated run, with the name that the
// search for causes should give them.
#pragma once

#include <string>
#include <vector>

#include "tests/compare/qualification/simulated_run.h"

namespace etalon {

struct InjectedKind {
    std::string name;     // of the candidate, or how it begins
    double easily = 0.0;  // a size that nobody misses
    std::function<void(SimulatedRun&, double size)> inject;
    // Standard deviations of what is detectable: Currie's limit for one number; for several, or the
    // best of many that are tried, what a test by chi-square finds in 95 % of runs though it cries
    // out in 5 % of those without.
    double sigmas = 3.29;
};

inline constexpr double detected_of_two = 3.93, detected_of_three = 4.14;
inline constexpr double detected_period = 5.8;  // two, the best of 319 to 599
inline constexpr double detected_pose = 5.56;   // three, the best of 70

// One misreading after the other.
inline void misread_also(SimulatedRun& run,
                         std::function<void(std::vector<double>& q, std::size_t pose)> next) {
    run.misread = [before = run.misread, next](std::vector<double>& q, std::size_t pose) {
        before(q, pose);
        next(q, pose);
    };
}

inline void seen_also(SimulatedRun& run, std::function<Corners(const Corners&)> next) {
    run.seen = [before = run.seen, next](const Corners& corners) { return next(before(corners)); };
}

inline void moved_also(SimulatedRun& run,
                       std::function<Rigid(const Rigid&, std::size_t pose)> next) {
    run.moved = [before = run.moved, next](const Rigid& at, std::size_t pose) {
        return next(before(at, pose), pose);
    };
}

inline InjectedKind lens_kind(const std::string& name, double easily, double Distortion::*term) {
    return {name, easily,
            [term](SimulatedRun& run, double size) { run.true_camera.distortion.*term += size; }};
}

inline std::vector<InjectedKind> lens_kinds() {
    using D = Distortion;
    return {
        {"focal length", 3e-3,
         [](SimulatedRun& run, double size) { run.true_camera.intrinsics.zoom(1.0 + size); }},
        {"aspect of fx, fy", 2e-3,
         [](SimulatedRun& run, double size) { run.true_camera.intrinsics.fy *= 1.0 + size; }},
        {"c_x", 3.0, [](SimulatedRun& run, double size) { run.true_camera.intrinsics.cx += size; }},
        {"c_y", 3.0, [](SimulatedRun& run, double size) { run.true_camera.intrinsics.cy += size; }},
        {"skew", 2e-3,
         [](SimulatedRun& run, double size) {
             seen_also(run, [size, middle = run.camera.intrinsics.cy](Corners corners) {
                 for (Eigen::Vector2d& corner : corners)
                     corner.x() += size * (corner.y() - middle);
                 return corners;
             });
         }},
        lens_kind("k1", 0.01, &D::k1),
        lens_kind("k2", 0.03, &D::k2),
        lens_kind("k3", 0.08, &D::k3),
        lens_kind("p1", 1e-3, &D::p1),
        lens_kind("p2", 1e-3, &D::p2),
        lens_kind("thin prism s1", 3e-3, &D::s1),
        lens_kind("thin prism s2", 1e-2, &D::s2),
        lens_kind("thin prism s3", 3e-3, &D::s3),
        lens_kind("thin prism s4", 1e-2, &D::s4),
        lens_kind("sensor tilt tau_x", 5e-3, &D::tau_x),
        lens_kind("sensor tilt tau_y", 5e-3, &D::tau_y),
    };
}

inline std::vector<InjectedKind> marker_error_kinds() {
    return {
        {"marker print size", 2e-3,
         [](SimulatedRun& run, double size) { run.marker_scale += size; }},
        {"marker twist", 0.5, [](SimulatedRun& run, double size) { run.marker_twist_mm += size; }},
        {"edge shrink", 0.1, [](SimulatedRun& run, double size) {
             seen_also(run, [size](const Corners& corners) {
                 return edges_moved_inwards(corners, size);
             });
         }}};
}

inline std::vector<InjectedKind> axis_kinds(std::size_t axis, const std::string& name) {
    using Positions = std::vector<double>;
    return {{"stage scale " + name, 1e-3,
             [axis](SimulatedRun& run, double size) { run.true_scale[axis] += size; }},
            {"backlash of " + name, 0.3,
             [axis](SimulatedRun& run, double size) {
                 const auto sides = approaches(positions(run, *run.plan_seed), axis);
                 misread_also(
                     run, [=](Positions& q, std::size_t i) { q[axis] -= 0.5 * size * sides[i]; });
             }},
            {name + " repeats with a period of", 0.2,
             [axis](SimulatedRun& run, double size) {
                 misread_also(run, [=](Positions& q, std::size_t) {
                     q[axis] += size * std::sin(2.0 * std::numbers::pi * q[axis] / 7.0 + 0.6);
                 });
             },
             detected_period},
            {"straightness of " + name, 0.2,
             [axis](SimulatedRun& run, double size) {
                 misread_also(run, [=, half = run.volume[axis][1]](Positions& q, std::size_t) {
                     q[(axis + 1) % 3] += size * (1.0 - std::pow(q[axis] / half, 2));
                 });
             },
             detected_of_two},
            {"scatter of " + name, axis == 2 ? 0.2 : 0.02, [axis](SimulatedRun& run, double size) {
                 misread_also(run, [=](Positions& q, std::size_t i) {
                     q[axis] += size * RandomStream(5, 6, i).normal();
                 });
             }}};
}

// The second axis leans towards the first.
inline InjectedKind squareness_kind(const SimulatedRun& run, std::size_t first,
                                    std::size_t second) {
    return {"stage squareness " + run.axes[first].name + run.axes[second].name, 2e-3,
            [=](SimulatedRun& wrong, double size) {
                Eigen::Vector3d& direction = wrong.true_axes[second].direction;
                direction = (direction + size * wrong.axes[first].direction).normalized();
            }};
}

inline std::vector<InjectedKind> run_kinds() {
    return {{"drift", 0.5,
             [](SimulatedRun& run, double size) {
                 const int poses = run.training + run.hold_out;
                 moved_also(run, [=](Rigid at, std::size_t i) {
                     at.translation +=
                         size * static_cast<double>(i) / poses * Eigen::Vector3d(0.6, 0.64, 0.48);
                     return at;
                 });
             },
             detected_of_three},
            {"pose 43 does not fit", 0.1,  // far more, and it is left out before causes are sought
             [](SimulatedRun& run, double size) {
                 misread_also(run, [=](std::vector<double>& q, std::size_t i) {
                     if (i == 43)
                         q[0] += size;
                 });
             },
             detected_pose},
            {"scatter of positions", 0.1, [](SimulatedRun& run, double size) {
                 moved_also(run, [=](Rigid at, std::size_t i) {
                     RandomStream random(7, 8, i);
                     for (double& coordinate : at.translation)
                         coordinate += size * random.normal();
                     return at;
                 });
             }}};
}

inline std::vector<InjectedKind> all_kinds() {
    const SimulatedRun run = demo_run();
    std::vector<InjectedKind> all = lens_kinds();
    const auto add = [&](const std::vector<InjectedKind>& more) {
        all.insert(all.end(), more.begin(), more.end());
    };
    add(marker_error_kinds());
    for (std::size_t axis = 0; axis < 3; ++axis)
        add(axis_kinds(axis, run.axes[axis].name));
    all.push_back(squareness_kind(run, 0, 1));
    all.push_back(squareness_kind(run, 0, 2));
    all.push_back(squareness_kind(run, 1, 2));
    add(run_kinds());
    return all;
}

inline Causes causes_of(SimulatedRun run, std::uint64_t seed) {
    run.look_for_causes = true;
    return qualify(input_of(run, seed)).causes.value();
}

}  // namespace etalon
