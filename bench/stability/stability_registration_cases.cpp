// Registration of stages that cannot determine all of X and Y, of plans that hardly do, and of
// plans that do not: each must be told apart and named. No renderer is asked; pixels are exact.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "bench/stability/stability_case.h"
#include "calib/registration/stage_motion.h"
#include "compare/diagnosis/error_signatures.h"
#include "core/geometry/units.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

using Names = std::vector<std::string>;
using Points = std::vector<Eigen::Vector3d>;

constexpr int training = 25, hold_out = 20;

const Points tag = {{-40, -40, 0}, {40, -40, 0}, {40, 40, 0}, {-40, 40, 0}};
const Rigid true_x{rotation_from_vector({0.05, -0.09, 0.03}), {11.0, -7.0, 520.0}};
const Rigid true_y{rotation_from_vector({0.35, 0.06, -0.11}), {5.0, -13.0, 17.0}};

CameraModel wide_camera() {
    return camera_without_lens(640, 480, {540.0, 536.0, 322.0, 235.0}, {.k1 = -0.28, .k2 = 0.07});
}

// How far each axis goes, mm and rad; the linear ones carry the rotary ones.
struct Reach {
    double x = 0, y = 0, z = 0, rx = 0, ry = 0, rz = 0;
};
constexpr Reach xyz{90, 70, 110, 0, 0, 0};
constexpr Reach six_axes{90, 70, 110, 0.4, 0.3, 3.0};

std::vector<Rigid> stage_poses(const Reach& reach, int count) {
    std::vector<Rigid> poses;
    for (int i = 0; i < count; ++i) {
        RandomStream random(5, 1, static_cast<std::uint64_t>(i));
        const auto within = [&](double limit) { return limit * (2.0 * random.uniform() - 1.0); };
        const double x = within(reach.x), y = within(reach.y), z = within(reach.z);
        Rigid pose{Eigen::Quaterniond::Identity(), {x, y, z}};
        for (const Eigen::Vector3d& turn :
             {Eigen::Vector3d(within(reach.rx), 0, 0), Eigen::Vector3d(0, within(reach.ry), 0),
              Eigen::Vector3d(0, 0, within(reach.rz))})
            pose.rotation = pose.rotation * rotation_from_vector(turn);
        poses.push_back(pose);
    }
    return poses;
}

// Exact pixels; first estimates that are off by a degree and some millimetres.
std::vector<RegistrationPose> seen(const Projector& projector, const std::vector<Rigid>& stage) {
    const Vector6d wrong = (Vector6d() << 0.01, -0.02, 0.015, 2.0, -3.0, 1.5).finished();
    std::vector<RegistrationPose> poses;
    for (const Rigid& base_from_carriage : stage) {
        const Rigid camera_from_marker = true_x * base_from_carriage * true_y;
        RegistrationPose pose{base_from_carriage, left_perturbed(camera_from_marker, wrong), {}};
        for (const Eigen::Vector3d& point : tag)
            pose.pixels.push_back(projector.project(camera_from_marker * point).value());
        poses.push_back(pose);
    }
    return poses;
}

Registration registered(const Projector& projector, const Reach& reach, const Rigid& nominal) {
    return register_stage(projector, tag, seen(projector, stage_poses(reach, training)), nominal);
}

// px at any of the poses for 1 mm or 1 rad along the freedom.
double largest_px(const Projector& projector, const Registration& result,
                  const std::vector<Rigid>& stage) {
    double largest = 0.0;
    for (const Rigid& pose : stage) {
        const auto jacobian = registration_jacobian(projector, tag, result.camera_from_base, pose,
                                                    result.carriage_from_marker);
        for (const GaugeFreedom& freedom : result.freedoms)
            largest = std::max(largest, (jacobian * freedom.direction).norm());
    }
    return largest;
}

// How far the prediction is off at poses that were not used, mm and rad: the prior must not matter.
double largest_error(const Registration& result, const std::vector<Rigid>& stage) {
    double largest = 0.0;
    for (const Rigid& pose : stage) {
        const Rigid truth = true_x * pose * true_y;
        largest = std::max(largest, left_difference(result.camera_from_marker(pose), truth).norm());
    }
    return largest;
}

