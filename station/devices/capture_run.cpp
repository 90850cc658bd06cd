#include "station/devices/capture_run.h"

#include <fmt/format.h>
#include <unistd.h>

#include "capture/camera_recovery.h"
#include "capture/frame/frame_average.h"
#include "core/file/text.h"
#include "station/devices/live_view.h"
#include "station/record/record_json.h"
#include "station/record/run_events.h"
#include "station/record/run_json.h"
#include "station/record/run_record.h"
#include "station/shell/command.h"
#include "station/shell/signals.h"

namespace etalon {
namespace {

// The record, or nothing where none is wanted.
class CaptureRecord {
public:
    CaptureRecord(const std::filesystem::path& folder, Instant start) : start_(start) {
        if (!folder.empty())
            record_.emplace(folder, std::initializer_list<const char*>{"frames"});
    }

    void log(Instant now, const std::string& event, const std::string& detail) {
        if (record_)
            record_->log(
                state_event(std::chrono::duration<double>(now - start_).count(), event, detail));
    }

    void add(int number, const Frame& frame) {
        if (!record_)
            return;
        FrameRecord entry = frame_record(frame, start_);
        if (frame.status == FrameStatus::complete) {
            entry.file = fmt::format("frames/{:06}.png", number);
            record_->images().write(record_->folder() / entry.file, frame.image);
        }
        record_->log(frame_event(number, entry));
    }

    // What cannot be written any more is the reason, unless there is one. capture.json comes last,
    // so that it says so: it is small and often still finds its place on a full disk.
    void finish(CaptureResult& result, const FrameAverager& averager) {
        if (!record_)
            return;
        attempt(result, [&] { record_->images().flush(); });
        attempt(result, [&] { write_mean(averager); });
        attempt(result,
                [&] { write_text(record_->folder() / "capture.json", capture_json(result)); });
    }

private:
    void write_mean(const FrameAverager& averager) const {
        if (averager.frames() < 2)
            return;
        const FrameAverage average = averager.average();
        Radiance mean;
        average.mean.convertTo(mean, CV_32F, 1.0 / ((1 << average.bits) - 1));
        write_radiance(record_->folder() / "mean.tiff", mean);
    }

    static void attempt(CaptureResult& result, const std::function<void()>& step) {
        try {
            step();
        } catch (const ConfigError& error) {
            if (result.reason.empty())
                result.reason = error.what();
        }
    }

    Instant start_;
    std::optional<RunRecord> record_;
};

void take_all(Camera& camera, const CaptureRequest& request, Clock& clock,
              const std::stop_token& stop, CaptureRecord& record, FrameAverager& averager,
              const std::function<void(const Frame&)>& seen) {
    Instant after = clock.now();
    for (int number = 0; request.frames == 0 || number < request.frames; ++number) {
        const Frame frame =
            frame_after_reconnecting(camera, after, request.retries, clock, stop,
                                     [&](const std::string& event, const std::string& detail) {
                                         record.log(clock.now(), event, detail);
                                     });
        record.add(number, frame);
        if (frame.status == FrameStatus::complete) {
            averager.add(frame);
            after = frame.exposure_start;
        }
        seen(frame);
    }
}

void sum_up(CaptureResult& result, const FrameAverager& averager) {
    result.complete = averager.frames();
    if (averager.frames() < 2)
        return;
    const FrameAverage average = averager.average();
    result.mean = cv::mean(average.mean)[0];
    result.noise = average.noise();
}

// "Gamma=0.7"
std::map<std::string, double> parse_controls(const std::vector<std::string>& words) {
    std::map<std::string, double> controls;
    for (const std::string& word : words) {
        const std::size_t equals = word.find('=');
        const auto value = equals == std::string::npos
                               ? std::nullopt
                               : parse_number(std::string_view(word).substr(equals + 1));
        if (!value || equals == 0)
            throw ConfigError({"--set"}, fmt::format("must be NAME=NUMBER, not '{}'", word));
        controls[word.substr(0, equals)] = *value;
    }
    return controls;
}

CameraLink camera_link(const CaptureArguments& arguments) {
    CameraLink link;
    link.packet_size = arguments.packet_size;
    link.frame_timeout = std::chrono::milliseconds(arguments.frame_timeout_ms);
    link.interface = arguments.interface;
    return link;
}

CaptureRequest request_of(const CaptureArguments& arguments) {
    CaptureRequest request;
    request.settings = capture_settings(arguments);
    request.frames = arguments.frames;
    request.retries = arguments.retries;
    request.out = arguments.out;
    return request;
}

// On a terminal one line that is drawn again and again; otherwise a line a second.
class LivePrinter {
public:
    LivePrinter(bool wanted, const Clock& clock)
        : wanted_(wanted), terminal_(isatty(STDERR_FILENO) != 0), clock_(clock) {}
    ~LivePrinter() {
        if (!wanted_)
            return;
        print();
        if (terminal_)
            fmt::print(stderr, "\n");
    }
    LivePrinter(const LivePrinter&) = delete;
    LivePrinter& operator=(const LivePrinter&) = delete;

