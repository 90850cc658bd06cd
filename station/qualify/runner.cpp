#include "station/qualify/runner.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "capture/camera_recovery.h"
#include "compare/make_detector.h"
#include "core/file/file_writing.h"
#include "core/program/version.h"
#include "stage/axes/kinematics.h"
#include "stage/link/modbus_link.h"
#include "station/qualify/run_analysis.h"
#include "station/record/run_events.h"
#include "station/record/run_record.h"

namespace etalon {
namespace {

constexpr const char* odd_frame = "the corners are";  // how FrameRecord::detection begins

std::optional<CornerNoise> corner_noise(const VisitedPose& pose) {
    if (pose.detections < 2)
        return std::nullopt;
    double squares = 0.0;
    for (const FrameRecord& frame : pose.frames)
        for (std::size_t i = 0; i < frame.corners.size(); ++i)
            squares += (frame.corners[i] - pose.corners[i]).squaredNorm();
    constexpr double alike_px2 = 1e-12;
    if (squares < alike_px2)
        return std::nullopt;
    const double coordinates = 2.0 * static_cast<double>(pose.corners.size());
    const double freedom = (pose.detections - 1) * coordinates;
    return CornerNoise{squares / freedom / pose.detections, freedom};
}

// What all steps of a run share.
struct Run {
    QualifyResult& result;
    RunRecord& record;
    Clock& clock;
    Progress& progress;
    std::stop_token stop;
    Instant start;  // of the run: where it was resumed, so long ago as its record says
    const DeviceOpeners& open;

