#include "station/qualify/recorded_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <fstream>

#include "compare/make_detector.h"
#include "core/errors.h"
#include "core/json_entry.h"
#include "core/sha256.h"
#include "station/qualify/run_analysis.h"
#include "station/qualify/run_results.h"
#include "station/qualify/visited_pose.h"
#include "station/record/run_events.h"
#include "station/record/run_record.h"
#include "station/setup/station_inputs.h"

namespace etalon {
namespace {

using Path = std::filesystem::path;

constexpr long long most = std::numeric_limits<int>::max();

template <class Enum, std::size_t N>
Enum word_of(const JsonEntry& entry, const std::array<Enum, N>& values) {
    const std::string word = entry.text();
    const auto found =
        std::find_if(values.begin(), values.end(), [&](Enum value) { return word == name(value); });
    if (found == values.end())
        entry.fail(fmt::format("there is no '{}'", word));
    return *found;
}

constexpr std::array frame_statuses = {FrameStatus::complete, FrameStatus::short_frame,
                                       FrameStatus::corrupt, FrameStatus::lost,
                                       FrameStatus::timed_out};
constexpr std::array time_sources = {TimeSource::request, TimeSource::device_clock,
                                     TimeSource::driver_start, TimeSource::driver_end,
                                     TimeSource::recording};
constexpr std::array run_outcomes = {RunOutcome::pass, RunOutcome::fail, RunOutcome::inconclusive,
                                     RunOutcome::error, RunOutcome::aborted};

std::vector<InputFile> read_inputs(const JsonEntry& list) {
    std::vector<InputFile> inputs;
    for (const JsonEntry& item : list.items()) {
        item.require_keys({"role", "path", "copy", "sha256"});
        inputs.push_back({item.at("role").text(), item.at("path").text(), item.at("sha256").text(),
                          item.at("copy").text()});
    }
    return inputs;
}

Plan read_plan(const JsonEntry& entry, std::size_t axes) {
    entry.require_keys({"expected_duration_s", "poses"});
    Plan plan;
    const double seconds = entry.at("expected_duration_s").number({0.0, 1e9});
    plan.expected_duration = std::chrono::nanoseconds(std::llround(seconds * 1e9));
    for (const JsonEntry& pose : entry.at("poses").items()) {
        pose.require_keys({"target", "hold_out"});
        plan.poses.push_back({pose.at("target").numbers(axes), pose.at("hold_out").flag()});
    }
    return plan;
}

CameraIdentity read_identity(const JsonEntry& entry) {
    entry.require_keys({"uri", "vendor", "model", "serial"});
    return {entry.at("uri").text(), entry.at("vendor").text(), entry.at("model").text(),
            entry.at("serial").text()};
}

CaptureSettings read_settings(const JsonEntry& entry) {
    entry.require_keys({"width", "height", "bits", "format", "exposure_us", "gain_db",
                        "black_level", "trigger", "controls"});
    CaptureSettings settings;
    settings.width = static_cast<int>(entry.at("width").integer(0, most));
    settings.height = static_cast<int>(entry.at("height").integer(0, most));
    settings.bits = static_cast<int>(entry.at("bits").integer(0, 16));
    settings.format = entry.at("format").text();
    settings.exposure = std::chrono::microseconds(entry.at("exposure_us").integer(0, most));
    settings.gain_db = entry.at("gain_db").number();
    if (!entry.at("black_level").is_null())
        settings.black_level = entry.at("black_level").number();
    settings.trigger = entry.at("trigger").text();
    const JsonEntry controls = entry.at("controls");
    if (!controls.is_null())
        for (const std::string& key : controls.keys())
            settings.controls[key] = controls.at(key.c_str()).number();
    return settings;
}

CaptureStatistics read_counters(const JsonEntry& entry) {
    entry.require_keys({"frames_delivered", "frames_rejected", "frames_skipped", "missing_packets",
                        "resent_packets", "underruns", "reconnects"});
    const auto count = [&](const char* key) {
        return static_cast<long>(entry.at(key).integer(0, std::numeric_limits<long>::max()));
    };
    CaptureStatistics counts;
    counts.delivered = count("frames_delivered");
    counts.rejected = count("frames_rejected");
    counts.skipped = count("frames_skipped");
    counts.missing_packets = count("missing_packets");
    counts.resent_packets = count("resent_packets");
    counts.underruns = count("underruns");
    counts.reconnects = count("reconnects");
    return counts;
}

// The log, line by line.
class LogReader {
public:
    explicit LogReader(RecordedRun& run) : run_(run), result_(run.result) {}

