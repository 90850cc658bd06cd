#include "station/planning/simulated_run.h"

#include <fmt/format.h>

#include "stage/axes/kinematics.h"
#include "station/register/qualification_input.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

using Corners = std::vector<Eigen::Vector2d>;

// Streams of random numbers (core/statistics/random.h): of the run, of a pose, of a render.
constexpr std::uint32_t run_stream = 0, first_pose_stream = 1, first_render_stream = 1u << 31;

// At the targets, with the declared noise of the mean of a reading more than there are frames.
std::vector<VisitedPose> planned_visits(const StationFile& station, const Plan& plan) {
    std::vector<double> uncertainty;
    for (const Axis& axis : station.stage.axes)
        uncertainty.push_back(axis.read_noise.value_or(0.0) / std::sqrt(station.plan.frames + 1.0));
    std::vector<VisitedPose> poses;
    for (const PlannedPose& planned : plan.poses) {
        VisitedPose& pose = poses.emplace_back(VisitedPose{planned});
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

// `change` as one of the whole truth.
template <class Changed, class Change>
InjectedError injected(const ChangingError<Changed>& error, const Change& change) {
    return {error.name, error.unit, error.size, change};
}

// The shift is that from the told poses, whatever else the truth has already.
InjectedError injected(const StageError& error, const std::vector<VisitedPose>& told) {
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

void add(const Eigen::VectorXd& displacement, Corners& corners) {
    for (std::size_t i = 0; i < corners.size(); ++i)
        corners[i] += displacement.segment<2>(static_cast<Eigen::Index>(2 * i));
}

Eigen::VectorXd frame_noise(const DetectorStatistics& pose, RandomStream& random) {
    Eigen::VectorXd deviates(pose.noise_factor.cols());
    for (double& value : deviates)
        value = random.normal();
    return pose.noise_factor * deviates;
}

// Mean noise of the frames' corners, px. The pose gets what its frames and the renders tell of it.
Eigen::VectorXd mean_frame_noise(const DetectorStatistics& statistics, int frames,
                                 RandomStream& random, VisitedPose& pose) {
    const auto coordinates = static_cast<double>(statistics.bias.size());
    pose.stated_noise = CornerNoise{statistics.noise_factor.squaredNorm() / coordinates / frames,
                                    (statistics.frames - 1.0) * coordinates};
    Eigen::MatrixXd each(statistics.bias.size(), frames);
    for (Eigen::Index i = 0; i < frames; ++i)
        each.col(i) = frame_noise(statistics, random);
    const Eigen::VectorXd mean = each.rowwise().mean();
    const double freedom = (frames - 1.0) * coordinates;
    if (frames > 1)
        pose.corner_noise =
            CornerNoise{(each.colwise() - mean).squaredNorm() / freedom / frames, freedom};
    return mean;
}

}  // namespace

std::vector<Rigid> expected_poses(const StationFile& station, const Plan& plan) {
    if (!station.camera_from_base_nominal)
        throw ConfigError(
            {station.inputs.empty() ? "" : station.inputs.front().path.string(), 0, "camera_mount"},
            "is needed to say what the camera will see: rotation_deg and "
            "translation_mm of the stage's base before the camera, as drawn");
    std::vector<Rigid> poses;
    for (const PlannedPose& pose : plan.poses)
        poses.push_back(expected_pose(station, pose.target));
    return poses;
}

struct RunSimulator::Draws {
    std::uint64_t seed, run;
    TrueMarker marker;
    std::vector<double> term_sizes;  // of declared_.stage_terms
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

// Half the backlash up where an axis came from above, half down where it came from below; an
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
                   {station_.marker.points_mm}};
    for (const VisitedPose& pose : declared_.poses)
        truth.base_from_carriage.push_back(pose.base_from_carriage);
    return truth;
}

std::vector<InjectedError> RunSimulator::errors() const {
    std::vector<InjectedError> errors, linear;
    for (const CameraError& error : named_camera_errors(*declared_.camera))
        errors.push_back(injected(error, [change = error.change](RunTruth& truth, double size) {
            CameraModel camera = truth.camera.camera();
            change(camera, size);
            truth.camera = Projector(camera);
        }));
    for (const MarkerError& error : marker_errors(station_.marker.points_mm.size()))
        errors.push_back(injected(error, [change = error.change](RunTruth& truth, double size) {
            change(truth.marker, size);
        }));
    for (const DeclaredStageTerm& term : declared_.stage_terms) {
        errors.push_back(injected(term.error, declared_.poses));
        if (term.error.is_linear_scale)
            linear.push_back(errors.back());
    }
    if (linear.size() >= 2)
        errors.push_back(
            {"stage scale, all linear axes", "1", 1e-3, [linear](RunTruth& truth, double size) {
                 for (const InjectedError& one : linear)
                     one.change(truth, size);
             }});
    return errors;
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
    Eigen::VectorXd in_photo = statistics->bias + statistics->noise_bias, in_render = in_photo;
    if (draws) {
        const auto number = static_cast<std::uint32_t>(index);
        RandomStream random(draws->seed, first_pose_stream + number, draws->run),
            of_render(draws->seed, first_render_stream + number, draws->run);
        const int frames = station_.plan.frames;
        base_from_carriage = left_perturbed(base_from_carriage, drawn_shift(*draws, index, random));
        in_photo += mean_frame_noise(*statistics, frames, random, pose);
        in_render += frame_noise(*statistics, of_render) /
                     std::sqrt(RenderedCorners::exposures_per_frame * frames);
    }
    // What the pixels show is not what a detector that slips makes of them.
    pose.seen_at = truth.camera_from_base * base_from_carriage * truth.carriage_from_marker;
    pose.corners = (draws ? draws->marker : truth.marker).seen(truth.camera, *pose.seen_at);
    add(in_photo, pose.corners);
    pose.detector_bias_px.assign(pose.corners.size(), Eigen::Vector2d::Zero());
    add(in_render, pose.detector_bias_px);
}

QualificationInput RunSimulator::input(const RunTruth& truth, const Draws* draws) const {
    QualificationInput input = declared_;
    for (std::size_t i = 0; i < input.poses.size(); ++i)
        photograph(truth, draws, i, input.poses[i]);
    input.expected_poses = expected_;
    return input;
}

QualificationInput RunSimulator::draw(const RunTruth& truth, std::uint64_t seed,
                                      std::uint64_t run) const {
    RandomStream random(seed, run_stream, run);
    const DeclaredTemperature temperature = declared_.temperature.value_or(DeclaredTemperature{});
    const double kelvin = temperature.standard_uncertainty_k * random.normal();
    Draws draws{seed, run, truth.marker, {}};
    draws.marker.scale(1.0 + declared_.marker_size_uncertainty.value_or(0.0) * random.normal() +
                       temperature.marker_expansion_per_k * kelvin);
    const double flatness_mm = declared_.marker_flatness_mm.value_or(0.0);
    draws.marker.twist(flatness_mm * random.normal());
    if (draws.marker.points_mm.size() != 4)
        draws.marker.bow(flatness_mm * random.normal());
    for (const DeclaredStageTerm& term : declared_.stage_terms) {
        const double drawn =
            term.in_budget ? term.standard_uncertainty.value_or(0.0) * random.normal() : 0.0;
        const double expansion =
            term.error.is_linear_scale ? temperature.stage_expansion_per_k * kelvin : 0.0;
        draws.term_sizes.push_back(drawn + expansion);
    }
    QualificationInput drawn = input(truth, &draws);
    drawn.options.seed = seed + run;
    return drawn;
}

std::unique_ptr<const RunSimulator> study_plan(const std::filesystem::path& path,
                                               int noisy_frames) {
    const StationFile station = read_station(path);
    const Plan plan = plan_of(station);
    if (!states_noise(station.camera.model))
        throw ConfigError({station.inputs.at(1).path.string(), 0, "sensor.gain_e_per_dn"},
                          "is needed: without the sensor's noise nothing can be said of a run's "
                          "uncertainty (`etalon characterise` measures it)");
    const std::vector<Rigid> poses = expected_poses(station, plan);
    StderrProgress progress;
    progress.begin("rendering", static_cast<int>(poses.size()));
    DetectorStudy study = study_detector(expected_scene(station), poses, noisy_frames,
                                         station.plan.seed, [&] { progress.count(); });
    progress.end();
    return std::make_unique<const RunSimulator>(station, plan, std::move(study));
}

std::string detector_text(const DetectorFigures& detector) {
    return fmt::format(
        "the marker is detected in {} of {} poses ({} noisy renders of each)\n"
        "corner noise {:.4f} px a frame; the detector's bias {:.4f} px, of which noise moves {:.4f}"
        " px\n",
        detector.seen, detector.asked, detector.frames, detector.noise_px, detector.bias_px,
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
