#include "station/planning/simulated_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "compare/expect/expected_view.h"
#include "core/program/errors.h"
#include "core/statistics/random.h"
#include "stage/axes/kinematics.h"
#include "station/register/qualification_input.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

using Corners = std::vector<Eigen::Vector2d>;

// Streams of the random numbers (core/statistics/random.h): one for the whole run, one per pose and
// one per render.
constexpr std::uint32_t run_stream = 0, first_pose_stream = 1, first_render_stream = 1u << 31;

void require_camera_mount(const StationFile& station) {
    if (!station.camera_from_base_nominal)
        throw ConfigError(
            {station.inputs.empty() ? "" : station.inputs.front().path.string(), 0, "camera_mount"},
            "is needed to say what the camera will see: rotation_deg and "
            "translation_mm of the stage's base before the camera, as drawn");
}

// The poses as they will be read: at the targets, with the declared noise of the mean of the
// readings (one after settling and one after each frame).
std::vector<VisitedPose> planned_visits(const StationFile& station, const Plan& plan) {
    std::vector<double> uncertainty;
    for (const Axis& axis : station.stage.axes)
        uncertainty.push_back(axis.read_noise.value_or(0.0) / std::sqrt(station.plan.frames + 1.0));
    std::vector<VisitedPose> poses(plan.poses.begin(), plan.poses.end());
    for (VisitedPose& pose : poses) {
        pose.read_back = pose.target;
        pose.settled_s = static_cast<double>(pose.index);  // in equal steps: nothing drifts
        pose.read_back_uncertainty = uncertainty;
        pose.base_from_carriage = base_from_carriage(station.stage.axes, pose.target);
    }
    return poses;
}

// Where a stage error of this size leaves the carriage: left perturbation of its pose.
Vector6d stage_shift(const Rigid& base_from_carriage, const StageError& error, std::size_t pose,
                     double size) {
    return size / error.size *
           left_difference(base_from_carriage, error.base_from_carriage.at(pose));
}

void scale(std::vector<Eigen::Vector3d>& points, double factor) {
    for (Eigen::Vector3d& point : points)
        point *= factor;
}

// Out of the plane, by `size` at the point where the shape is highest.
void bend(std::vector<Eigen::Vector3d>& points, double (*shape)(const Eigen::Vector3d&),
          double size) {
    double highest = 0.0;
    for (const Eigen::Vector3d& point : points)
        highest = std::max(highest, std::abs(shape(point)));
    for (Eigen::Vector3d& point : points)
        point.z() += highest > 0.0 ? size * shape(point) / highest : 0.0;
}

double twist(const Eigen::Vector3d& point) {
    return point.x() * point.y();
}

double bow(const Eigen::Vector3d& point) {
    return point.head<2>().squaredNorm();
}

// The shift is that from the told poses, whatever else the truth has already.
InjectedError stage_injection(const StageError& error, const std::vector<VisitedPose>& told) {
    std::vector<Vector6d> shifts;
    for (std::size_t i = 0; i < told.size(); ++i)
        shifts.push_back(stage_shift(told[i].base_from_carriage, error, i, 1.0));
    return {error.name, error.unit, error.size, [shifts](RunTruth& truth, double size) {
                for (std::size_t i = 0; i < truth.base_from_carriage.size(); ++i) {
                    Rigid& pose = truth.base_from_carriage[i];
                    pose = left_perturbed(pose, size * shifts.at(i));
                }
            }};
}

std::vector<InjectedError> camera_injections(const CameraModel& calibration) {
    std::vector<InjectedError> errors;
    for (const CameraError& error : named_camera_errors(calibration))
        errors.push_back({error.name, error.unit, error.size,
                          [change = error.change](RunTruth& truth, double size) {
                              CameraModel camera = truth.camera.camera();
                              change(camera, size);
                              truth.camera = Projector(camera);
                          }});
    return errors;
}

std::vector<InjectedError> marker_injections(bool is_single_tag) {
    std::vector<InjectedError> errors;
    errors.push_back({"marker print size", "1", 1e-3,
                      [](RunTruth& truth, double size) { scale(truth.points_mm, 1.0 + size); }});
    errors.push_back({"marker twist", "mm", 0.1,
                      [](RunTruth& truth, double size) { bend(truth.points_mm, twist, size); }});
    if (!is_single_tag)  // whose corners a bow lifts all alike
        errors.push_back({"marker bow", "mm", 0.1,
                          [](RunTruth& truth, double size) { bend(truth.points_mm, bow, size); }});
    errors.push_back({"half pixel", "px", 0.5, [](RunTruth& truth, double size) {
                          truth.corner_shift_px += Eigen::Vector2d(size, size);
                      }});
    if (is_single_tag)
        errors.push_back({"edge shrink", "px", 0.1,
                          [](RunTruth& truth, double size) { truth.edges_inwards_px += size; }});
    errors.push_back({"constant pose offset", "mm", 0.1, [](RunTruth& truth, double size) {
                          truth.camera_from_base.translation += size * pose_offset_direction();
                      }});
    return errors;
}

