// `etalon capture`: frames of one camera into a record, and what they look like, live.
#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

#include "core/errors.h"
#include "core/exit_codes.h"
#include "station/devices/capture_run.h"
#include "station/devices/capture_settings.h"
#include "station/devices/live_view.h"
#include "station/record/run_json.h"
#include "station/shell/commands.h"
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
    const auto camera = open_camera(arguments.camera, camera_link(arguments), clock);
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

}  // namespace etalon
