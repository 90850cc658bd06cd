#include "station/run_record.h"

#include <fmt/chrono.h>

#include <cerrno>
#include <ctime>
#include <system_error>

#include "core/errors.h"
#include "core/text.h"
#include "station/run_events.h"
#include "station/run_json.h"

namespace etalon {
namespace {

std::filesystem::path made(const std::filesystem::path& folder,
                           std::initializer_list<const char*> parts) {
    require_new_folder(folder);
    std::error_code error;
    for (const char* part : parts)
        if (std::filesystem::create_directories(folder / part, error); error)
            throw ConfigError(
                {"--out"}, fmt::format("{} cannot be made: {}", folder.string(), error.message()));
    return folder;
}

}  // namespace

void require_new_folder(const std::filesystem::path& folder) {
    std::error_code error;
    if (!std::filesystem::exists(folder, error))
        return;
    if (!std::filesystem::is_directory(folder, error))
        throw ConfigError({"--out"}, fmt::format("{} is not a folder", folder.string()));
    if (!std::filesystem::is_empty(folder, error) || error)
        throw ConfigError({"--out"}, fmt::format("{} is not empty", folder.string()));
}

std::string utc_now() {
    return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(std::time(nullptr)));
}

FrameRecord frame_record(const Frame& frame, Instant start) {
    FrameRecord record;
    record.status = frame.status;
    record.status_detail = frame.status_detail;
    record.device_id = frame.id;
    record.exposure_start_s = std::chrono::duration<double>(frame.exposure_start - start).count();
    record.exposure_start_uncertainty_s =
        std::chrono::duration<double>(frame.exposure_start_uncertainty).count();
    record.time_source = frame.time_source;
    record.device_time_ns = frame.device_time_ns;
    record.settings = frame.settings;
    return record;
}

RunRecord::RunRecord(const std::filesystem::path& folder, std::initializer_list<const char*> parts)
    : folder_(made(folder, parts)),
      events_(folder / "events.jsonl", std::ios::binary | std::ios::app) {
    if (!events_)
        throw ConfigError({"--out"}, fmt::format("{} cannot be written", folder.string()));
}

void RunRecord::append(const std::string& line) {
    errno = 0;
    events_ << line << '\n' << std::flush;
    if (!events_)
        throw ConfigError({(folder_ / "events.jsonl").string()},
                          "cannot be written: " + std::generic_category().message(errno));
}

void RunRecord::log_state(double time_s, const std::string& state, const std::string& detail) {
    append(state_event(time_s, state, detail));
}

void RunRecord::log_frame(int pose, const FrameRecord& frame) {
    append(frame_event(pose, frame));
}

void RunRecord::log_pose(const PoseRecord& pose) {
    images_.flush();
    append(pose_event(pose));
}

void RunRecord::write(const QualifyResult& result) {
    write_text(folder_ / "run.json", run_json(result));
    write_text(folder_ / "poses.csv", poses_csv(result));
}

}  // namespace etalon