    void show(const Frame& frame) {
        if (!wanted_)
            return;
        view_.add(frame);
        const Duration period =
            terminal_ ? std::chrono::milliseconds(100) : std::chrono::seconds(1);
        if (printed_ && clock_.now() < *printed_ + period)
            return;
        printed_ = clock_.now();
        print();
    }

private:
    void print() const {
        if (terminal_)
            fmt::print(stderr, "\r{:<79}", view_.line());
        else
            fmt::print(stderr, "{}\n", view_.line());
        std::fflush(stderr);
    }

    bool wanted_, terminal_;
    const Clock& clock_;
    LiveView view_;
    std::optional<Instant> printed_;
};

void require_purpose(const CaptureArguments& arguments) {
    if (arguments.frames == 0 && !arguments.live)
        throw ConfigError({"--frames"}, "is needed unless --live shows frames until Ctrl-C");
    if (arguments.frames != 0 && arguments.out.empty() && !arguments.live)
        throw ConfigError({"--out"}, "is needed unless --live shows the frames");
}

void print_result(const CaptureResult& result, const CaptureArguments& arguments) {
    if (!result.reason.empty())
        fmt::print(stderr, "etalon: {}\n", result.reason);
    for (const std::string& remark : result.remarks)
        fmt::print(stderr, "etalon: {}\n", remark);
    if (arguments.json) {
        fmt::print("{}", capture_json(result));
        return;
    }
    fmt::print("captured {} frames\n", result.complete);
    if (result.noise)
        fmt::print("noise {:.3f} DN\n", *result.noise);
    if (!arguments.out.empty())
        fmt::print("record {}\n", (arguments.out / "capture.json").string());
}

}  // namespace

CaptureResult capture_frames(Camera& camera, const CaptureRequest& request, Clock& clock,
                             const std::stop_token& stop,
                             const std::function<void(const Frame&)>& seen) {
    CaptureResult result;
    result.asked = request.frames;
    result.started_utc = utc_now();
    result.camera = camera.identity();
    result.settings = camera.configure(request.settings);
    const Instant start = clock.now();
    CaptureRecord record(request.out, start);
    camera.arm();
    FrameAverager averager;
    try {
        take_all(camera, request, clock, stop, record, averager, seen);
    } catch (const Interrupted&) {
        if (request.frames != 0)
            result.reason = "interrupted";
    } catch (const Error& error) {
        result.reason = error.what();
    }
    camera.disarm();
    sum_up(result, averager);
    result.statistics = camera.statistics();
    result.remarks = camera.remarks();
    result.duration_s = std::chrono::duration<double>(clock.now() - start).count();
    record.finish(result, averager);
    return result;
}

std::string capture_json(const CaptureResult& result) {
    RecordJson camera = device_json(result.camera);
    camera["settings"] = settings_json(result.settings);
    add_counters(camera, result.statistics);
    camera["remarks"] = result.remarks;
    RecordJson json = {{"etalon", "capture/1"},
                       {"started_utc", result.started_utc},
                       {"duration_s", result.duration_s},
                       {"reason", result.reason},
                       {"camera", camera},
                       {"frames_asked", result.asked},
                       {"frames_complete", result.complete}};
    if (result.noise)
        json["noise_dn"] = *result.noise;
    if (result.mean)
        json["mean_dn"] = *result.mean;
    json["software"] = software_json(software_versions());
    return text_of(json, 2) + "\n";
}

CaptureSettings capture_settings(const CaptureArguments& arguments) {
    CaptureSettings settings;
    settings.width = arguments.width;
    settings.height = arguments.height;
    settings.format = arguments.format;
    settings.bits = arguments.bits.value_or(arguments.format.empty() ? 8 : 0);
    settings.exposure = std::chrono::microseconds(std::llround(arguments.exposure_us));
    settings.gain_db = arguments.gain_db;
    settings.black_level = arguments.black_level;
    settings.trigger = arguments.trigger;
    settings.controls = parse_controls(arguments.controls);
    return settings;
}

std::unique_ptr<Camera> opened_camera(const CaptureArguments& arguments, Clock& clock,
                                      const std::stop_token& stop) {
    return open_when_free(
        [&] { return open_camera(arguments.camera, camera_link(arguments), clock); }, clock, stop,
        [](const std::string& text) { fmt::print(stderr, "{}\n", text); });
}

int run_capture(const CaptureArguments& arguments) {
    if (arguments.drift)
        return run_capture_drift(arguments);
    require_purpose(arguments);
    std::stop_source stop;
    const StopOnSignals signals(stop);
    SteadyClock clock;
    const auto camera = opened_camera(arguments, clock, stop.get_token());
    CaptureResult result;
    {
        LivePrinter live(arguments.live, clock);
        result = capture_frames(*camera, request_of(arguments), clock, stop.get_token(),
                                [&](const Frame& frame) { live.show(frame); });
    }
    print_result(result, arguments);
    if (result.reason == "interrupted")
        return ExitCode::interrupted;
    return result.reason.empty() && result.complete >= arguments.frames ? 0 : ExitCode::run_error;
}

void declare_drift(Command& capture, CaptureArguments& asked, const Option& frames,
                   const Option& out, const Option& live) {
    const Option drift =
        capture.flag("--drift", asked.drift, "warm-up check: watch a target until it is still");
    const Option marker = capture
                              .option("--marker", asked.marker,
                                      "the target: any marker or board that a\ndetector sees", "M")
                              .needs(drift);
    capture.option("--minutes", asked.minutes, "at most (default 60, or as --frames says)", "M")
        .positive()
        .needs(drift)
        .excludes(frames);
    capture
        .option("--interval-s", asked.interval_s,
                "between frames (default 1); of files: how far\napart they were taken", "S")
        .positive()
        .needs(drift);
    drift.needs(marker).needs(out).excludes(live);
}

void declare_capture(Command& program) {
    auto [command, asked] = program.add(
        run_capture, "capture", "take frames with a camera",
        "Prints `captured N frames`, `noise X DN` (of a still scene) and `record FILE`.\n"
        "DIR gets capture.json, events.jsonl, frames/ and mean.tiff, and can be replayed\n"
        "as files:DIR. Settings are read back; what the camera does not do is an error.\n"
        "Cameras, formats and controls: `etalon devices`.\n\n"
        "With --drift it watches a target that stands still until its image moves by less\n"
        "than 0.02 px per minute, anywhere in the image and with its uncertainty: prints\n"
        "`drift X px/min stable after T min` and `report FILE`. Exit code 2 if that does\n"
        "not happen in the time. DIR gets drift.csv, drift.json and report.html.\n\n"
        "Examples:\n"
        "  etalon capture --camera v4l2:/dev/video0 --format Y16 --exposure-us 5000 \\\n"
        "      --frames 100 --out still\n"
        "  etalon capture --camera v4l2:/dev/video0 --drift --minutes 90 \\\n"
        "      --marker chessboard:9x6@25mm --out warm-up\n");
    command.required("--camera", asked->camera,
                     "v4l2:/dev/video0, genicam:ID-OR-IP,\nlibcamera:ID or files:DIR", "URI");
    const Option frames =
        command.option("--frames", asked->frames, "how many", "N").within(1, 1000000);
    const Option out = command.option("--out", asked->out, "folder of the record", "DIR");
    const Option live = command.flag(
        "--live", asked->live,
        "show fps, mean, noise, saturation, sharpness;\nwithout --frames until Ctrl-C");
    command.option("--format", asked->format, "pixel format, by the device's name", "NAME");
    command.option("--bits", asked->bits, "per pixel (default 8, or the format's)", "N")
        .within(1, 16);
    command.option("--width", asked->width, "of the image (default: the device's)", "PX")
        .within(1, 65536);
    command.option("--height", asked->height, "", "PX").within(1, 65536);
    command.option("--exposure-us", asked->exposure_us, "(default: the device's)", "US").positive();
    command.option("--gain-db", asked->gain_db, "(default 0)", "DB");
    command.option("--black-level", asked->black_level, "in the device's unit", "X");
    command.option("--trigger", asked->trigger, "the device's name of a source, or none", "NAME");
    command.option("--set", asked->controls, "a control by its name; may be repeated", "NAME=X")
        .one_each();
    command.option("--retries", asked->retries, "of a bad frame (default 5)", "N").within(0, 1000);
    command.option("--frame-timeout-ms", asked->frame_timeout_ms, "(default 1000)", "MS")
        .within(1, 600000);
    command.option("--packet-size", asked->packet_size, "GigE Vision (default 1400)", "BYTES")
        .within(576, 16384);
    command.option("--interface", asked->interface, "GigE Vision: IP of the network card", "IP");
    declare_drift(command, *asked, frames, out, live);
}

}  // namespace etalon