    void read() {
        const Path path = result_.folder / log_file;
        std::ifstream file(path, std::ios::binary);
        if (!file)
            throw ConfigError({path.string()}, "cannot be read: is this the folder of a run?");
        std::string text;
        for (int line = 1; std::getline(file, text) && is_whole(file, text); ++line) {
            const SourcePlace place{path.string(), line, ""};
            take(JsonEntry(text, place));
            run_.whole_bytes += text.size() + 1;
        }
        if (result_.sessions.empty())
            throw ConfigError({path.string()}, "is empty: nothing was measured");
        drop_frames_without_pose();
    }

private:
    // getline() meets the end of the file only where the line has no end of its own.
    bool is_whole(const std::ifstream& file, const std::string& text) {
        if (!file.eof())
            return true;
        run_.dropped.push_back(
            fmt::format("the last line of the log is not whole: {} bytes", text.size()));
        return false;
    }

    void drop_frames_without_pose() {
        if (!frames_.empty())
            run_.dropped.push_back(
                fmt::format("pose {} was not finished: {} frames", in_flight_, frames_.size()));
        frames_.clear();
    }

    void take(const JsonEntry& line) {
        const double t = line.at("t").number();
        const std::string event = line.at("event").text();
        if (result_.plan.poses.empty() != (event == "run"))
            line.fail("the first line, and no other, must be the one of the run");
        if (result_.sessions.empty() && event != "run" && event != "session")
            line.fail("the second line must be the one of a session");
        if (event == "run")
            take_run(line);
        else if (event == "session")
            take_session(line, t);
        else if (event == "camera configured")
            result_.settings = read_settings(line.at("settings"));
        else if (event == "frame")
            take_frame(line, t);
        else if (event == "pose")
            take_pose(line, t);
        else if (event == "remark")
            add_once(result_.remarks, line.at("detail").text());
        else if (event == "camera released")
            result_.sessions.back().counters = read_counters(line.at("camera"));
        else
            take_end(line, event);
        run_.end_s = std::max(run_.end_s, t);
    }

    void take_run(const JsonEntry& line) {
        line.require_keys({"t", "event", "etalon", "inputs", "plan"});
        if (line.at("etalon").text() != run_log_kind)
            line.at("etalon").fail(fmt::format("must be '{}'", run_log_kind));
        result_.station = read_recorded_station(result_.folder, read_inputs(line.at("inputs")));
        result_.plan = read_plan(line.at("plan"), result_.station.stage.axes.size());
        if (result_.plan.poses.empty())
            line.at("plan").fail("has no poses");
    }

    void take_session(const JsonEntry& line, double t) {
        line.require_keys({"t", "event", "started_utc", "version", "camera"});
        const CameraIdentity camera = read_identity(line.at("camera"));
        if (result_.sessions.empty()) {
            result_.camera = camera;
            result_.started_utc = line.at("started_utc").text();
        } else if (camera.serial != result_.camera.serial) {
            line.at("camera").fail("is another camera than the one before");
        }
        RunSession session;
        session.started_utc = line.at("started_utc").text();
        if (!utc_seconds(session.started_utc))
            line.at("started_utc").fail("must be a time as 2026-03-07T14:05:09Z");
        session.start_s = t;
        session.version = line.at("version").text();
        result_.sessions.push_back(session);
        frames_.clear();
        result_.outcome = RunOutcome::error;
        result_.reason = unfinished_run;
    }

