// The log of a run, events.jsonl, below the line of the run, which is a whole one of two poses
// unless the input has its own: it holds the hashes of the copies of the inputs.
#include "capture/files_camera.h"
#include "core/file/text.h"
#include "station/qualify/recorded_run.h"
#include "station/record/run_events.h"
#include "station/setup/plan.h"
#include "tests/fuzz/coverage/fuzz_input.h"

namespace etalon::test {
namespace {

std::string run_line() {
    for (const char* name : {"camera.yml", "limits.yaml"})
        provide(examples() / "demo" / name, std::filesystem::path("given") / name);
    std::string station = read_text(examples() / "demo" / "station.yaml");
    station.replace(station.find("frames: 5"), 9, "frames: 1");
    station.replace(station.find("apriltag:36h11:5@80mm"), 21, "chessboard:7x5@10mm");
    QualifyResult result;
    result.station = read_station(write_input("given/station.yaml", station));
    copy_inputs(result.station.inputs, input_folder());
    for (const double x : {-7.5, 3.25}) {
        VisitedPose pose;
        pose.target = {x, 1.5, -20.0, 0.125};
        pose.hold_out = x > 0.0;
        result.plan.poses.push_back(pose);
    }
    return run_event(result) + "\n";
}

void read_run(std::string_view text) {
    static const std::string first = run_line();
    const bool has_its_own = text.find("\"event\":\"run\"") != std::string_view::npos;
    write_input(log_file, (has_its_own ? "" : first) + std::string(text));
    VirtualClock clock;
    static std::FILE* const nowhere = std::fopen("/dev/null", "w");
    Progress progress(nowhere, false, clock);
    const RecordedRun run = read_record(input_folder(), progress, {});
    require_finite(run.end_s);
    for (const VisitedPose& pose : run.result.poses)
        require_all_finite(pose.read_back);
}

}  // namespace
}  // namespace etalon::test

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace etalon;
    using namespace etalon::test;
    read_or_refuse([&] { read_run(text_of(data, size)); });
    read_or_refuse([&] {
        for (const FrameRecord& frame : recorded_frames(input_folder()).frames)
            require_finite(frame.exposure_start_s);
    });
    return 0;
}
