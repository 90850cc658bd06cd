#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

#include "station/commands.h"
#include "station/run_json.h"
#include "station/runner.h"
#include "station/signals.h"

namespace etalon {
namespace {

void announce(const StationFile& station, Progress& progress) {
    const Plan plan = make_plan(station.plan, station.stage.axes,
                                station.camera.settings.exposure, station.stage.rules);
    progress.note(fmt::format("{}: {} poses, about {} and the analysis", station.id,
                              plan.poses.size(), duration_text(plan.expected_duration)));
}

void print_result(const QualifyResult& result, bool json) {
    const bool has_verdict = result.reason.empty();
    if (!has_verdict)
        fmt::print(stderr, "etalon: {}\netalon: the record of this run is in {}\n", result.reason,
                   result.folder.string());
    if (json)
        fmt::print("{}", run_json(result));
    else if (has_verdict)
        fmt::print("verdict {}\nreport {}\n", name(result.outcome),
                   (result.folder / "report.html").string());
}

}  // namespace

int run_qualify(const QualifyArguments& arguments) {
    std::stop_source stop;
    const StopOnSignals signals(stop);
    const StationFile station = read_station(arguments.station);
    SteadyClock clock;
    Progress progress(stderr, isatty(STDERR_FILENO) != 0, clock);
    announce(station, progress);
    const DeviceOpeners open{
        [&] { return open_camera(station.camera.uri, station.camera.link, clock); },
        [&] {
            return open_stage(station.stage.link, station.stage.profile, station.stage.axes, clock);
        }};
    const QualifyResult result =
        run_qualification(station, arguments.out, open, clock, progress, stop.get_token());
    print_result(result, arguments.json);
    return exit_code(result.outcome);
}

}  // namespace etalon