void add(const Eigen::VectorXd& displacement, Corners& corners) {
    for (std::size_t i = 0; i < corners.size(); ++i)
        corners[i] += displacement.segment<2>(static_cast<Eigen::Index>(2 * i));
}

Eigen::VectorXd deviates(Eigen::Index count, RandomStream& random) {
    Eigen::VectorXd values(count);
    for (double& value : values)
        value = random.normal();
    return values;
}

// Of a single frame's corners.
Eigen::VectorXd frame_noise(const DetectorStatistics& pose, RandomStream& random) {
    return pose.noise_factor * deviates(pose.noise_factor.cols(), random);
}

struct FramesNoise {
    Eigen::VectorXd mean;                // of the frames' corners, px
    std::optional<CornerNoise> of_mean;  // as a run tells it: from how far the frames are apart
};

// As renders with the calibration's noise tell it, of the mean over the frames.
CornerNoise stated_noise(const DetectorStatistics& pose, int frames) {
    const auto coordinates = static_cast<double>(pose.bias.size());
    return {pose.noise_factor.squaredNorm() / coordinates / frames,
            (pose.frames - 1.0) * coordinates};
}

FramesNoise noise_of_frames(const DetectorStatistics& pose, int frames, RandomStream& random) {
    Eigen::MatrixXd each(pose.bias.size(), frames);
    for (Eigen::Index i = 0; i < frames; ++i)
        each.col(i) = frame_noise(pose, random);
    FramesNoise noise{each.rowwise().mean(), std::nullopt};
    if (frames < 2)
        return noise;
    const double freedom = (frames - 1.0) * static_cast<double>(pose.bias.size());
    const double squares = (each.colwise() - noise.mean).squaredNorm();
    noise.of_mean = CornerNoise{squares / freedom / frames, freedom};
    return noise;
}

// What the true camera sees of the true marker, without the detector.
Corners seen(const RunTruth& truth, const Rigid& base_from_carriage,
             const std::vector<Eigen::Vector3d>& points_mm) {
    const Rigid camera_from_marker =
        truth.camera_from_base * base_from_carriage * truth.carriage_from_marker;
    Corners corners;
    for (const Eigen::Vector3d& point : points_mm) {
        const auto pixel = truth.camera.project(camera_from_marker * point);
        if (!pixel)
            throw NumericalError("simulated run: the true camera does not see the marker");
        corners.push_back(*pixel + truth.corner_shift_px);
    }
    return corners;
}

}  // namespace

std::vector<Rigid> expected_poses(const StationFile& station, const Plan& plan) {
    require_camera_mount(station);
    std::vector<Rigid> poses;
    for (const PlannedPose& pose : plan.poses)
        poses.push_back(expected_pose(station, pose.target));
    return poses;
}

// What one run draws.
struct RunSimulator::Draws {
    std::uint64_t seed, run;
    std::vector<Eigen::Vector3d> points_mm;  // of the marker
    std::vector<double> term_sizes;          // of declared_.stage_terms
};

RunSimulator::RunSimulator(const StationFile& station, const Plan& plan, DetectorStudy study)
    : station_(station),
      plan_(plan),
      study_(std::move(study)),
      told_(station_.camera.model),
      expected_(expected_poses(station_, plan_)),
      gap_(backlash()),
      declared_(declared_input(station_, planned_visits(station_, plan_))) {
    if (study_.poses.size() != plan_.poses.size())
        throw NumericalError(fmt::format("simulated run: a study of {} poses for a plan of {}",
                                         study_.poses.size(), plan_.poses.size()));
}

// Half the lost motion up where an axis came from above, half down where it came from below; an
// axis that did not move stays where it was in its gap.
std::vector<std::vector<double>> RunSimulator::backlash() const {
    const std::vector<Axis>& axes = station_.stage.axes;
    std::vector<std::vector<double>> gap;
    std::vector<double> at(axes.size(), 0.0);
    for (std::size_t i = 0; i < plan_.poses.size(); ++i) {
        const std::vector<MotionSegment>& leg = plan_.legs.at(i);
        for (std::size_t k = 0; k < axes.size(); ++k) {
            for (const MotionSegment& segment : leg)
                if (segment.to[k] != segment.from[k])
                    at[k] = (segment.to[k] > segment.from[k] ? -0.5 : 0.5) * axes[k].backlash;
        }
        gap.push_back(at);
    }
    return gap;
}