StabilityOutcome finds_freedoms(const Reach& reach, const Names& expected) {
    const Projector projector(wide_camera());
    const Rigid prior =
        left_perturbed(true_y, (Vector6d() << 0.1, -0.05, 0.2, 20.0, 30.0, -10.0).finished());
    const Registration result = registered(projector, reach, prior);
    Names found;
    for (const GaugeFreedom& freedom : result.freedoms)
        found.push_back(freedom.name);
    const std::vector<Rigid> others = stage_poses(reach, training + hold_out);
    StabilityOutcome outcome = at_most(
        1e-6, std::max(largest_px(projector, result, others), largest_error(result, others)),
        fmt::format("rank {}, condition number {:.3g}; free: {}", result.rank,
                    result.condition_number, fmt::join(found, ", ")));
    outcome.passed &= found == expected && result.rank == 12 - std::ssize(expected);
    return outcome;
}

std::string shift(char axis) {
    return fmt::format("shift along base {} between X and Y", axis);
}
std::string rotation(char axis) {
    return fmt::format("rotation about base {} between X and Y", axis);
}

// Turns of 2 degrees, on a stage that is free to shift: hardly determined.
StabilityOutcome labels_small_turns(const Reach& reach, const Names& expected) {
    const Registration result = registered(Projector(wide_camera()), reach, true_y);
    StabilityOutcome outcome{.bound = 1.0};
    Names found;
    for (const PoorlyConstrainedDirection& weak : result.weak) {
        found.push_back(weak.name);
        outcome.figure = std::max(outcome.figure, weak.worth_poses);
        outcome.words += fmt::format("{}: {:.2g} {} at 1 px; ", weak.name, weak.deviation,
                                     weak.is_shift() ? "mm" : "rad");
    }
    std::sort(found.begin(), found.end());
    outcome.passed = found == expected;
    return outcome;
}

StabilityOutcome names_degenerate(const std::vector<Rigid>& plan, const std::string& word) {
    try {
        require_full_motion(plan, stage_poses(six_axes, training));
        register_stage(Projector(wide_camera()), tag, seen(Projector(wide_camera()), plan), true_y);
    } catch (const NumericalError& refusal) {
        const std::string words = refusal.what();
        return {.passed = words.find(word) != std::string::npos, .words = words};
    }
    return {.figure = 1.0, .words = "registered all the same"};
}

// The scale of axis k stretches the stage's shifts along it.
StageError scale_error(int axis, std::vector<Rigid> poses) {
    for (Rigid& pose : poses)
        pose.translation[axis] *= 1.0 + 1e-4;
    return {fmt::format("stage scale {}", "xyz"[axis]), "1", 1e-4, poses, true};
}

// 1 - |cosine| of what two errors leave on the hold-out poses of an XYZ stage.
StabilityOutcome confounded(const CameraModel& camera, const Rigid& x, const Rigid& y,
                            const std::string& one, const std::string& two) {
    const Projector projector(camera);
    const std::vector<Rigid> poses = stage_poses(xyz, training + hold_out);
    SignatureChain chain{projector, tag, x, y, {}};
    for (std::size_t i = 0; i < poses.size(); ++i) {
        chain.poses.emplace_back().hold_out = i >= training;
        chain.poses.back().base_from_carriage = poses[i];
    }
    const std::vector<StageError> scales = {scale_error(0, poses), scale_error(1, poses),
                                            scale_error(2, poses)};
    const HoldOutNoise noise{std::vector<double>(hold_out, 0.05),
                             std::vector<double>(hold_out, 0.005)};
    const std::vector<ErrorSignature> all = error_signatures(chain, scales, noise, 0.1);
    const ErrorSignature& a = *std::ranges::find(all, one, &ErrorSignature::name);
    const ErrorSignature& b = *std::ranges::find(all, two, &ErrorSignature::name);
    const double cosine = a.after.dot(b.after) / (a.after.norm() * b.after.norm());
    const bool listed = std::ranges::find(a.confounded_with, two) != a.confounded_with.end();
    constexpr double bound = 1e-6;
    const double figure = 1.0 - std::abs(cosine);
    return {listed && figure <= bound, figure, bound,
            fmt::format("{} is confounded with: {}", one, fmt::join(a.confounded_with, ", "))};
}

