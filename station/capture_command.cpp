// `etalon capture`: frames of one camera into a record, and what they look like, live.
#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

#include "core/errors.h"
#include "core/text.h"
#include "station/capture_run.h"
#include "station/commands.h"
#include "station/live_view.h"
#include "station/run_json.h"
#include "station/signals.h"

namespace etalon {
namespace {

constexpr int run_error = 4, interrupted = 130;

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

CaptureRequest request_of(const CaptureArguments& arguments) {
    CaptureRequest request;
    CaptureSettings& settings = request.settings;
    settings.width = arguments.width;
    settings.height = arguments.height;
    settings.format = arguments.format;
    settings.bits = arguments.bits.value_or(arguments.format.empty() ? 8 : 0);
    settings.exposure = std::chrono::microseconds(std::llround(arguments.exposure_us));
    settings.gain_db = arguments.gain_db;
    settings.black_level = arguments.black_level;
    settings.trigger = arguments.trigger;
    settings.controls = parse_controls(arguments.controls);
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
    require_purpose(arguments);
    std::stop_source stop;
    const StopOnSignals signals(stop);
    SteadyClock clock;
    CameraLink link;
    link.packet_size = arguments.packet_size;
    link.frame_timeout = std::chrono::milliseconds(arguments.frame_timeout_ms);
    link.interface = arguments.interface;
    const auto camera = open_camera(arguments.camera, link, clock);
    CaptureResult result;
    {
        LivePrinter live(arguments.live, clock);
        result = capture_frames(*camera, request_of(arguments), clock, stop.get_token(),
                                [&](const Frame& frame) { live.show(frame); });
    }
    print_result(result, arguments);
    if (result.reason == "interrupted")
        return interrupted;
    return result.reason.empty() && result.complete >= arguments.frames ? 0 : run_error;
}

}  // namespace etalon
