// `etalon capture`: frames of one camera into a record, and what they look like, live.
#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

#include "core/program/errors.h"
#include "station/devices/capture_run.h"
#include "station/devices/commands.h"
#include "station/devices/live_view.h"
#include "station/record/run_json.h"
#include "station/shell/command.h"
#include "station/shell/signals.h"

namespace etalon {
namespace {

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