    void take_frame(const JsonEntry& line, double t) {
        line.require_keys({"t", "event", "pose", "file", "sha256", "status", "status_detail",
                           "device_id", "exposure_start_uncertainty_s", "time_source",
                           "device_time_ns", "settings", "detection", "corners"});
        const auto pose = static_cast<int>(line.at("pose").integer(0, most));
        if (!frames_.empty() && pose != in_flight_)
            line.at("pose").fail("begins before the pose in flight is done");
        in_flight_ = pose;
        FrameRecord frame;
        frame.status = word_of(line.at("status"), frame_statuses);
        frame.file = line.at("file").text();
        frame.sha256 = line.at("sha256").text();
        const bool complete = frame.status == FrameStatus::complete;
        const std::string expected =
            complete ? frame_file(pose, static_cast<int>(frames_.size())) : "";
        if (frame.file != expected)
            line.at("file").fail(fmt::format("must be '{}', not '{}'", expected, frame.file));
        frame.status_detail = line.at("status_detail").text();
        frame.device_id = line.at("device_id").whole();
        frame.exposure_start_s = t;
        frame.exposure_start_uncertainty_s =
            line.at("exposure_start_uncertainty_s").number(non_negative);
        frame.time_source = word_of(line.at("time_source"), time_sources);
        frame.device_time_ns = line.at("device_time_ns").whole();
        frame.settings = read_settings(line.at("settings"));
        frames_.push_back(frame);
    }

    void take_pose(const JsonEntry& line, double t) {
        line.require_keys({"t", "event", "pose", "hold_out", "commanded", "readings", "read_back",
                           "read_back_deviation", "base_from_carriage",
                           "base_from_carriage_uncertainty", "approach", "move_start_s",
                           "settled_s", "detections", "corners", "camera"});
        PoseRecord pose;
        const auto planned = static_cast<long long>(result_.plan.poses.size());
        pose.index = static_cast<int>(line.at("pose").integer(0, planned - 1));
        pose.planned = planned_pose(line, pose.index);
        pose.readings = read_readings(line.at("readings"));
        for (const JsonEntry& side : line.at("approach").items())
            pose.approach.push_back(static_cast<int>(side.integer(-1, 1)));
        if (pose.approach.size() != axes())
            line.at("approach").fail("is not of all axes");
        pose.move_start_s = line.at("move_start_s").number(non_negative);
        pose.settled_s = line.at("settled_s").number(non_negative);
        pose.done_s = t;
        pose.frames = frames_of(line, pose.index);
        pose.counters = read_counters(line.at("camera"));
        average_readings(pose, result_.station.stage.axes);
        result_.sessions.back().counters = pose.counters;
        ++result_.sessions.back().poses;
        result_.poses.push_back(pose);
        frames_.clear();
    }

    PlannedPose planned_pose(const JsonEntry& line, int index) const {
        const auto visited = std::find_if(result_.poses.begin(), result_.poses.end(),
                                          [&](const PoseRecord& p) { return p.index == index; });
        if (visited != result_.poses.end())
            line.at("pose").fail(fmt::format("pose {} was visited before", index));
        PlannedPose planned = result_.plan.poses[static_cast<std::size_t>(index)];
        if (line.at("commanded").numbers(axes()) != planned.target ||
            line.at("hold_out").flag() != planned.hold_out)
            line.at("pose").fail(fmt::format("pose {} is not the one of the plan", index));
        return planned;
    }

    std::vector<std::vector<double>> read_readings(const JsonEntry& list) const {
        std::vector<std::vector<double>> readings;
        for (const JsonEntry& item : list.items())
            readings.push_back(item.numbers(axes()));
        if (readings.size() != static_cast<std::size_t>(result_.station.plan.frames) + 1)
            list.fail("must be one after settling and one after each frame");
        return readings;
    }

