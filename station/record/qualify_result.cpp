#include "station/record/qualify_result.h"

#include <fmt/format.h>

#include <ctime>
#include <fstream>

#include "core/file/sha256.h"

namespace etalon {

BootTime boot_time() {
    BootTime now;
    std::ifstream("/proc/sys/kernel/random/boot_id") >> now.boot;
    timespec time{};
    if (clock_gettime(CLOCK_BOOTTIME, &time) != 0)
        return {};
    now.seconds = static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
    return now;
}

std::optional<double> seconds_between(const BootTime& from, const BootTime& to) {
    if (from.boot.empty() || from.boot != to.boot)
        return std::nullopt;
    return to.seconds - from.seconds;
}

namespace {

// In the order of RunOutcome.
struct OutcomeWord {
    const char* name;
    int exit_code;
};
constexpr OutcomeWord outcome_words[] = {{"PASS", ExitCode::pass},
                                         {"FAIL", ExitCode::fail},
                                         {"INCONCLUSIVE", ExitCode::inconclusive},
                                         {"ERROR", ExitCode::run_error},
                                         {"ABORTED", ExitCode::interrupted}};

}  // namespace

const char* name(RunOutcome outcome) {
    return outcome_words[static_cast<std::size_t>(outcome)].name;
}

int exit_code(RunOutcome outcome) {
    return outcome_words[static_cast<std::size_t>(outcome)].exit_code;
}

bool is_verdict(RunOutcome outcome) {
    return outcome != RunOutcome::error && outcome != RunOutcome::aborted;
}

std::optional<RunOutcome> run_outcome_named(const std::string& name) {
    const auto found = std::ranges::find(outcome_words, name, &OutcomeWord::name);
    if (found == std::end(outcome_words))
        return std::nullopt;
    return static_cast<RunOutcome>(found - std::begin(outcome_words));
}

CaptureStatistics QualifyResult::statistics() const {
    CaptureStatistics total;
    for (const RunSession& session : sessions)
        for (const CounterField& field : counter_fields)
            total.*field.count += session.counters.*field.count;
    return total;
}

std::optional<double> mean_residual_gray(const QualifyResult& result) {
    double sum = 0.0;
    int count = 0;
    for (const AnalysedPose& pose : result.poses) {
        if (!pose.residual)
            continue;
        sum += pose.residual->rms_gray;
        ++count;
    }
    if (count == 0)
        return std::nullopt;
    return sum / count;
}

const FrameRecord* first_whole(const VisitedPose& pose) {
    const auto whole = std::ranges::find_if(
        pose.frames, [](const FrameRecord& frame) { return !frame.file.empty(); });
    return whole == pose.frames.end() ? nullptr : &*whole;
}

void require_recorded(const QualifyResult& result, const FrameRecord& frame) {
    const std::filesystem::path path = result.folder / frame.file;
    const std::string found = sha256_of_file(path);
    if (found != frame.sha256)
        throw ConfigError({path.string()},
                          fmt::format("is not the frame that was taken: its SHA-256 is {}, not {}",
                                      found, frame.sha256));
}

CodeImage recorded_photo(const QualifyResult& result, const FrameRecord& frame) {
    require_recorded(result, frame);
    const std::filesystem::path path = result.folder / frame.file;
    CodeImage photo = read_image(path);
    const CameraModel& camera = result.station.camera.model;
    if (photo.pixels.size() != cv::Size(camera.width, camera.height))
        throw ConfigError({path.string()},
                          fmt::format("has {}x{} pixels, the calibration {}x{}", photo.pixels.cols,
                                      photo.pixels.rows, camera.width, camera.height));
    photo.bits = result.settings.bits;
    return photo;
}

}  // namespace etalon
