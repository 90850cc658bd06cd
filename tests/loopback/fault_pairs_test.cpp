// Two faults in one run of `etalon qualify` over the real protocols: one of the camera with one of
// the stage, and some of these with a disk that becomes full or with SIGTERM as a third. The run
// ends in time, with no wrong verdict, and leaves no axis in motion.
//
// Each pair is tried once, with one of three thirds (nothing, disk, SIGTERM) and with a camera
// whose calibration is true or false by turns; all three: --gtest_random_seed=0, 1, 2.

#include "mocks/twin/twin.h"
#include "tests/loopback/quick_run.h"

namespace etalon {
namespace {

constexpr int faulty_move = 6;
constexpr Duration longest_run = 90s;  // of two seconds and what four time-outs of each device cost

const std::vector<std::string> stage_faults{
    "",
    "{fault: stuck_axis, axis: x, at: {move: 6}}",
    "{fault: false_in_position, axis: x, at: {move: 6}}",
    "{fault: encoder_jump, axis: y, at: {move: 6}, size_um: 3000}",
    "{fault: limit_hit, axis: y, at: {move: 6}}",
    "{fault: alarm, axis: z, at: {move: 6}, code: 21}",
    "{fault: emergency_stop, at: {move: 6}}",
    "{fault: late_reply, at: {move: 6}, delay_ms: 400, requests: 3}",
    "{fault: slow_bytes, at: {move: 6}, delay_ms: 50}",
    "{fault: exception, at: {move: 6}, code: 4, requests: 2}",
    "{fault: silence, at: {move: 6}, requests: 500}",
    "{fault: silence, at: {move: 6}, requests: 2, carried_out: false}",
    "{fault: garbage, at: {move: 6}}",
    "{fault: wrong_id, at: {move: 6}, requests: 2}",
    "{fault: half_open, at: {move: 6}}",
    "{fault: reset, at: {move: 6}, carried_out: false}"};

enum class Third { none, full_disk, terminated };
constexpr std::array<const char*, 3> third_names{"", ", disk full", ", SIGTERM"};

struct CameraFault {
    std::string name;
    std::function<void(Twin&)> begin;
    bool may_pass = true;
};

void come_back_as(Twin& twin, const std::string& serial) {
    twin.unplug_camera();
    SteadyClock().wait_for(500ms, {});
    twin.plug_camera_in(serial);
}

const std::vector<CameraFault> camera_faults{
    {"Works", [](Twin&) {}},
    {"LosesPackets", [](Twin& twin) { twin.camera().lose_packets(0.02, 1000); }},
    {"CutsFramesShort", [](Twin& twin) { twin.camera().cut_short(3); }},
    {"Freezes", [](Twin& twin) { twin.camera().freeze(); }},
    {"FreezesForASecond",
     [](Twin& twin) {
         twin.camera().freeze();
         SteadyClock().wait_for(1s, {});
         twin.camera().thaw();
     }},
    {"ChangesItsSize", [](Twin& twin) { twin.camera().change_size_unasked(312, 240); }},
    {"HasAClockThatJumps", [](Twin& twin) { twin.camera().jump_clock(-7s); }},
    {"IsUnplugged", [](Twin& twin) { twin.unplug_camera(); }},
    {"ComesBack", [](Twin& twin) { come_back_as(twin, "CAM-7"); }},
    {"IsReplacedByAnother", [](Twin& twin) { come_back_as(twin, "CAM-8"); }, false}};

struct Ended {
    int code = 0;
    std::string printed, log;
    Duration after{0};
    bool axes_move = false;
};

class FaultPairs : public testing::TestWithParam<CameraFault> {
protected:
    static Ended run(const std::string& stage_fault, Third third, bool camera_is_true) {
        TemporaryFolder folder;
        Twin twin(twin_file(folder, stage_fault, camera_is_true));
        write_station(folder, quick_station(fmt::to_string(twin.stage_port())));
        const auto disk = folder / "disk", copy = folder / "copy";
        std::filesystem::create_directory(disk);
        std::filesystem::create_directory(copy);
        std::vector<std::string> command{"qualify", (folder / "station.yaml").string(), "--out",
                                         (disk / "record").string()};
        std::string program = "etalon";
        if (third == Third::full_disk) {
            command.insert(command.begin(), {"400k", disk, copy, built_program("etalon")});
            program = ETALON_SOURCE_DIR "/tests/loopback/on_small_disk.sh";
        }
        SteadyClock clock;
        const Instant start = clock.now();
        Program station(program, command);
        std::jthread hand([&](std::stop_token stop) {
            while (twin.stage().moves_started() < faulty_move && !stop.stop_requested())
                clock.wait_for(2ms, stop);
            if (!stop.stop_requested())
                GetParam().begin(twin);
            if (third == Third::terminated && clock.wait_for(100ms, stop))
                station.send(SIGTERM);
            clock.wait_until(start + longest_run, stop);
            if (!stop.stop_requested())
                station.send(SIGKILL);
        });
        Ended end;
        end.printed = station.rest();
        end.axes_move = twin.stage().is_moving();
        hand.request_stop();
        hand.join();
        end.code = station.exit_code();
        end.after = clock.now() - start;
        const auto log = (third == Third::full_disk ? copy : disk) / "record/events.jsonl";
        end.log = std::filesystem::exists(log) ? read_text(log) : "";
        return end;
    }

private:
    static TwinFile twin_file(const TemporaryFolder& folder, const std::string& stage_fault,
                              bool camera_is_true) {
        write_text(folder / "camera.yml", camera_text);
        std::string text = quick_twin;
        if (!stage_fault.empty())
            text = replaced(text, "  port: 0\n", "  port: 0\n  faults: [" + stage_fault + "]\n");
        if (!camera_is_true)
            text = replaced(text, "  nominal_exposure_us",
                            "  errors: {k1_percent: 80}\n  nominal_exposure_us");
        write_text(folder / "twin.yaml", text);
        return read_twin_file(folder / "twin.yaml");
    }
};

TEST_P(FaultPairs, EndInTimeWithoutAWrongVerdictAndWithAxesAtRest) {
    int number = GTEST_FLAG_GET(random_seed);
    std::map<int, int> ended;
    Duration longest{0};
    for (const std::string& stage_fault : stage_faults) {
        const Third third = static_cast<Third>(number % 3);
        const bool camera_is_true = number++ % 2 == 0;
        SCOPED_TRACE(fmt::format("{}{}, calibration {}", stage_fault,
                                 third_names[static_cast<std::size_t>(third)],
                                 camera_is_true ? "true" : "false"));
        const Ended end = run(stage_fault, third, camera_is_true);
        EXPECT_LT(end.after, longest_run) << end.printed;
        EXPECT_THAT(end.code, testing::AnyOf(ExitCode::pass, ExitCode::fail, ExitCode::inconclusive,
                                             ExitCode::run_error, ExitCode::interrupted))
            << end.printed;
        const int wrong_verdict = camera_is_true ? ExitCode::fail : ExitCode::pass;
        EXPECT_NE(end.code, wrong_verdict) << end.printed;
        EXPECT_TRUE(GetParam().may_pass || end.code > ExitCode::inconclusive) << end.printed;
        const bool not_confirmed = end.log.find("NOT confirmed") != std::string::npos;
        EXPECT_TRUE(!end.axes_move || not_confirmed) << end.printed << end.log;
        ++ended[end.code];
        longest = std::max(longest, end.after);
    }
    for (const auto& [code, runs] : ended)
        fmt::print("{} runs with exit code {}\n", runs, code);
    fmt::print("the longest took {:.1f} s\n", std::chrono::duration<double>(longest).count());
}

INSTANTIATE_TEST_SUITE_P(OfACameraThat, FaultPairs, testing::ValuesIn(camera_faults),
                         [](const auto& fault) { return fault.param.name; });

}  // namespace
}  // namespace etalon
