#include "station/runner.h"

#include <fmt/format.h>

#include <cmath>
#include <functional>

#include "compare/detector.h"
#include "compare/photo_match.h"
#include "core/errors.h"
#include "stage/guarded_stage.h"
#include "station/camera_recovery.h"
#include "station/expected_view.h"
#include "station/measured_poses.h"
#include "station/qualification_input.h"
#include "station/qualify_report.h"
#include "station/run_record.h"

namespace etalon {
namespace {

// What all steps of a run share.
struct Run {
    QualifyResult& result;
    RunRecord& record;
    Clock& clock;
    Progress& progress;
    std::stop_token stop;
    Instant start;

    double seconds_until(Instant instant) const {
        return std::chrono::duration<double>(instant - start).count();
    }
    double now_s() const { return seconds_until(clock.now()); }
    void log(const std::string& state, const std::string& detail = "") const {
        record.log_state(now_s(), state, detail);
    }
    void throw_if_stopped() const {
        if (stop.stop_requested())
            throw Interrupted();
    }
};

void require_same_camera(const StationFile& station, const CameraIdentity& identity) {
    const std::string& calibrated = station.camera.model.serial;
    if (!calibrated.empty() && !identity.serial.empty() && calibrated != identity.serial)
        throw ConfigError(
            {station.inputs.empty() ? "" : station.inputs.at(1).path.string(), 0, "serial"},
            fmt::format("the calibration is of camera {}, but {} is camera {}", calibrated,
                        identity.uri, identity.serial));
}

// A frame that arrived whole must also be what the calibration is about.
void require_calibrated_format(const Frame& frame, const StationCamera& camera) {
    const cv::Size size = frame.image.pixels.size();
    const int bits = camera.settings.bits;
    if (size != cv::Size(camera.model.width, camera.model.height) || frame.image.bits != bits)
        throw DeviceError(
            "camera " + camera.uri, "take a frame",
            fmt::format("got {}x{} pixels of {} bits, the calibration has {}x{} of {}", size.width,
                        size.height, frame.image.bits, camera.model.width, camera.model.height,
                        bits));
}

// Nothing at all within the time-out, retries included, is a camera that is gone. A broken frame is
// only a broken frame: the pose goes on with its others.
Frame take_frame(const Run& run, Camera& camera, Instant after) {
    const StationCamera& wanted = run.result.station.camera;
    Frame frame = frame_after_reconnecting(
        camera, after, wanted.retries, run.clock, run.stop,
        [&run](const std::string& event, const std::string& detail) { run.log(event, detail); });
    if (frame.status == FrameStatus::timed_out)
        throw DeviceError("camera " + wanted.uri, "take a frame",
                          "nothing came in time, retries included: " + frame.status_detail);
    if (frame.status == FrameStatus::complete)
        require_calibrated_format(frame, wanted);
    return frame;
}

// Calls `after_each` after every frame.
std::vector<Frame> take_frames(const Run& run, Camera& camera, Instant settled, PoseRecord& pose,
                               const std::function<void()>& after_each) {
    std::vector<Frame> frames;
    Instant after = settled;
    for (int i = 0; i < run.result.station.plan.frames; ++i) {
        frames.push_back(take_frame(run, camera, after));
        FrameRecord record = frame_record(frames.back(), run.start);
        if (frames.back().status == FrameStatus::complete) {
            record.file = fmt::format("frames/{:04}_{}.png", pose.index, i);
            run.record.images().write(run.record.folder() / record.file, frames.back().image);
            after = frames.back().exposure_start;
        }
        pose.frames.push_back(record);
        after_each();
    }
    if (std::none_of(frames.begin(), frames.end(),
                     [](const Frame& f) { return f.status == FrameStatus::complete; }))
        throw DeviceError(
            "camera " + run.result.station.camera.uri,
            fmt::format("take the frames of pose {}", pose.index),
            fmt::format("none is complete; the last one: {}", name(frames.back().status)));
    return frames;
}

void detect_all(Detector& detector, const std::vector<Frame>& frames, PoseRecord& pose) {
    for (std::size_t i = 0; i < frames.size(); ++i) {
        if (frames[i].status != FrameStatus::complete)
            continue;
        FrameRecord& record = pose.frames[i];
        if (const auto detected = detector.detect(frames[i].image))
            record.corners = detected->pixels;
        else
            record.detection = detector.failure();
    }
}

// Mean of each corner over the frames that saw the marker.
void average_corners(PoseRecord& pose) {
    for (const FrameRecord& frame : pose.frames) {
        if (frame.corners.empty())
            continue;
        ++pose.detections;
        pose.corners.resize(frame.corners.size(), Eigen::Vector2d::Zero());
        for (std::size_t i = 0; i < frame.corners.size(); ++i)
            pose.corners[i] += frame.corners[i];
    }
    for (Eigen::Vector2d& corner : pose.corners)
        corner /= pose.detections;
}

std::vector<int> approach(const std::vector<Axis>& axes, const std::vector<double>& from,
                          const std::vector<double>& to) {
    std::vector<int> sides;
    for (std::size_t i = 0; i < to.size(); ++i) {
        const int straight = (to[i] > from[i]) - (to[i] < from[i]);
        sides.push_back(axes[i].approach != 0 ? axes[i].approach : straight);
    }
    return sides;
}

// An alarm or an emergency stop while the axes rest ends the run within this time.
constexpr std::chrono::milliseconds rest_poll_period{20};

void rest(const Run& run, Stage& stage, Duration time) {
    const Instant end = run.clock.now() + time;
    while (run.clock.now() < end) {
        stage.position();
        run.clock.wait_for(std::min<Duration>(rest_poll_period, end - run.clock.now()), run.stop);
        run.throw_if_stopped();
    }
}

// What was read back during the exposures, and the pose that follows.
void average_positions(const std::vector<std::vector<double>>& readings,
                       const std::vector<Axis>& axes, PoseRecord& pose) {
    const auto n = static_cast<double>(readings.size());
    for (std::size_t i = 0; i < axes.size(); ++i) {
        double sum = 0.0, squares = 0.0;
        for (const auto& reading : readings)
            sum += reading.at(i);
        for (const auto& reading : readings)
            squares += std::pow(reading[i] - sum / n, 2);
        const double deviation = std::sqrt(squares / (n - 1.0));
        pose.read_back.push_back(sum / n);
        pose.read_back_deviation.push_back(deviation);
        const double single = std::max(deviation, axes[i].read_noise.value_or(0.0));
        pose.read_back_uncertainty.push_back(single / std::sqrt(n));
    }
    pose.stage = stage_pose(axes, pose.read_back, pose.read_back_uncertainty);
}

PoseRecord visit(const Run& run, int index, const std::vector<double>& from, Camera& camera,
                 Stage& stage, Detector& detector) {
    run.throw_if_stopped();
    PoseRecord pose;
    pose.index = index;
    pose.planned = run.result.plan.poses.at(static_cast<std::size_t>(index));
    pose.approach = approach(run.result.station.stage.axes, from, pose.planned.target);
    pose.move_start_s = run.now_s();
    stage.move(pose.planned.target, run.stop);
    rest(run, stage, run.result.station.plan.settle);
    run.throw_if_stopped();
    const Instant settled = run.clock.now();
    pose.settled_s = run.seconds_until(settled);
    std::vector<std::vector<double>> readings = {stage.position()};
    const std::vector<Frame> frames =
        take_frames(run, camera, settled, pose, [&] { readings.push_back(stage.position()); });
    average_positions(readings, run.result.station.stage.axes, pose);
    detect_all(detector, frames, pose);
    average_corners(pose);
    pose.done_s = run.now_s();
    return pose;
}

void keep(const Run& run, const PoseRecord& pose) {
    for (const FrameRecord& frame : pose.frames)
        run.record.log_frame(pose.index, frame);
    run.record.log_pose(pose);
    run.result.poses.push_back(pose);
    run.result.duration_s = run.now_s();
    run.record.write(run.result);
}

void prepare(const Run& run, Camera& camera, Stage& stage) {
    run.result.settings = camera.configure(run.result.station.camera.settings);
    run.log("camera configured");
    camera.arm();
    stage.enable(run.stop);
    run.log("stage enabled");
    stage.home(run.stop);
    run.log("stage homed");
}

void visit_all(const Run& run, Camera& camera, Stage& stage) {
    const auto detector = make_detector(run.result.station.detector, run.result.station.marker,
                                        run.result.station.detector);
    const auto count = static_cast<int>(run.result.plan.poses.size());
    std::vector<double> from;
    for (const AxisStatus& axis : stage.status())
        from.push_back(axis.position);
    run.progress.begin("measuring", count, run.result.plan.expected_duration);
    for (int i = 0; i < count; ++i) {
        const PoseRecord pose = visit(run, i, from, camera, stage, *detector);
        from = pose.read_back;
        keep(run, pose);
        run.progress.step();
    }
    run.progress.end();
}

// Nothing moves any more when this is asked: a move that fails or is interrupted has stopped its
// axes itself. Asking first keeps the end of a run short when nobody answers: every attempt to stop
// then takes 2 s, and closing the stage makes one in any case.
bool answers(Stage& stage) {
    try {
        stage.status();  // not position(), which an alarm keeps from answering
        return true;
    } catch (const DeviceError&) {
        return false;
    }
}

void stop_axes(const Run& run, Stage& stage) {
    const bool confirmed = answers(stage) && stage.stop();
    run.log("axes stopped", confirmed ? "confirmed" : "NOT confirmed by the controller");
    if (!confirmed)
        run.result.remarks.push_back("the stage did not confirm that its axes stand still");
}

void release_camera(const Run& run, Camera& camera) {
    camera.disarm();
    run.result.statistics = camera.statistics();
    for (const std::string& remark : camera.remarks())
        run.result.remarks.push_back(remark);
}

// Takes the devices: they are gone when it returns or throws. The axes are stopped first.
void measure(const Run& run, std::unique_ptr<Camera> camera, std::unique_ptr<Stage> stage) {
    try {
        prepare(run, *camera, *stage);
        visit_all(run, *camera, *stage);
        stop_axes(run, *stage);
    } catch (const std::exception&) {
        stop_axes(run, *stage);
        run.log("stage trace", stage->trace());
        stage.reset();
        release_camera(run, *camera);
        throw;
    }
    stage.reset();
    release_camera(run, *camera);
}

std::vector<StageVisit> visits_of(const std::vector<PoseRecord>& poses) {
    std::vector<StageVisit> visits;
    for (const PoseRecord& pose : poses)
        visits.push_back({pose.read_back, pose.read_back_uncertainty});
    return visits;
}

QualificationInput qualification_input(const Run& run) {
    QualificationInput input = declared_input(run.result.station, visits_of(run.result.poses));
    input.poses = measured_poses(run.result, run.result.remarks, run.stop);
    input.monte_carlo = true;
    return input;
}

// On the scale of the renders: the marker's white is `white_level`.
PoseRecord::Residual residual_of(const CodeImage& photo, const StationFile& station,
                                 const ComparedArea& area, const PhotometricCamera& camera,
                                 const Rigid& camera_from_marker) {
    CellGrid marker = station.marker.grid;
    marker.cells = marker.cells * station.white_level;
    const PhotoOfMarker seen{gray_of(photo), marker,
                             pixel_uses(camera.projector(), camera_from_marker, area), pixel_fitted,
                             station.background * station.white_level};
    const PixelDifference difference = fit_photometry(seen, camera, camera_from_marker).difference;
    return {difference.model, difference.scored};
}

// Each hold-out photograph against the render at its registered pose; the renders are kept, for
// people and for re-analysis.
void compare_with_renders(const Run& run, const ExpectedView& view) {
    const Qualification& analysis = *run.result.analysis;
    const StationFile& station = run.result.station;
    const PhotometricCamera camera(station.camera.model);
    const ComparedArea area = compared_area(station.marker, {}, station.marker.spec);
    for (std::size_t i = 0; i < analysis.poses.size(); ++i) {
        if (!analysis.poses[i].hold_out || !analysis.poses[i].used)
            continue;
        run.throw_if_stopped();
        PoseRecord& pose = run.result.poses[i];
        const Rigid& camera_from_marker = analysis.poses[i].bias.predicted;
        const Radiance radiance = view.radiance_at(camera_from_marker);
        pose.render_file = fmt::format("renders/{:04}.png", pose.index);
        run.record.images().write(run.record.folder() / pose.render_file, view.codes_of(radiance));
        try {
            pose.residual = residual_of(recorded_photo(run.result, pose), station, area, camera,
                                        camera_from_marker);
        } catch (const NumericalError& error) {
            run.result.remarks.push_back(
                fmt::format("pose {} has no pixel difference: {}", pose.index, error.what()));
        }
        run.progress.step();
    }
    run.record.images().flush();
}

void analyse(const Run& run) {
    const StationFile& station = run.result.station;
    const ExpectedView view(station.camera.model, station.marker.grid, station.background,
                            station.white_level);
    const auto detector = make_detector(station.detector, station.marker, station.detector);
    QualificationInput input = qualification_input(run);
    input.render_and_detect =
        [&](const Rigid& camera_from_marker) -> std::optional<std::vector<Eigen::Vector2d>> {
        run.throw_if_stopped();
        const auto detected = detector->detect(view.at(camera_from_marker));
        run.progress.step();
        if (!detected)
            return std::nullopt;
        return detected->pixels;
    };
    const int hold_out = static_cast<int>(
        std::count_if(input.poses.begin(), input.poses.end(),
                      [](const QualificationPose& pose) { return pose.hold_out; }));
    // Three rounds over the training poses at most; hold-out poses are rendered to judge and to
    // keep.
    const int renders = 3 * (static_cast<int>(input.poses.size()) - hold_out) + 2 * hold_out;
    run.log("analysis", fmt::format("{} poses, {} of them hold-out", input.poses.size(), hold_out));
    run.progress.begin("analysing", renders, renders * std::chrono::milliseconds(200));
    run.result.analysis = qualify(input);
    compare_with_renders(run, view);
    run.progress.end();
}

RunOutcome outcome_of(Outcome verdict) {
    if (verdict == Outcome::pass)
        return RunOutcome::pass;
    return verdict == Outcome::fail ? RunOutcome::fail : RunOutcome::inconclusive;
}

// What ends a run early becomes its outcome: the record must be finished whatever happened.
void carry_out(const Run& run, std::unique_ptr<Camera> camera, std::unique_ptr<Stage> stage) {
    QualifyResult& result = run.result;
    try {
        measure(run, std::move(camera), std::move(stage));
        analyse(run);
        result.outcome = outcome_of(result.analysis->verdict);
        result.reason.clear();
    } catch (const Interrupted& error) {
        result.outcome = RunOutcome::aborted;
        result.reason = error.what();
    } catch (const std::exception& error) {
        result.outcome = RunOutcome::error;
        result.reason = error.what();
    }
    run.progress.end();
    result.duration_s = run.now_s();
}

// A run whose record cannot be completed is an error, but what fits is kept: a disk that is too
// full for one file may still take a smaller one.
void close_record(const Run& run) {
    QualifyResult& result = run.result;
    const RunOutcome measured = result.outcome;
    const auto attempt = [&result](const std::function<void()>& step) {
        try {
            step();
        } catch (const ConfigError& error) {
            result.outcome = RunOutcome::error;
            if (result.reason.empty())
                result.reason = error.what();
        }
    };
    attempt([&] { run.log(name(result.outcome), result.reason); });
    attempt([&] { run.record.write(result); });
    attempt([&] { write_qualify_report(result, result.folder / "report.html"); });
    if (result.outcome != measured)
        attempt([&] { run.record.write(result); });
}

}  // namespace

QualifyResult run_qualification(const StationFile& station, const std::filesystem::path& folder,
                                const DeviceOpeners& open, Clock& clock, Progress& progress,
                                std::stop_token stop) {
    QualifyResult result;
    result.station = station;
    result.plan = make_plan(station.plan, station.stage.axes, station.camera.settings.exposure,
                            station.stage.rules);
    result.folder = folder;
    result.software = software_versions();
    require_new_folder(folder);
    std::unique_ptr<Camera> camera = open.camera();
    std::unique_ptr<Stage> stage =
        std::make_unique<GuardedStage>(open.stage(), station.stage.rules);
    result.camera = camera->identity();
    require_same_camera(station, result.camera);

    RunRecord record(folder);
    result.started_utc = utc_now();
    result.outcome = RunOutcome::error;
    result.reason = "the run did not come to its end";  // what a crash leaves behind
    record.write(result);
    const Run run{result, record, clock, progress, stop, clock.now()};
    carry_out(run, std::move(camera), std::move(stage));
    close_record(run);
    return result;
}

}  // namespace etalon