RunTruth RunSimulator::as_told() const {
    RunTruth truth{told_,
                   *station_.camera_from_base_nominal,
                   station_.carriage_from_marker_nominal,
                   {},
                   station_.marker.points_mm};
    for (const VisitedPose& pose : declared_.poses)
        truth.base_from_carriage.push_back(pose.base_from_carriage);
    return truth;
}

std::vector<InjectedError> RunSimulator::errors() const {
    std::vector<InjectedError> errors = camera_injections(*declared_.camera);
    for (InjectedError& error : marker_injections(station_.marker.points_mm.size() == 4))
        errors.push_back(std::move(error));
    std::vector<InjectedError> linear;
    for (const DeclaredStageTerm& term : declared_.stage_terms) {
        errors.push_back(stage_injection(term.error, declared_.poses));
        if (term.is_linear_scale)
            linear.push_back(errors.back());
    }
    if (linear.size() >= 2)
        errors.push_back(
            {"stage scale, all linear axes", "1", 1e-3, [linear](RunTruth& truth, double size) {
                 for (const InjectedError& one : linear)
                     one.apply(truth, size);
             }});
    return errors;
}

// As a render of this pose shows it to the detector, its noise that of the mean of all exposures.
Corners RunSimulator::detector_bias(const Draws* draws, std::size_t pose) const {
    const DetectorStatistics& statistics = *study_.poses[pose];
    Eigen::VectorXd bias = statistics.bias + statistics.noise_bias;
    if (draws) {
        RandomStream random(draws->seed, first_render_stream + static_cast<std::uint32_t>(pose),
                            draws->run);
        bias += frame_noise(statistics, random) /
                std::sqrt(RenderedCorners::exposures_per_frame * station_.plan.frames);
    }
    Corners corners(station_.marker.points_mm.size(), Eigen::Vector2d::Zero());
    add(bias, corners);
    return corners;
}

// How far the carriage is from where the truth has it: left perturbation.
Vector6d RunSimulator::drawn_shift(const Draws& draws, std::size_t pose,
                                   RandomStream& random) const {
    const Rigid& told = declared_.poses[pose].base_from_carriage;
    Vector6d shift = Vector6d::Zero();
    for (std::size_t i = 0; i < draws.term_sizes.size(); ++i)
        if (draws.term_sizes[i] != 0.0)
            shift += stage_shift(told, declared_.stage_terms[i].error, pose, draws.term_sizes[i]);
    const std::vector<Axis>& axes = station_.stage.axes;
    const double readings = station_.plan.frames + 1.0;  // after settling and after each frame
    std::vector<double> position = plan_.poses[pose].target;
    for (std::size_t k = 0; k < axes.size(); ++k)
        position[k] += gap_[pose][k] + axes[k].repeatability.value_or(0.0) * random.normal() +
                       axes[k].read_noise.value_or(0.0) / std::sqrt(readings) * random.normal();
    return shift + left_difference(told, base_from_carriage(axes, position));
}

// Sets the pose's corners, what its frames tell of their noise, and the detector's bias.
void RunSimulator::photograph(const RunTruth& truth, const Draws* draws, std::size_t index,
                              VisitedPose& pose) const {
    const auto& statistics = study_.poses[index];
    if (!statistics)
        return;
    Rigid base_from_carriage = truth.base_from_carriage.at(index);
    Eigen::VectorXd displacement = statistics->bias + statistics->noise_bias;
    if (draws) {
        RandomStream random(draws->seed, first_pose_stream + static_cast<std::uint32_t>(index),
                            draws->run);
        base_from_carriage = left_perturbed(base_from_carriage, drawn_shift(*draws, index, random));
        const FramesNoise noise = noise_of_frames(*statistics, station_.plan.frames, random);
        displacement += noise.mean;
        pose.corner_noise = noise.of_mean;
        pose.stated_noise = stated_noise(*statistics, station_.plan.frames);
    }
    // What the pixels show is not what a detector that slips makes of them.
    pose.seen_at = truth.camera_from_base * base_from_carriage * truth.carriage_from_marker;
    Corners corners = seen(truth, base_from_carriage, draws ? draws->points_mm : truth.points_mm);
    if (truth.edges_inwards_px != 0.0)
        corners = edges_moved_inwards(corners, truth.edges_inwards_px);
    add(displacement, corners);
    pose.corners = corners;
    pose.detector_bias_px = detector_bias(draws, index);
}

