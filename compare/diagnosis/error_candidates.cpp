#include "compare/diagnosis/error_candidates.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <numbers>

#include "compare/diagnosis/pixel_evidence.h"

namespace etalon {
namespace {

// What to do about an error with a signature: its name says where it belongs.
std::string remedy_of(const std::string& name) {
    if (name.starts_with("stage direction") || name.starts_with("stage squareness"))
        return "measure the directions of the stage's axes: " + name;
    if (name.starts_with("stage"))
        return "look at the stage: " + name;
    if (name.starts_with("marker"))
        return "measure the marker: " + name;
    if (name == "edge shrink")
        return "look at exposure, tone curve and print: edges lie elsewhere than in the render";
    if (name == "half pixel")
        return "look at the convention of pixel centres in calibration and detector";
    return "calibrate the camera again: " + name;
}

// The corners' motion with the carriage at other places than it reads, stacked.
Eigen::VectorXd motion(const SignatureChain& chain, const std::vector<Rigid>& places,
                       const StageAxisMotion& axis) {
    return named_error(chain, StageError{axis.name, "", axis.step, places}).motion(places.size());
}

// `per_pose` numbers multiply what one step does to each pose's corners.
Eigen::VectorXd scaled(const Eigen::VectorXd& motion, const Eigen::VectorXd& per_pose) {
    const Eigen::Index rows = motion.size() / per_pose.size();
    Eigen::VectorXd column(motion.size());
    for (Eigen::Index i = 0; i < per_pose.size(); ++i)
        column.segment(i * rows, rows) = per_pose[i] * motion.segment(i * rows, rows);
    return column;
}

Eigen::VectorXd mapped(const std::vector<double>& values) {
    return Eigen::Map<const Eigen::VectorXd>(values.data(), std::ssize(values));
}

// Half of it each way from the middle of the two sides.
void add_backlash(std::vector<ErrorCandidate>& all, const StageAxisMotion& axis,
                  const Eigen::VectorXd& advanced) {
    if (axis.approach.size() != axis.position.size())
        return;
    Eigen::VectorXd side(std::ssize(axis.approach));
    for (Eigen::Index i = 0; i < side.size(); ++i)
        side[i] = -0.5 * axis.approach[static_cast<std::size_t>(i)];
    all.push_back({"backlash of " + axis.name, unit_of(axis),
                   "look at the stage's axis " + axis.name + ": backlash", axis.step,
                   scaled(advanced, side)});
}

// A bow of the guide: quadratic over the travel, two ways, as its height over the ends.
void add_straightness(std::vector<ErrorCandidate>& all, const SignatureChain& chain,
                      const StageAxisMotion& axis) {
    if (axis.aside[0].empty())
        return;
    const Eigen::VectorXd bow = 1.0 - normalised(axis.position).array().square();
    Eigen::MatrixXd columns(0, 2);
    for (int way = 0; way < 2; ++way) {
        const Eigen::VectorXd column =
            scaled(motion(chain, axis.aside[static_cast<std::size_t>(way)], axis), bow);
        columns.conservativeResize(column.size(), Eigen::NoChange);
        columns.col(way) = column;
    }
    all.push_back({"straightness of " + axis.name, "mm",
                   "look at the stage's axis " + axis.name + ": its guide is bent", axis.step,
                   columns});
}

void add_common_scale(std::vector<ErrorCandidate>& all, const CandidateRequest& request) {
    ErrorCandidate sum{"stage scale, all linear axes",
                       "1",
                       "look at the stage: scale of all linear axes",
                       1e-3,
                       {}};
    int linear = 0;
    for (const StageAxisMotion& axis : request.axes) {
        if (!axis.is_linear)
            continue;
        const Eigen::VectorXd column =
            scaled(sensitivity_px(request, axis), mapped(axis.position)) * (sum.size / axis.step);
        sum.corners_px =
            linear++ == 0 ? Eigen::MatrixXd(column) : Eigen::MatrixXd(sum.corners_px + column);
    }
    if (linear >= 2)
        all.push_back(std::move(sum));
}

// A shift in the camera's frame that grows with time, as its size from the first pose to the last.
void add_drift(std::vector<ErrorCandidate>& all, const CandidateRequest& request) {
    if (request.times_s.size() != request.chain.poses.size())
        return;
    const Eigen::VectorXd time = 0.5 * normalised(request.times_s);
    const auto rows = static_cast<Eigen::Index>(2 * request.chain.points_mm.size());
    ErrorCandidate drift{
        "drift", "mm",
        "look at what warms up or slips during the run: camera, stage and their mounts", 1.0,
        Eigen::MatrixXd(rows * time.size(), 3)};
    for (Eigen::Index i = 0; i < time.size(); ++i)
        drift.corners_px.middleRows(i * rows, rows) =
            time[i] * request.chain.pose_jacobian(static_cast<std::size_t>(i)).rightCols<3>();
    all.push_back(std::move(drift));
}

// What photographs tell of camera and light that corners hardly do.
struct PixelErrorCandidate {
    const char *name, *unit, *remedy;
    double size;
};
constexpr PixelErrorCandidate pixel_error_candidates[] = {
    {"f-number", "", "set the lens' aperture as in the calibration's file, or measure it again",
     0.1},
    {"focus distance", "1/mm",
     "set the lens' focus as in the calibration's file, or calibrate again", 1e-5},
    {"blur", "px^2", "look for vibration, motion during the exposure, and dirt on the lens", 0.1},
    {"tone curve", "", "set the camera's gamma as in the calibration's file, or characterise it",
     0.1},
    {"noise", "1", "look at the camera's gain: the noise is not the calibration's", 0.1},
    {"background", "gray", "state the station's background as it is", 1.0},
    {"black level", "gray", "look at the camera's black level, and at stray light", 1.0}};

// How a tone that lifts half tones moves the edges of dark parts: at half height by tone x blur /
// sqrt(pi), as the integral of Phi (1 - Phi) is 1 / sqrt(pi).
Eigen::VectorXd edges_by_tone(const CandidateRequest& request, const Eigen::VectorXd& shrunk,
                              double shrink_px, double size) {
    const CameraModel& camera = request.chain.projector.camera();
    std::vector<double> per_pose;
    for (std::size_t i = 0; i < request.chain.poses.size(); ++i) {
        const Rigid pose = request.chain.camera_from_marker(i);
        const double blur_px = blur_sigma_px(camera, depth_mm(camera.projection, pose.translation));
        per_pose.push_back(size / shrink_px * blur_px / std::sqrt(std::numbers::pi));
    }
    return scaled(shrunk, mapped(per_pose));
}

// Pixels: the errors by name, and what they do to corners.
void add_pixel_candidates(std::vector<ErrorCandidate>& all, const CandidateRequest& request) {
    const std::vector<std::string>& errors = request.pixel_errors;
    const auto row_of = [&](const std::string& name, double size) {
        Eigen::MatrixXd column = Eigen::MatrixXd::Zero(std::ssize(errors), 1);
        column(std::ranges::find(errors, name) - errors.begin(), 0) = size;
        return column;
    };
    const auto has = [&](const std::string& name) {
        return std::ranges::find(errors, name) != errors.end();
    };
    const auto shrink = std::ranges::find(all, "edge shrink", &ErrorCandidate::name);
    const ErrorCandidate edges = shrink != all.end() ? *shrink : ErrorCandidate{};
    if (shrink != all.end() && has("edge shrink"))
        shrink->pixels = row_of("edge shrink", shrink->size);
    const auto rows =
        static_cast<Eigen::Index>(2 * request.chain.points_mm.size() * request.chain.poses.size());
    for (const PixelErrorCandidate& each : pixel_error_candidates) {
        if (!has(each.name))
            continue;
        ErrorCandidate candidate{each.name,
                                 each.unit,
                                 each.remedy,
                                 each.size,
                                 Eigen::MatrixXd::Zero(rows, 1),
                                 row_of(each.name, each.size)};
        if (candidate.name == "tone curve" && edges.corners_px.size() > 0)
            candidate.corners_px =
                edges_by_tone(request, edges.corners_px, edges.size, candidate.size);
        all.push_back(std::move(candidate));
    }
}

}  // namespace

Eigen::VectorXd normalised(const std::vector<double>& of) {
    const Eigen::VectorXd positions = mapped(of);
    const double low = positions.minCoeff(), high = positions.maxCoeff();
    if (!(high > low))
        return Eigen::VectorXd::Zero(positions.size());
    return (2.0 * positions.array() - (low + high)) / (high - low);
}

const char* unit_of(const StageAxisMotion& axis) {
    return axis.is_linear ? "mm" : "rad";
}

std::vector<ErrorCandidate> error_candidates(const CandidateRequest& request,
                                             const std::map<std::string, double>& sizes) {
    const SignatureChain& chain = request.chain;
    const std::size_t poses = chain.poses.size();
    std::vector<ErrorCandidate> all;
    for (const auto& errors : {named_errors(chain, request.stage_errors), further_errors(chain)})
        for (const NamedError& error : errors) {
            const auto size = sizes.find(error.name);
            all.push_back({error.name, error.unit, remedy_of(error.name), error.size,
                           error.motion(poses, size == sizes.end() ? std::nullopt
                                                                   : std::optional(size->second))});
        }
    add_common_scale(all, request);
    for (const StageAxisMotion& axis : request.axes) {
        if (axis.position.size() != poses)
            throw NumericalError(
                fmt::format("error candidates: axis {} has {} positions for {} poses", axis.name,
                            axis.position.size(), poses));
        add_backlash(all, axis, sensitivity_px(request, axis));
        add_straightness(all, chain, axis);
    }
    add_drift(all, request);
    add_pixel_candidates(all, request);
    return all;
}

std::string misplaced_pose_name(int index) {
    return fmt::format("pose {} does not fit", index);
}

std::string misplaced_pose_remedy(const std::string& pose) {
    return "the stage was not where it said, the camera showed an old frame, or the detector "
           "slipped: " +
           pose;
}

std::vector<ErrorCandidate> misplaced_poses(const CandidateRequest& request) {
    const std::size_t poses = request.chain.poses.size();
    std::vector<ErrorCandidate> family;
    for (std::size_t i = 0; i < poses; ++i) {
        const int index = request.chain.poses[i].index;
        family.push_back({misplaced_pose_name(index), "mm",
                          misplaced_pose_remedy(fmt::format("pose {}", index)), 1.0,
                          request.chain.pose_jacobian(i).rightCols<3>()});
        family.back().tried = static_cast<int>(poses);
        family.back().only_pose = static_cast<int>(i);
    }
    return family;
}

std::vector<RandomErrorCandidate> random_error_candidates(const CandidateRequest& request) {
    const auto rows = static_cast<Eigen::Index>(2 * request.chain.points_mm.size());
    std::vector<RandomErrorCandidate> all;
    for (const StageAxisMotion& axis : request.axes) {
        const Eigen::VectorXd advance = sensitivity_px(request, axis) / axis.step;
        RandomErrorCandidate candidate{
            "scatter of " + axis.name,
            unit_of(axis),
            "look at the stage's axis " + axis.name + ": where it stops scatters",
            {}};
        for (Eigen::Index i = 0; i < advance.size(); i += rows)
            candidate.corners_px.emplace_back(advance.segment(i, rows));
        all.push_back(std::move(candidate));
    }
    RandomErrorCandidate everywhere{"scatter of positions",
                                    "mm",
                                    "look at what vibrates or is loose: camera, stage, marker",
                                    {}};
    for (std::size_t i = 0; i < request.chain.poses.size(); ++i)
        everywhere.corners_px.emplace_back(request.chain.pose_jacobian(i).rightCols<3>());
    all.push_back(std::move(everywhere));
    return all;
}

Eigen::VectorXd sensitivity_px(const CandidateRequest& request, const StageAxisMotion& axis) {
    return motion(request.chain, axis.advanced, axis);
}

ErrorCandidate repeating_error(const StageAxisMotion& axis, const Eigen::VectorXd& sensitivity_px,
                               const std::vector<double>& periods, int tried) {
    const Eigen::ArrayXd phase =
        2.0 * std::numbers::pi / periods.front() * mapped(axis.position).array();
    Eigen::MatrixXd columns(sensitivity_px.size(), 2);
    columns << scaled(sensitivity_px, phase.sin()), scaled(sensitivity_px, phase.cos());
    std::vector<std::string> shown;
    for (const double period : periods)
        shown.push_back(axis.is_linear
                            ? fmt::format("{:.3g} mm", period)
                            : fmt::format("{:.3g} deg", period * 180.0 / std::numbers::pi));
    const std::string every = fmt::format("{}", fmt::join(shown, " or "));
    return {fmt::format("{} repeats with a period of {}", axis.name, every),
            unit_of(axis),
            fmt::format("look at the stage's axis {}: an error that repeats every {}", axis.name,
                        every),
            axis.step,
            columns,
            {},
            tried};
}

}  // namespace etalon