    double seconds_until(Instant instant) const {
        return std::chrono::duration<double>(instant - start).count();
    }
    double now_s() const { return seconds_until(clock.now()); }
    void log(const std::string& state, const std::string& detail = "") const {
        record.log(state_event(now_s(), state, detail));
    }
    // False for what was remarked before.
    bool remark(const std::string& text) const {
        if (std::ranges::find(result.remarks, text) != result.remarks.end())
            return false;
        result.remarks.push_back(text);
        log("remark", text);
        return true;
    }
    void throw_if_stopped() const { etalon::throw_if_stopped(stop); }
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

// Nothing within the time-out is a camera that is gone; of broken frames the pose has others.
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

constexpr const char* link_advice =
    "the camera's link loses packets, and most frames are taken again: look at cable, switch and "
    "network card; give the receive buffer room (sysctl net.core.rmem_max=4194304); set "
    "packet_size to what the whole way carries (1400, or 8000 with jumbo frames)";

// More frames break than arrive whole. One that breaks now and then is in the counters.
bool is_lossy(const CaptureStatistics& counts) {
    return counts.missing_packets > 0 && counts.rejected > counts.delivered;
}

// The stage's position is read after every frame.
std::vector<Frame> take_frames(const Run& run, Camera& camera, Instant settled, VisitedPose& pose,
                               Stage& stage) {
    std::vector<Frame> frames;
    Instant after = settled;
    for (int i = 0; i < run.result.station.plan.frames; ++i) {
        frames.push_back(take_frame(run, camera, after));
        FrameRecord record = frame_record(frames.back(), run.start);
        if (frames.back().status == FrameStatus::complete) {
            record.file = frame_file(pose.index, i);
            run.record.images().write(run.record.folder() / record.file, frames.back().image);
            after = frames.back().exposure_start;
        }
        pose.frames.push_back(record);
        pose.readings.push_back(stage.position());
    }
    if (is_lossy(camera.statistics()) && run.remark(link_advice))
        run.progress.note(link_advice);
    return frames;
}

// A pose whose frames all arrive broken is photographed again: at 2 % of lost packets without
// resending one frame of 20 is whole, and ten rounds of 5 frames with 5 retries fail once in 10^7.
constexpr int max_rounds = 10;

std::vector<Frame> take_frames_until_one_is_whole(const Run& run, Camera& camera, VisitedPose& pose,
                                                  Stage& stage) {
    const Instant settled = run.clock.now();
    FrameStatus last{};
    for (int round = 0; round < max_rounds; ++round) {
        pose.frames.clear();
        pose.readings = {stage.position()};
        std::vector<Frame> frames = take_frames(run, camera, settled, pose, stage);
        if (std::ranges::find(frames, FrameStatus::complete, &Frame::status) != frames.end())
            return frames;
        last = frames.back().status;
    }
    throw DeviceError(
        "camera " + run.result.station.camera.uri,
        fmt::format("take the frames of pose {}", pose.index),
        fmt::format("none of {} is complete; the last one: {}{}",
                    max_rounds * run.result.station.plan.frames, name(last),
                    is_lossy(camera.statistics()) ? std::string("; ") + link_advice : ""));
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

// Takes a pose of the plan and returns it visited and seen.
VisitedPose visit(const Run& run, const PlannedPose& planned, const std::vector<double>& from,
                  Camera& camera, Stage& stage, Detector& detector) {
    run.throw_if_stopped();
    VisitedPose pose{planned};
    pose.approach = approach(run.result.station.stage.axes, from, pose.target);
    pose.move_start_s = run.now_s();
    stage.move(pose.target, run.stop);
    rest(run, stage, run.result.station.plan.settle);
    run.throw_if_stopped();
    pose.settled_s = run.now_s();
    const std::vector<Frame> frames = take_frames_until_one_is_whole(run, camera, pose, stage);
    average_readings(pose, run.result.station.stage.axes);
    for (std::size_t i = 0; i < frames.size(); ++i)
        if (frames[i].status == FrameStatus::complete)
            detect_frame(detector, frames[i].image, pose.frames[i]);
    average_corners(pose);
    for (std::size_t i = 0; i < pose.frames.size(); ++i)
        if (pose.frames[i].detection.starts_with(odd_frame))
            run.remark(fmt::format("pose {}, frame {}: {}: a frame of another moment, not used",
                                   pose.index, i, pose.frames[i].detection));
    return pose;
}

// The log alone: the other files follow from it, when the run ends or by `etalon report`.
void keep(const Run& run, VisitedPose pose, const CaptureStatistics& counters) {
    pose.done_s = run.now_s();
    run.record.log_pose(pose, counters);
    RunSession& session = run.result.sessions.back();
    session.counters = counters;
    ++session.poses;
    run.result.poses.push_back({std::move(pose)});
}

void note_climate(const Run& run) {
    RunEnvironment& environment = run.result.environment;
    if (!run.open.climate || !environment.lost.empty())
        return;
    try {
        ClimateReading reading = run.open.climate();
        reading.t_s = run.now_s();
        environment.readings.push_back(reading);
        run.record.log(climate_event(reading));
    } catch (const DeviceError& error) {
        environment.lost = error.what();
        run.log(climate_lost, environment.lost);
        run.remark("the room's sensor was lost, and with it what this run could be certified on: " +
                   environment.lost);
        run.progress.note(run.result.remarks.back());
    }
}

// All poses of a run must be taken alike.
void configure(const Run& run, Camera& camera) {
    const CaptureSettings settings = camera.configure(run.result.station.camera.settings);
    const std::string now = settings_event(0.0, settings);
    const std::string before = settings_event(0.0, run.result.settings);
    if (!run.result.poses.empty() && now != before)
        throw DeviceError("camera " + run.result.station.camera.uri,
                          "take up the settings of the run",
                          fmt::format("they are {} now, and were {}", now, before));
    run.result.settings = settings;
    run.record.log(settings_event(run.now_s(), settings));
}

void prepare(const Run& run, Camera& camera, Stage& stage) {
    if (run.open.homed)
        run.remark(
            "axes that do not tell whether they are homed were taken for homed on the "
            "operator's word (--homed)");
    configure(run, camera);
    camera.arm();
    stage.enable(run.stop);
    run.log("stage enabled");
    stage.home(run.stop);
    run.log("stage homed");
}

// Three poses in succession that lack the marker are no accident of their places.
constexpr int poses_without_marker = 3;

// What such a pose shows in the marker's place, and what to look at.
std::string detected_instead(const QualifyResult& result, const VisitedPose& pose,
                             Detector& detector) {
    const FrameRecord& frame = *first_whole(pose);
    const CodeImage photo = recorded_photo(result, frame);
    const std::vector<std::string> tags = tags_in_view(photo, result.station.marker);
    if (!tags.empty())
        return fmt::format(
            "seen instead: {}. Compare `marker` in station.yaml with the one that is mounted",
            fmt::join(tags, ", "));
    std::string text = "no other tag is seen either";
    for (const Finding& finding : examine_missing_marker(photo, detector))
        text += "; " + finding.sentence;
    return text + fmt::format(
                      ". Look at {}: is the marker mounted, lit, in focus and in the view? "
                      "`etalon plan` tells where it should be",
                      (result.folder / frame.file).string());
}

// Ends a run that would measure in vain.
void require_marker_in_view(const Run& run, Detector& detector) {
    const QualifyResult& result = run.result;
    const bool any = std::ranges::any_of(result.poses, &VisitedPose::detections);
    if (any || result.sessions.back().poses != poses_without_marker)
        return;
    throw DeviceError(
        "camera " + result.station.camera.uri, "see the marker",
        fmt::format("{} is in none of the first {} poses; {}", result.station.marker.spec,
                    poses_without_marker, detected_instead(result, result.poses.back(), detector)));
}

void visit_missing(const Run& run, Camera& camera, Stage& stage, PhotometricPoses& photometric) {
    const QualifyResult& result = run.result;
    const auto detector =
        make_detector(result.station.detector, result.station.marker, result.station.detector);
    std::vector<PlannedPose> missing;  // of the plan, in its order
    for (const PlannedPose& pose : result.plan.poses)
        if (std::ranges::find(result.poses, pose.index, &PlannedPose::index) == result.poses.end())
            missing.push_back(pose);
    std::vector<double> from;
    for (const AxisStatus& axis : stage.status())
        from.push_back(axis.position);
    run.progress.begin("measuring", static_cast<int>(missing.size()),
                       result.plan.expected_duration * missing.size() / result.plan.poses.size());
    for (const PlannedPose& planned : missing) {
        VisitedPose pose = visit(run, planned, from, camera, stage, *detector);
        from = pose.read_back;
        note_climate(run);
        keep(run, std::move(pose), camera.statistics());
        require_marker_in_view(run, *detector);
        photometric.add(result.poses.back());
        run.progress.step();
    }
    stage.position();  // refuses, as the next move would, an axis that was pushed at the last pose
    run.progress.end();
}

// Nothing moves any more when the stage is asked: a move that fails or is interrupted has stopped
// its axes itself. Asking first keeps the end of a run short when nobody answers: every attempt to
// stop then takes 2 s, and closing the stage makes one in any case.
void stop_axes(const Run& run, Stage& stage) {
    bool confirmed = false;
    try {
        stage.status();  // not position(), which an alarm keeps from answering
        confirmed = stage.stop();
    } catch (const DeviceError&) {
        // said below
    }
    run.log("axes stopped", confirmed ? "confirmed" : "NOT confirmed by the controller");
    if (!confirmed)
        run.remark("the stage did not confirm that its axes stand still");
}

void release_camera(const Run& run, Camera& camera) {
    camera.disarm();
    RunSession& session = run.result.sessions.back();
    session.counters = camera.statistics();
    run.record.log(released_event(run.now_s(), session.counters));
    for (const std::string& remark : camera.remarks())
        run.remark(remark);
}

// Takes the devices: they are gone when it returns or throws. The axes are stopped first.
void measure(const Run& run, std::unique_ptr<Camera> camera, std::unique_ptr<Stage> stage,
             PhotometricPoses& photometric) {
    try {
        prepare(run, *camera, *stage);
        visit_missing(run, *camera, *stage, photometric);
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

// What ends a run early becomes its outcome. Without devices everything was measured before.
void carry_out(const Run& run, std::unique_ptr<Camera> camera, std::unique_ptr<Stage> stage) {
    QualifyResult& result = run.result;
    try {
        PhotometricPoses photometric(result, run.stop);
        if (camera)
            measure(run, std::move(camera), std::move(stage), photometric);
        const auto hold_out = std::ranges::count(result.poses, true, &VisitedPose::hold_out);
        run.log("analysis",
                fmt::format("{} poses, {} of them hold-out", result.poses.size(), hold_out));
        analyse_run(result, photometric, run.progress, run.stop);
    } catch (const Interrupted& error) {
        result.outcome = RunOutcome::aborted;
        result.reason = error.what();
    } catch (const std::exception& error) {
        result.outcome = RunOutcome::error;
        result.reason = printable(error.what());
    }
    run.progress.end();
}

// A run whose record cannot be completed is an error, but what fits is kept: a disk that is too
// full for one file may still take a smaller one. The log's last line is the end of the run.
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
    result.duration_s = run.now_s();
    attempt([&] {
        run.record.log(state_event(result.duration_s, name(result.outcome), result.reason));
    });
    attempt([&] { run.record.write(result); });
    attempt([&] { write_results(result); });
    if (result.outcome != measured)
        attempt([&] { run.record.write(result); });
}

RunSession new_session(const DeviceOpeners& open) {
    return {.started_utc = utc_now(),
            .started = boot_time(),
            .version = version,
            .operator_name = open.operator_name};
}

// Measures, analyses and closes the record, in a session of its own.
void carry_out_session(const Run& run, RunSession session, std::unique_ptr<Camera> camera,
                       std::unique_ptr<Stage> stage, const std::vector<std::string>& dropped = {}) {
    session.start_s = run.now_s();
    run.result.sessions.push_back(session);
    run.result.outcome = RunOutcome::error;
    run.result.reason = unfinished_run;  // what a crash leaves behind
    run.record.log(session_event(session, run.result.camera));
    run.record.write(run.result);
    for (const std::string& each : dropped)
        run.log("dropped", each);
    if (const std::string exact = exact_knowledge(run.result.station); !exact.empty())
        run.remark(exact);
    carry_out(run, std::move(camera), std::move(stage));
    close_record(run);
}

std::unique_ptr<Stage> guarded(const StationFile& station, const DeviceOpeners& open) {
    std::unique_ptr<Stage> stage = open.stage();
    if (open.homed)
        stage->take_for_homed();
    return std::make_unique<LimitedStage>(std::move(stage), station.stage.rules);
}

// ---- resuming

void require_resumable(const QualifyResult& result) {
    if (is_verdict(result.outcome))
        throw ConfigError({result.folder.string()},
                          fmt::format("came to its end with {}; `etalon report` analyses it again",
                                      name(result.outcome)));
    // Nothing has moved yet: a target that is not allowed is refused now rather than on the way.
    const StationStage& stage = result.station.stage;
    for (const PlannedPose& pose : result.plan.poses)
        require_allowed(
            stage.axes, stage.rules, pose.target,
            {(result.folder / log_file).string(), 1, fmt::format("plan.poses[{}]", pose.index)});
}

void require_recorded_camera(const QualifyResult& result, const CameraIdentity& camera) {
    if (camera.serial != result.camera.serial)
        throw ConfigError({result.folder.string()},
                          fmt::format("the run was begun with camera {}, but {} is camera {}",
                                      result.camera.serial, camera.uri, camera.serial));
}

// The system's clock counts only after a reboot, and is never before what the log says.
Instant resumed_start(const RecordedRun& recorded, const RunSession& session, Instant now) {
    const RunSession& first = recorded.result.sessions.front();
    const double by_system_clock_s = utc_seconds(session.started_utc).value_or(0.0) -
                                     utc_seconds(first.started_utc).value_or(0.0);
    const double passed_s =
        seconds_between(first.started, session.started).value_or(by_system_clock_s);
    return now - duration_of(std::max(passed_s, recorded.end_s));
}

double read_quantity(ModbusLink& link, const RoomSensor& sensor, const SensorRegister& place) {
    const std::string device = "room sensor " + describe(sensor.link);
    const std::string request = fmt::format("read register {}", place.address);
    try {
        const auto registers =
            link.read(sensor.link.unit, place.space, place.address, registers_of(place.type));
        const double value =
            place.scale * number_from_registers(registers, place.type, place.order) + place.offset;
        if (!place.possible.contains(value))
            throw DeviceError(device, request,
                              fmt::format("{} is not {}", value, place.possible.words()));
        return value;
    } catch (const DeviceError& error) {
        throw DeviceError(device, request, error.cause());
    }
}

}  // namespace

std::string frame_file(int pose, int frame) {
    return fmt::format("frames/{:04}_{}.png", pose, frame);
}

void average_readings(VisitedPose& pose, std::span<const Axis> axes) {
    const auto n = static_cast<double>(pose.readings.size());
    for (std::size_t i = 0; i < axes.size(); ++i) {
        double sum = 0.0, squares = 0.0;
        for (const auto& reading : pose.readings)
            sum += reading.at(i);
        for (const auto& reading : pose.readings)
            squares += std::pow(reading[i] - sum / n, 2);
        const double deviation = std::sqrt(squares / (n - 1.0));
        pose.read_back.push_back(sum / n);
        pose.read_back_deviation.push_back(deviation);
        const double single = std::max(deviation, axes[i].read_noise.value_or(0.0));
        pose.read_back_uncertainty.push_back(single / std::sqrt(n));
    }
    const StagePose stage = stage_pose(axes, pose.read_back, pose.read_back_uncertainty);
    pose.base_from_carriage = stage.base_from_carriage;
    pose.stage_covariance = stage.covariance;
}

void detect_frame(Detector& detector, const CodeImage& image, FrameRecord& frame) {
    const Detection seen = detector.detect(image);
    if (!seen.corners)
        frame.detection = seen.reason;
    else if (!seen.shown_as.empty())
        frame.detection = drawn_otherwise(seen.shown_as);
    else if (!seen.corners->is_whole())
        frame.detection = "marker seen in part only";
    else
        frame.corners = seen.corners->pixels;
}

namespace {

Eigen::Vector2d median_corner(std::span<const FrameRecord* const> frames, std::size_t corner) {
    Eigen::Vector2d middle;
    for (Eigen::Index k = 0; k < 2; ++k) {
        std::vector<double> all;
        for (const FrameRecord* frame : frames)
            all.push_back(frame->corners[corner][k]);
        middle[k] = median(std::move(all));
    }
    return middle;
}

// A frame in which the marker lies far from where most frames of its pose show it is of another
// moment: of the pose before, or taken in motion. Of two frames nobody can say which one.
void leave_out_odd_frames(VisitedPose& pose) {
    constexpr double times_usual = 10.0, least_px = 0.25;
    std::vector<FrameRecord*> seen;
    for (FrameRecord& frame : pose.frames)
        if (!frame.corners.empty())
            seen.push_back(&frame);
    if (seen.size() < 3)
        return;
    std::vector<double> squares(seen.size(), 0.0);
    const std::size_t corners = seen.front()->corners.size();
    for (std::size_t i = 0; i < corners; ++i) {
        const Eigen::Vector2d middle =
            median_corner(std::vector<const FrameRecord*>(seen.begin(), seen.end()), i);
        for (std::size_t k = 0; k < seen.size(); ++k)
            squares[k] += (seen[k]->corners[i] - middle).squaredNorm();
    }
    const auto rms = [&](double square) {
        return std::sqrt(square / static_cast<double>(corners));
    };
    const double most = std::max(times_usual * rms(median(squares)), least_px);
    for (std::size_t k = 0; k < seen.size(); ++k)
        if (rms(squares[k]) > most) {
            seen[k]->corners.clear();
            seen[k]->detection =
                fmt::format("{} {:.2f} px from where the pose's other frames show the marker",
                            odd_frame, rms(squares[k]));
        }
}

}  // namespace

void average_corners(VisitedPose& pose) {
    leave_out_odd_frames(pose);
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
    pose.corner_noise = corner_noise(pose);
}

DeviceOpeners station_devices(const StationFile& station, bool homed, Clock& clock,
                              Progress& progress, const std::stop_token& stop) {
    const auto camera = [&] {
        return open_when_free(
            [&] { return open_camera(station.camera.uri, station.camera.link, clock); }, clock,
            stop, [&](const std::string& text) { progress.note(text); });
    };
    const auto stage = [&] {
        return open_stage(station.stage.link, station.stage.profile, station.stage.axes, clock);
    };
    DeviceOpeners open{camera, stage, homed};
    if (station.environment && station.environment->sensor)
        open.climate = room_sensor(*station.environment->sensor, clock);
    return open;
}

QualifyResult run_qualification(const StationFile& station, const std::filesystem::path& folder,
                                const DeviceOpeners& open, Clock& clock, Progress& progress,
                                std::stop_token stop) {
    QualifyResult result;
    result.station = station;
    result.plan = plan_of(station);
    result.folder = folder;
    result.software = software_versions();
    progress.note(fmt::format("{}: {} poses, about {} and the analysis", station.id,
                              result.plan.poses.size(),
                              duration_text(result.plan.expected_duration)));
    require_new_folder(folder);
    std::unique_ptr<Camera> camera = open.camera();
    std::unique_ptr<Stage> stage = guarded(station, open);
    result.camera = camera->identity();
    require_same_camera(station, result.camera);

    const FolderLock lock = claim_folder(folder);
    RunRecord record(folder);
    copy_inputs(result.station.inputs, folder);
    const RunSession session = new_session(open);
    result.started_utc = session.started_utc;
    record.log(run_event(result));
    const Run run{result, record, clock, progress, stop, clock.now(), open};
    carry_out_session(run, session, std::move(camera), std::move(stage));
    return result;
}

QualifyResult resume_qualification(RecordedRun recorded, const DeviceOpeners& open, Clock& clock,
                                   Progress& progress, std::stop_token stop) {
    require_resumable(recorded.result);
    QualifyResult result = recorded.result;
    std::unique_ptr<Camera> camera;
    std::unique_ptr<Stage> stage;
    if (!recorded.is_measured()) {
        camera = open.camera();
        require_recorded_camera(result, camera->identity());
        stage = guarded(result.station, open);
    }
    RunRecord record(result.folder, recorded.whole_bytes);
    const RunSession session = new_session(open);
    const Instant start = resumed_start(recorded, session, clock.now());
    const Run run{result, record, clock, progress, stop, start, open};
    carry_out_session(run, session, std::move(camera), std::move(stage), recorded.dropped);
    return result;
}

std::function<ClimateReading()> room_sensor(const RoomSensor& sensor, Clock& clock) {
    const auto link = std::make_shared<ModbusLink>(sensor.link, clock);
    return [sensor, link] {
        ClimateReading reading;
        reading.temperature_c = read_quantity(*link, sensor, sensor.temperature_c);
        if (sensor.humidity_percent)
            reading.humidity_percent = read_quantity(*link, sensor, *sensor.humidity_percent);
        return reading;
    };
}

}  // namespace etalon
