#include "station/devices/capture_run.h"

#include <fmt/format.h>

#include "capture/camera_recovery.h"
#include "capture/frame/frame_average.h"
#include "core/file/file_writing.h"
#include "core/file/text.h"
#include "core/program/print_stderr.h"
#include "station/devices/capture_help.txt.h"
#include "station/devices/live_view.h"
#include "station/record/record_json.h"
#include "station/record/run_events.h"
#include "station/record/run_json.h"
#include "station/record/run_record.h"
#include "station/shell/command.h"
#include "station/shell/signals.h"

namespace etalon {
namespace {

void keep_frame(RunRecord& record, int number, const Frame& frame, Instant start) {
    FrameRecord entry = frame_record(frame, start);
    if (frame.status == FrameStatus::complete) {
        entry.file = fmt::format("frames/{:06}.png", number);
        record.images().write(record.folder() / entry.file, frame.image);
    }
    record.log(frame_event(number, entry));
}

void write_mean(const std::filesystem::path& folder, const FrameAverage& average) {
    Radiance mean;
    average.mean.convertTo(mean, CV_32F, 1.0 / ((1 << average.bits) - 1));
    write_radiance(folder / "mean.tiff", mean);
}

std::string capture_json(const CaptureResult& result) {
    Json camera = result.camera;
    camera["settings"] = settings_json(result.settings);
    add_counters(camera, result.statistics);
    camera["remarks"] = result.remarks;
    Json json = {{"etalon", "capture/1"},
                 {"started_utc", result.started_utc},
                 {"duration_s", result.duration_s},
                 {"reason", result.reason},
                 {"camera", camera},
                 {"frames_asked", result.asked},
                 {"frames_complete", result.complete}};
    add_present(json, "noise_dn", result.noise);
    add_present(json, "mean_dn", result.mean);
    json["software"] = software_json(software_versions());
    return text_of(json, 2) + "\n";
}

// What cannot be written any more is the reason, unless there is one. capture.json comes last, so
// that it says so: it is small and often still finds its place on a full disk.
void finish_record(RunRecord& record, const std::optional<FrameAverage>& average,
                   CaptureResult& result) {
    const std::function<void()> steps[] = {
        [&] { record.images().flush(); },
        [&] {
            if (average)
                write_mean(record.folder(), *average);
        },
        [&] { write_text(record.folder() / "capture.json", capture_json(result)); }};
    for (const auto& step : steps)
        try {
            step();
        } catch (const ConfigError& error) {
            if (result.reason.empty())
                result.reason = error.what();
        }
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

// Ten lines a second on a terminal, elsewhere one.
CaptureResult capture_shown(Camera& camera, const CaptureRequest& request, Clock& clock,
                            const std::stop_token& stop) {
    StatusLine line;
    LiveView view;
    const Duration period =
        line.is_terminal() ? std::chrono::milliseconds(100) : std::chrono::seconds(1);
    Instant next = clock.now();
    const CaptureResult result =
        capture_frames(camera, request, clock, stop, [&](const Frame& frame) {
            view.add(frame);
            if (clock.now() < next)
                return;
            next = clock.now() + period;
            line.show(view.line());
        });
    line.show(view.line());
    return result;
}

void require_purpose(const CaptureArguments& arguments) {
    if (arguments.frames == 0 && !arguments.live)
        throw ConfigError({"--frames"}, "is needed unless --live shows frames until Ctrl-C");
    if (arguments.frames != 0 && arguments.out.empty() && !arguments.live)
        throw ConfigError({"--out"}, "is needed unless --live shows the frames");
}

void print_result(const CaptureResult& result, const CaptureArguments& arguments) {
    print_remarks(result);
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
    result.settings = camera.configure(request.settings);
    const Instant start = clock.now();
    const auto elapsed_s = [&] {
        return std::chrono::duration<double>(clock.now() - start).count();
    };
    std::optional<FolderLock> lock;
    std::optional<RunRecord> record;
    if (!request.out.empty())
        lock.emplace(claim_folder(request.out));
    if (lock)
        record.emplace(request.out, std::initializer_list<const char*>{"frames"});
    const auto log = [&](const std::string& event, const std::string& detail) {
        if (record)
            record->log(state_event(elapsed_s(), event, detail));
    };
    FrameAverager averager;
    use_camera(camera, result, [&] {
        Instant after = start;
        for (int number = 0; request.frames == 0 || number < request.frames; ++number) {
            const Frame frame =
                frame_after_reconnecting(camera, after, request.retries, clock, stop, log);
            if (record)
                keep_frame(*record, number, frame, start);
            if (frame.status == FrameStatus::complete) {
                averager.add(frame);
                after = frame.exposure_start;
            }
            seen(frame);
        }
    });
    if (request.frames == 0 && result.reason == "interrupted")
        result.reason.clear();
    result.complete = averager.frames();
    std::optional<FrameAverage> average;
    if (result.complete >= 2) {
        average = averager.average();
        result.mean = cv::mean(average->mean)[0];
        result.noise = average->noise();
    }
    result.duration_s = elapsed_s();
    if (record)
        finish_record(*record, average, result);
    return result;
}

void use_camera(Camera& camera, CameraUse& use, const std::function<void()>& work) {
    use.camera = camera.identity();
    camera.arm();
    try {
        work();
    } catch (const Interrupted&) {
        use.reason = "interrupted";
    } catch (const Error& error) {
        use.reason = error.what();
    }
    camera.disarm();
    use.statistics = camera.statistics();
    use.remarks = camera.remarks();
}

void print_remarks(const CameraUse& use) {
    if (!use.reason.empty())
        print_stderr("etalon: {}\n", use.reason);
    for (const std::string& remark : use.remarks)
        print_stderr("etalon: {}\n", remark);
}

StatusLine::~StatusLine() {
    if (is_terminal_ && is_drawn_)
        print_stderr("\n");
}

void StatusLine::show(const std::string& text) {
    if (is_terminal_)
        print_stderr("\r{:<79}", text);
    else
        print_stderr("{}\n", text);
    std::fflush(stderr);
    is_drawn_ = true;
}

CaptureSettings capture_settings(const CaptureArguments& arguments) {
    CaptureSettings settings = arguments.settings;
    settings.bits = arguments.bits.value_or(settings.format.empty() ? 8 : 0);
    settings.exposure = std::chrono::microseconds(std::llround(arguments.exposure_us));
    settings.controls = parse_controls(arguments.controls);
    return settings;
}

std::unique_ptr<Camera> opened_camera(const CaptureArguments& arguments, Clock& clock,
                                      const std::stop_token& stop) {
    CameraLink link = arguments.link;
    link.frame_timeout = std::chrono::milliseconds(arguments.frame_timeout_ms);
    return open_when_free([&] { return open_camera(arguments.camera, link, clock); }, clock, stop,
                          [](const std::string& text) { print_stderr("{}\n", text); });
}

int run_capture(const CaptureArguments& arguments) {
    if (arguments.drift)
        return run_capture_drift(arguments);
    require_purpose(arguments);
    std::stop_source stop;
    const StopOnSignals signals(stop);
    SteadyClock clock;
    const auto camera = opened_camera(arguments, clock, stop.get_token());
    const CaptureRequest request{capture_settings(arguments), arguments.frames, arguments.retries,
                                 arguments.out};
    const CaptureResult result =
        arguments.live
            ? capture_shown(*camera, request, clock, stop.get_token())
            : capture_frames(*camera, request, clock, stop.get_token(), [](const Frame&) {});
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
    auto [command, asked] =
        program.add(run_capture, "capture", "take frames with a camera", capture_help_txt);
    command.required("--camera", asked->camera,
                     "v4l2:/dev/video0, genicam:ID-OR-IP,\nlibcamera:ID or files:DIR", "URI");
    const Option frames =
        command.option("--frames", asked->frames, "how many", "N").within(1, 1000000);
    const Option out = command.option("--out", asked->out, "folder of the record", "DIR");
    const Option live = command.flag(
        "--live", asked->live,
        "show fps, mean, noise, saturation, sharpness;\nwithout --frames until Ctrl-C");
    command.option("--format", asked->settings.format, "pixel format, by the device's name",
                   "NAME");
    command.option("--bits", asked->bits, "per pixel (default 8, or the format's)", "N")
        .within(1, 16);
    command.option("--width", asked->settings.width, "of the image (default: the device's)", "PX")
        .within(1, 65536);
    command.option("--height", asked->settings.height, "", "PX").within(1, 65536);
    command.option("--exposure-us", asked->exposure_us, "(default: the device's)", "US").positive();
    command.option("--gain-db", asked->settings.gain_db, "(default 0)", "DB");
    command.option("--black-level", asked->settings.black_level, "in the device's unit", "X");
    command.option("--trigger", asked->settings.trigger, "the device's name of a source, or none",
                   "NAME");
    command.option("--set", asked->controls, "a control by its name; may be repeated", "NAME=X")
        .one_each();
    command.option("--retries", asked->retries, "of a bad frame (default 5)", "N").within(0, 1000);
    command.option("--frame-timeout-ms", asked->frame_timeout_ms, "(default 1000)", "MS")
        .within(1, 600000);
    command.option("--packet-size", asked->link.packet_size, "GigE Vision (default 1400)", "BYTES")
        .within(576, 16384);
    command.option("--interface", asked->link.interface, "GigE Vision: IP of the network card",
                   "IP");
    declare_drift(command, *asked, frames, out, live);
}

}  // namespace etalon
