// `etalon capture --drift`: has the camera warmed up?
#include <fmt/format.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>

#include "core/file/text.h"
#include "core/program/errors.h"
#include "station/devices/capture_run.h"
#include "station/devices/commands.h"
#include "station/devices/drift_report.h"
#include "station/record/run_record.h"
#include "station/shell/signals.h"

namespace etalon {
namespace {

bool is_recording(const CaptureArguments& arguments) {
    return arguments.camera.starts_with("files:");
}

DriftRequest drift_request(const CaptureArguments& arguments) {
    if (is_recording(arguments) && !arguments.interval_s)
        throw ConfigError({"--interval-s"}, "is needed: images do not say when they were taken");
    DriftRequest request;
    request.settings = capture_settings(arguments);
    request.retries = arguments.retries;
    const double interval_s = arguments.interval_s.value_or(1.0);
    const double minutes = arguments.minutes.value_or(60.0);
    constexpr double max_min = 10'000.0;  // a week
    constexpr int max_frames = 1'000'000;
    const double frames = arguments.frames > 0 ? arguments.frames : 60.0 * minutes / interval_s + 1;
    if (!(interval_s >= 1e-3) || frames * interval_s > 60.0 * max_min || frames > max_frames)
        throw ConfigError({"--interval-s"},
                          fmt::format("must be 0.001 at least and make at most {} frames in {} "
                                      "minutes",
                                      max_frames, max_min));
    request.interval = duration_of(interval_s);
    request.frames = static_cast<int>(frames);
    return request;
}

// On a terminal one line that is drawn again and again, otherwise one whenever there is a new rate.
class DriftPrinter {
public:
    void show(const DriftMonitor& monitor) {
        for (; jumps_ < monitor.jumps().size(); ++jumps_)
            note_jump(monitor.jumps()[jumps_]);
        if (terminal_)
            fmt::print(stderr, "\r{:<79}", drift_line(monitor));
        else if (monitor.rates().size() > rates_ || monitor.frames().size() == 1)
            fmt::print(stderr, "{}\n", drift_line(monitor));
        rates_ = monitor.rates().size();
        std::fflush(stderr);
    }
    ~DriftPrinter() {
        if (terminal_)
            fmt::print(stderr, "\n");
    }
    DriftPrinter() = default;
    DriftPrinter(const DriftPrinter&) = delete;
    DriftPrinter& operator=(const DriftPrinter&) = delete;

private:
    void note_jump(const DriftJump& jump) const {
        const std::string text = fmt::format(
            "jump of {:.3f} px at {:.2f} min: target, camera or their base was touched; judged "
            "anew",
            jump.size_px, jump.time.count());
        fmt::print(stderr, "{}{}\n", terminal_ ? "\r" : "", text);
    }

    bool terminal_ = isatty(STDERR_FILENO) != 0;
    std::size_t rates_ = 0, jumps_ = 0;
};

void write_record(const std::filesystem::path& folder, const DriftResult& result,
                  const std::string& target) {
    write_text(folder / "drift.csv", drift_csv(result));
    write_text(folder / "drift.json", drift_json(result, target));
    write_text(folder / "report.html", drift_html(result, target));
}

void print_result(const CaptureArguments& arguments, const DriftResult& result) {
    if (!result.reason.empty())
        fmt::print(stderr, "etalon: {}\n", result.reason);
    for (const std::string& remark : result.remarks)
        fmt::print(stderr, "etalon: {}\n", remark);
    if (arguments.json) {
        fmt::print("{}", drift_json(result, arguments.marker));
        return;
    }
    for (const DriftJump& jump : result.monitor.jumps())
        fmt::print("jump {:.3f} px at {:.2f} min\n", jump.size_px, jump.time.count());
    fmt::print("{}\nreport {}\n", drift_sentence(result), (arguments.out / "report.html").string());
}

int exit_code(const DriftResult& result) {
    if (result.reason == "interrupted")
        return ExitCode::interrupted;
    if (!result.reason.empty())
        return ExitCode::run_error;
    return result.stable ? 0 : ExitCode::inconclusive;
}

}  // namespace

int run_capture_drift(const CaptureArguments& arguments) {
    if (arguments.out.empty())
        throw ConfigError({"--out"}, "is needed");
    const DriftRequest request = drift_request(arguments);
    const TargetFinder find_target = make_target_finder(arguments.marker, "--marker");
    require_new_folder(arguments.out);
    std::stop_source stop;
    const StopOnSignals signals(stop);
    // A recording is watched on a clock of its own: as fast as it can be read.
    SteadyClock real;
    VirtualClock recorded;
    Clock& clock = is_recording(arguments) ? static_cast<Clock&>(recorded) : real;
    const auto camera = opened_camera(arguments, clock, stop.get_token());
    make_folder(arguments.out);
    std::optional<DriftResult> result;
    {
        DriftPrinter printer;
        result = watch_drift(*camera, find_target, request, clock, stop.get_token(),
                             [&](const DriftMonitor& monitor) { printer.show(monitor); });
    }
    write_record(arguments.out, *result, arguments.marker);
    print_result(arguments, *result);
    return exit_code(*result);
}

}  // namespace etalon
