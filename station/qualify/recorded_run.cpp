#include "station/qualify/recorded_run.h"

#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "compare/make_detector.h"
#include "station/qualify/run_analysis.h"
#include "station/qualify/runner.h"
#include "station/record/run_events.h"
#include "station/record/run_record.h"

namespace etalon {
namespace {

using Path = std::filesystem::path;

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
    const double seconds = entry.at("expected_duration_s").number(units::s.non_negative());
    plan.expected_duration = std::chrono::nanoseconds(std::llround(seconds * 1e9));
    for (const JsonEntry& pose : entry.at("poses").items()) {
        pose.require_keys({"target", "hold_out"});
        plan.poses.push_back({pose.at("target").numbers(axes), pose.at("hold_out").flag()});
    }
    number_poses(plan.poses);
    return plan;
}

CameraIdentity read_identity(const JsonEntry& entry) {
    entry.require_keys({"uri", "vendor", "model", "serial"});
    return {entry.at("uri").text(), entry.at("vendor").text(), entry.at("model").text(),
            entry.at("serial").text()};
}

CaptureStatistics read_counters(const JsonEntry& entry) {
    CaptureStatistics counts;
    for (const CounterField& field : counter_fields)
        counts.*field.count =
            static_cast<long>(entry.at(field.name).integer(0, std::numeric_limits<long>::max()));
    if (entry.keys().size() != std::size(counter_fields))
        entry.fail("has a key that is no counter");
    return counts;
}

// The log, line by line.
class LogReader {
public:
    explicit LogReader(RecordedRun& run) : run_(run), result_(run.result) {}

    void read() {
        const LogLength length =
            read_log(result_.folder, [this](const JsonEntry& line) { take(line); });
        run_.whole_bytes = length.whole_bytes;
        if (length.broken_bytes > 0)
            run_.dropped.push_back(fmt::format("the last line of the log is not whole: {} bytes",
                                               length.broken_bytes));
        if (result_.sessions.empty())
            throw ConfigError({(result_.folder / log_file).string()},
                              "is empty: nothing was measured");
        drop_frames_without_pose();
    }

private:
    void drop_frames_without_pose() {
        if (!frames_.empty())
            run_.dropped.push_back(
                fmt::format("pose {} was not finished: {} frames", in_flight_, frames_.size()));
        frames_.clear();
    }

    void take(const JsonEntry& line) {
        const double t = line.at("t").number(units::s.either_sign());
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
            take_frame(line);
        else if (event == "pose")
            take_pose(line, t);
        else if (event == climate_read)
            take_climate(line, t);
        else if (event == climate_lost)
            result_.environment.lost = line.at("detail").text();
        else if (event == "remark")
            take_remark(line.at("detail").text());
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
        const bool knows_boot = line.has("boot");          // logs of before 2026-11-25 do not
        const bool knows_operator = line.has("operator");  // nor those of before the day after
        if (knows_operator)
            line.require_keys(
                {"t", "event", "started_utc", "boot", "boot_s", "version", "operator", "camera"});
        else if (knows_boot)
            line.require_keys({"t", "event", "started_utc", "boot", "boot_s", "version", "camera"});
        else
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
        if (knows_boot)
            session.started = {line.at("boot").text(),
                               line.at("boot_s").number(units::s.non_negative())};
        session.start_s = t;
        session.version = line.at("version").text();
        if (knows_operator)
            session.operator_name = line.at("operator").text();
        result_.sessions.push_back(session);
        frames_.clear();
        result_.outcome = RunOutcome::error;
        result_.reason = unfinished_run;
    }

    void take_frame(const JsonEntry& line) {
        const FrameRecord frame = read_frame_record(line);
        const auto pose =
            static_cast<int>(line.at("pose").integer(0, std::numeric_limits<int>::max()));
        if (!frames_.empty() && pose != in_flight_)
            line.at("pose").fail("begins before the pose in flight is done");
        in_flight_ = pose;
        const bool complete = frame.status == FrameStatus::complete;
        const std::string expected =
            complete ? frame_file(pose, static_cast<int>(frames_.size())) : "";
        if (frame.file != expected)
            line.at("file").fail(fmt::format("must be '{}', not '{}'", expected, frame.file));
        frames_.push_back(frame);
    }

    void take_pose(const JsonEntry& line, double t) {
        line.require_keys({"t", "event", "pose", "hold_out", "commanded", "readings", "read_back",
                           "read_back_deviation", "base_from_carriage",
                           "base_from_carriage_uncertainty", "approach", "move_start_s",
                           "settled_s", "detections", "corners", "camera"});
        VisitedPose pose{planned_pose(line)};
        pose.readings = read_readings(line.at("readings"));
        for (const JsonEntry& side : line.at("approach").items())
            pose.approach.push_back(static_cast<int>(side.integer(-1, 1)));
        if (pose.approach.size() != axes())
            line.at("approach").fail("is not of all axes");
        pose.move_start_s = line.at("move_start_s").number(units::s.non_negative());
        pose.settled_s = line.at("settled_s").number(units::s.non_negative());
        pose.done_s = t;
        pose.frames = frames_of(line, pose.index);
        average_readings(pose, result_.station.stage.axes);
        result_.sessions.back().counters = read_counters(line.at("camera"));
        ++result_.sessions.back().poses;
        result_.poses.push_back({pose});
        frames_.clear();
    }

    void take_remark(const std::string& text) {
        if (std::ranges::find(result_.remarks, text) == result_.remarks.end())
            result_.remarks.push_back(text);
    }

