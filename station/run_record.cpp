#include "station/run_record.h"

#include "core/errors.h"
#include "core/text.h"
#include "station/run_json.h"

namespace etalon {
namespace {

std::filesystem::path made(const std::filesystem::path& folder) {
    require_new_folder(folder);
    std::error_code error;
    for (const char* part : {"frames", "renders"})
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

RunRecord::RunRecord(const std::filesystem::path& folder)
    : folder_(made(folder)), events_(folder / "events.jsonl", std::ios::binary | std::ios::app) {
    if (!events_)
        throw ConfigError({"--out"}, fmt::format("{} cannot be written", folder.string()));
}

void RunRecord::append(const std::string& line) {
    events_ << line << '\n' << std::flush;
    if (!events_)
        throw ConfigError({(folder_ / "events.jsonl").string()}, "cannot be written");
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
    write_text(folder_ / "poses.csv", poses_csv(result));
    write_text(folder_ / "run.json", run_json(result));
}

}  // namespace etalon