    std::vector<FrameRecord> frames_of(const JsonEntry& line, int pose) const {
        const bool any = std::any_of(frames_.begin(), frames_.end(), [](const FrameRecord& frame) {
            return frame.status == FrameStatus::complete;
        });
        if (!any || in_flight_ != pose ||
            frames_.size() != static_cast<std::size_t>(result_.station.plan.frames))
            line.at("pose").fail(fmt::format("the frames of pose {} are not before it", pose));
        return frames_;
    }

    void take_end(const JsonEntry& line, const std::string& event) {
        const auto found = std::find_if(run_outcomes.begin(), run_outcomes.end(),
                                        [&](RunOutcome outcome) { return event == name(outcome); });
        if (found == run_outcomes.end())
            return;  // for people
        result_.outcome = *found;
        result_.reason = line.at("detail").text();
    }

    static void add_once(std::vector<std::string>& texts, const std::string& text) {
        if (std::find(texts.begin(), texts.end(), text) == texts.end())
            texts.push_back(text);
    }

    std::size_t axes() const { return result_.station.stage.axes.size(); }

    RecordedRun& run_;
    QualifyResult& result_;
    std::vector<FrameRecord> frames_;  // of the pose in flight
    int in_flight_ = 0;
};

CodeImage recorded_frame(const QualifyResult& result, const FrameRecord& frame) {
    const Path path = result.folder / frame.file;
    const std::string found = sha256_of_file(path);
    if (found != frame.sha256)
        throw ConfigError({path.string()},
                          fmt::format("is not the frame that was taken: its SHA-256 is {}, not {}",
                                      found, frame.sha256));
    CodeImage image = read_image(path);
    const CameraModel& camera = result.station.camera.model;
    if (image.pixels.size() != cv::Size(camera.width, camera.height))
        throw ConfigError({path.string()},
                          fmt::format("has {}x{} pixels, the calibration {}x{}", image.pixels.cols,
                                      image.pixels.rows, camera.width, camera.height));
    image.bits = result.settings.bits;
    return image;
}

void detect_again(QualifyResult& result, Progress& progress, const std::stop_token& stop) {
    const StationFile& station = result.station;
    const auto detector = make_detector(station.detector, station.marker, station.detector);
    if (!result.poses.empty())
        progress.begin("reading", static_cast<int>(result.poses.size()),
                       result.poses.size() * std::chrono::milliseconds(50));
    for (PoseRecord& pose : result.poses) {
        if (stop.stop_requested())
            throw Interrupted();
        for (FrameRecord& frame : pose.frames)
            if (frame.status == FrameStatus::complete)
                detect_frame(*detector, recorded_frame(result, frame), frame);
        average_corners(pose);
        progress.step();
    }
    progress.end();
}

}  // namespace

RecordedRun read_record(const Path& folder, Progress& progress, const std::stop_token& stop) {
    RecordedRun run;
    run.result.folder = folder;
    run.result.software = software_versions();
    LogReader(run).read();
    run.result.duration_s = run.end_s;
    run.result.statistics = total_counters(run.result.sessions);
    detect_again(run.result, progress, stop);
    return run;
}

QualifyResult analyse_record(RecordedRun recorded, Progress& progress,
                             const std::stop_token& stop) {
    const bool measured = recorded.is_measured();
    QualifyResult result = std::move(recorded.result);
    if (measured) {
        try {
            make_record_folders(result.folder, {"renders"});
            analyse_run(result, progress, stop);
            result.outcome = outcome_of(result.analysis->verdict);
            result.reason.clear();
        } catch (const NumericalError& error) {
            result.outcome = RunOutcome::error;
            result.reason = error.what();
        }
    }
    progress.end();
    write_results(result);
    return result;
}

}  // namespace etalon