QualificationInput RunSimulator::input(const RunTruth& truth, const Draws* draws) const {
    QualificationInput input = declared_;
    for (std::size_t i = 0; i < input.poses.size(); ++i)
        photograph(truth, draws, i, input.poses[i]);
    input.expected_poses = expected_;
    return input;
}

QualificationInput RunSimulator::exact(const RunTruth& truth) const {
    return input(truth, nullptr);
}

QualificationInput RunSimulator::draw(const RunTruth& truth, std::uint64_t seed,
                                      std::uint64_t run) const {
    RandomStream random(seed, run_stream, run);
    const DeclaredTemperature temperature = declared_.temperature.value_or(DeclaredTemperature{});
    const double kelvin = temperature.standard_uncertainty_k * random.normal();
    Draws draws{seed, run, truth.points_mm, {}};
    scale(draws.points_mm, 1.0 + declared_.marker_size_uncertainty.value_or(0.0) * random.normal() +
                               temperature.marker_expansion_per_k * kelvin);
    const double flatness_mm = declared_.marker_flatness_mm.value_or(0.0);
    bend(draws.points_mm, twist, flatness_mm * random.normal());
    if (draws.points_mm.size() != 4)
        bend(draws.points_mm, bow, flatness_mm * random.normal());
    for (const DeclaredStageTerm& term : declared_.stage_terms) {
        const double drawn =
            term.in_budget ? term.standard_uncertainty.value_or(0.0) * random.normal() : 0.0;
        const double expansion =
            term.is_linear_scale ? temperature.stage_expansion_per_k * kelvin : 0.0;
        draws.term_sizes.push_back(drawn + expansion);
    }
    QualificationInput drawn = input(truth, &draws);
    drawn.options.seed = seed + run;
    return drawn;
}

namespace {

void require_noise(const StationFile& station) {
    const auto& sensor = station.camera.model.sensor;
    if (!sensor || !(sensor->gain_e_per_dn > 0.0))
        throw ConfigError({station.inputs.at(1).path.string(), 0, "sensor.gain_e_per_dn"},
                          "is needed: without the sensor's noise nothing can be said of a run's "
                          "uncertainty (`etalon characterise` measures it)");
}

}  // namespace

StudiedPlan study_plan(const std::filesystem::path& path, int noisy_frames) {
    StudiedPlan studied;
    studied.station = read_station(path);
    const StationFile& station = studied.station;
    studied.plan = plan_of(station);
    require_noise(station);
    const std::vector<Rigid> poses = expected_poses(station, studied.plan);
    StderrProgress progress;
    progress.begin("rendering", static_cast<int>(poses.size()),
                   poses.size() * noisy_frames * std::chrono::milliseconds(12));
    DetectorStudy study = study_detector(expected_scene(station), poses, noisy_frames,
                                         station.plan.seed, [&] { progress.count(); });
    progress.end();
    studied.simulator =
        std::make_unique<const RunSimulator>(station, studied.plan, std::move(study));
    return studied;
}

DetectorFigures figures_of(const DetectorStudy& study) {
    const auto seen = std::count_if(study.poses.begin(), study.poses.end(),
                                    [](const auto& pose) { return pose.has_value(); });
    return {study.noise_px, study.bias_px,          study.noise_bias_px,
            study.frames,   static_cast<int>(seen), static_cast<int>(study.poses.size())};
}

std::string detector_text(const DetectorFigures& detector) {
    return fmt::format(
        "the marker is detected in {} of {} poses ({} noisy renders of each)\n"
        "corner noise {:.4f} px a frame; the detector's bias {:.4f} px, of which noise moves {:.4f}"
        " px\n",
        detector.seen, detector.poses, detector.frames, detector.noise_px, detector.bias_px,
        detector.noise_bias_px);
}

std::string size_text(double size, const std::string& unit) {
    if (!std::isfinite(size))
        return "-";
    if (unit == "1")
        return std::abs(size) < 1e-3 ? fmt::format("{:.3g} ppm", 1e6 * size)
                                     : fmt::format("{:.3g} %", 100.0 * size);
    if (unit == "rad")
        return fmt::format("{:.3g} mrad", 1e3 * size);
    return unit.empty() ? fmt::format("{:.3g}", size) : fmt::format("{:.3g} {}", size, unit);
}

}  // namespace etalon