StabilityOutcome refuses(double number) {
    const Projector projector(wide_camera());
    const std::vector<RegistrationPose> good = seen(projector, stage_poses(xyz, 8));
    StabilityOutcome outcome{.passed = true};
    const auto attempt = [&](const std::string& what,
                             const std::function<void(RegistrationPose&)>& damage) {
        std::vector<RegistrationPose> poses = good;
        damage(poses[3]);
        try {
            register_stage(projector, tag, poses, true_y);
            outcome.figure += 1.0;
            outcome.words += "accepted: " + what + " ";
            outcome.passed = false;
        } catch (const NumericalError&) {
        }
    };
    attempt("pixel", [=](RegistrationPose& p) { p.pixels[2].x() = number; });
    attempt("stage", [=](RegistrationPose& p) { p.base_from_carriage.translation.y() = number; });
    attempt("turn", [=](RegistrationPose& p) { p.base_from_carriage.rotation.x() = number; });
    attempt("estimate",
            [=](RegistrationPose& p) { p.camera_from_marker.translation.z() = number; });
    attempt("sigma", [=](RegistrationPose& p) { p.sigma_px = number; });
    return outcome;
}

}  // namespace

std::vector<StabilityCase> registration_cases() {
    std::vector<StabilityCase> cases;
    const auto add = [&](const std::string& name, const std::string& expectation,
                         const std::function<StabilityOutcome()>& run) {
        cases.push_back(without_render("registering: " + name, expectation, run));
    };
    const auto add_freedoms = [&](const std::string& name, const Reach& reach, const Names& names) {
        add(name, "named, px that move", [=] { return finds_freedoms(reach, names); });
    };
    add_freedoms("x, 4 free", {.x = 90}, {shift('x'), shift('y'), shift('z'), rotation('x')});
    add_freedoms("rz, 2 free", {.rz = 3}, {shift('z'), rotation('z')});
    add_freedoms("xyz, 3 free", xyz, {shift('x'), shift('y'), shift('z')});
    add_freedoms("xyz + rz, 1 free", {90, 70, 110, 0, 0, 3}, {shift('z')});
    add_freedoms("rx + rz, none free", {.rx = 0.4, .rz = 3}, {});
    add_freedoms("six axes, none free", six_axes, {});

    constexpr double small = 2.0 * rad_per_deg;
    add("rz of +-2 degrees", "labelled, poses' worth", [] {
        return labels_small_turns({90, 70, 110, 0, 0, small}, {shift('x'), shift('y')});
    });
    add("rz, rx of +-2 deg", "labelled, poses' worth", [] {
        return labels_small_turns({.rx = small, .rz = 3.0}, {rotation('z'), shift('z')});
    });

    const auto add_degenerate = [&](const std::string& name, const std::vector<Rigid>& plan,
                                    const std::string& word) {
        add(name, "named, not solved", [=] { return names_degenerate(plan, word); });
    };
    const std::vector<Rigid> some = stage_poses(six_axes, training);
    std::vector<Rigid> two;
    for (std::size_t i = 0; i < training; ++i)
        two.push_back(some[i % 2]);
    add_degenerate("all poses identical", std::vector<Rigid>(training, some[0]), "no motion");
    add_degenerate("two poses", two, "2 distinct poses");
    add_degenerate("three poses", {some[0], some[1], some[2]}, "3 distinct poses");
    add_degenerate("collinear", stage_poses({.y = 70}, training), "one line, base y");
    add_degenerate("planar shifts", stage_poses({.x = 90, .z = 110}, training),
                   "plane across base y");
    add_degenerate("planar motion", stage_poses({.x = 90, .y = 70, .rz = 3}, training),
                   "planar motion");
    add_degenerate("one axis' turns", stage_poses({.rx = 0.4}, training), "one fixed axis");

    // Exact where all of the marker is equally deep and the axis z is the line of sight.
    add("f ~ scale of z", "1 - |cosine|", [] {
        CameraModel camera = wide_camera();
        camera.distortion = {};
        const Rigid frontal{rotation_from_vector({0, 0, 0.3}), {5.0, -13.0, 17.0}};
        const Rigid along_z{rotation_from_vector({0, 0, 0.2}), {11.0, -7.0, 520.0}};
        return confounded(camera, along_z, frontal, "focal length", "stage scale z");
    });
    // Both scale the scene, whatever the camera.
    add("print ~ all scales", "1 - |cosine|", [] {
        return confounded(wide_camera(), true_x, true_y, "marker print size",
                          "stage scale, all linear axes");
    });
    add("nan", "number accepted", [] { return refuses(std::numeric_limits<double>::quiet_NaN()); });
    add("infinity", "number accepted", [] { return refuses(infinity); });
    return cases;
}

}  // namespace etalon