    void take_climate(const JsonEntry& line, double t) {
        line.require_keys({"t", "event", "temperature_c", "humidity_percent"});
        ClimateReading reading{t, line.at("temperature_c").number(possible_temperature_c), {}};
        if (!line.at("humidity_percent").is_null())
            reading.humidity_percent =
                line.at("humidity_percent").number(possible_humidity_percent);
        result_.environment.readings.push_back(reading);
    }

    PlannedPose planned_pose(const JsonEntry& line) const {
        const auto poses = static_cast<long long>(result_.plan.poses.size());
        const auto index = static_cast<std::size_t>(line.at("pose").integer(0, poses - 1));
        const PlannedPose& planned = result_.plan.poses[index];
        if (std::ranges::find(result_.poses, planned.index, &VisitedPose::index) !=
            result_.poses.end())
            line.at("pose").fail(fmt::format("pose {} was visited before", index));
        if (line.at("commanded").numbers(axes()) != planned.target ||
            line.at("hold_out").flag() != planned.hold_out)
            line.at("pose").fail(fmt::format("pose {} is not the one of the plan", index));
        return planned;
    }

    std::vector<std::vector<double>> read_readings(const JsonEntry& list) const {
        std::vector<std::vector<double>> readings;
        for (const JsonEntry& item : list.items()) {
            readings.push_back(item.numbers(axes()));
            require_travelled(readings.back(), item);
        }
        if (readings.size() != static_cast<std::size_t>(result_.station.plan.frames) + 1)
            list.fail("must be one after settling and one after each frame");
        return readings;
    }

    // An axis that lies may be read beyond its end, not by as much again as it travels.
    void require_travelled(const std::vector<double>& reading, const JsonEntry& item) const {
        for (std::size_t i = 0; i < axes(); ++i) {
            const Axis& axis = result_.station.stage.axes[i];
            const double travel = axis.high - axis.low;
            if (!(reading[i] >= axis.low - travel && reading[i] <= axis.high + travel))
                item.fail(fmt::format("is far beyond the travel of axis {}", axis.name));
        }
    }

    std::vector<FrameRecord> frames_of(const JsonEntry& line, int pose) const {
        const bool any = std::ranges::any_of(frames_, [](const FrameRecord& frame) {
            return frame.status == FrameStatus::complete;
        });
        if (!any || in_flight_ != pose ||
            frames_.size() != static_cast<std::size_t>(result_.station.plan.frames))
            line.at("pose").fail(fmt::format("the frames of pose {} are not before it", pose));
        return frames_;
    }

    void take_end(const JsonEntry& line, const std::string& event) {
        const std::optional<RunOutcome> outcome = run_outcome_named(event);
        if (!outcome)
            return;  // for people
        if (is_verdict(*outcome) && !run_.is_measured())
            line.at("event").fail(fmt::format("is a verdict, and {} of {} poses are there",
                                              result_.poses.size(), result_.plan.poses.size()));
        result_.outcome = *outcome;
        result_.reason = line.at("detail").text();
    }

    std::size_t axes() const { return result_.station.stage.axes.size(); }

    RecordedRun& run_;
    QualifyResult& result_;
    std::vector<FrameRecord> frames_;  // of the pose in flight
    int in_flight_ = 0;
};

// Detects the marker in the frames, unless the record kept what was found; some poses at a time.
void read_frames(QualifyResult& result, Progress& progress, const std::stop_token& stop) {
    constexpr std::size_t at_a_time = 32;
    const StationFile& station = result.station;
    const KeptPixels kept_pixels(result);
    tbb::enumerable_thread_specific<std::unique_ptr<Detector>> detectors(
        [&] { return make_detector(station.detector, station.marker, station.detector); });
    const auto read = [&](VisitedPose& pose) {
        throw_if_stopped(stop);
        const KeptPose* kept = kept_pixels.of(pose);
        for (std::size_t i = 0; i < pose.frames.size(); ++i) {
            FrameRecord& frame = pose.frames[i];
            if (frame.status != FrameStatus::complete)
                continue;
            if (!kept) {
                detect_frame(*detectors.local(), recorded_photo(result, frame), frame);
                continue;
            }
            require_recorded(result, frame);
            frame.corners = kept->frames[i].corners;
            frame.detection = kept->frames[i].detection;
        }
        average_corners(pose);
    };
    const std::size_t count = result.poses.size();
    if (count == 0)
        return;
    progress.begin("reading", static_cast<int>(count));
    for (std::size_t first = 0; first < count; first += at_a_time) {
        const std::size_t end = std::min(first + at_a_time, count);
        // Isolated: a detector that waits for its own tasks must not begin another pose.
        tbb::parallel_for(first, end, [&](std::size_t i) {
            tbb::this_task_arena::isolate([&] { read(result.poses[i]); });
        });
        for (std::size_t i = first; i < end; ++i)
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
    read_frames(run.result, progress, stop);
    return run;
}

QualifyResult analyse_record(RecordedRun recorded, Progress& progress,
                             const std::stop_token& stop) {
    const bool measured = recorded.is_measured();
    QualifyResult result = std::move(recorded.result);
    if (measured) {
        make_record_folders(result.folder, {"renders"});
        const auto analysed = attempted([&] {
            PhotometricPoses photometric(result, stop);
            analyse_run(result, photometric, progress, stop);
        });
        if (!analysed) {
            result.outcome = RunOutcome::error;
            result.reason = analysed.cause;
        }
    }
    progress.end();
    write_results(result);
    return result;
}

}  // namespace etalon
