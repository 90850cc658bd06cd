#include "station/record/run_record.h"

#include <elf.h>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <link.h>
#include <opencv2/core/utility.hpp>

#include <ctime>

#include "core/file/sha256.h"
#include "core/file/text.h"
#include "station/record/run_events.h"
#include "station/record/run_json.h"

namespace etalon {
namespace {

std::filesystem::path made(const std::filesystem::path& folder,
                           std::initializer_list<const char*> parts) {
    require_new_folder(folder);
    make_record_folders(folder, parts);
    return folder;
}

static_assert(sizeof(std::time_t) == 8, "dates after 2038-01-19 need 64 bits");

std::string utc_text(std::time_t time) {
    return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(time));
}

// The log, without what follows the whole lines.
std::filesystem::path cut(const std::filesystem::path& log, std::uintmax_t whole_bytes) {
    std::error_code error;
    std::filesystem::resize_file(log, whole_bytes, error);
    if (error)
        fail_writing(log, error);
    return log;
}

// The notes of a loaded object hold its build ID, which follows from its code.
int add_notes(dl_phdr_info* object, std::size_t, void* text) {
    std::string& all = *static_cast<std::string*>(text);
    all += fmt::format("{}\n", object->dlpi_name);
    for (int i = 0; i < object->dlpi_phnum; ++i) {
        const ElfW(Phdr)& part = object->dlpi_phdr[i];
        if (part.p_type == PT_NOTE)
            all.append(reinterpret_cast<const char*>(object->dlpi_addr + part.p_vaddr),
                       part.p_memsz);
    }
    return 0;
}

// Of what was loaded with the program: later plugins (core/program/plugin.h) measure nothing.
const std::string notes_at_start = [] {
    std::string all;
    dl_iterate_phdr(add_notes, &all);
    return all;
}();

std::string found_fingerprint() {
    return sha256(sha256_of_file("/proc/self/exe") + "\n" + cv::getCPUFeaturesLine() + "\n" +
                  notes_at_start);
}

}  // namespace

void ImageWriter::write(const std::filesystem::path& path, const CodeImage& image) {
    if (jobs_.size() == most) {
        std::future<void> first = std::move(jobs_.front());
        jobs_.pop_front();
        first.get();
    }
    jobs_.push_back(std::async(std::launch::async, write_image, path, image));
}

void ImageWriter::flush() {
    std::deque<std::future<void>> jobs;
    for (jobs.swap(jobs_); std::future<void> & job : jobs)
        job.get();
}

void require_new_folder(const std::filesystem::path& folder) {
    std::error_code error;
    if (!std::filesystem::exists(folder, error))
        return;
    if (!std::filesystem::is_directory(folder, error))
        throw ConfigError({"--out"}, fmt::format("{} is not a folder", folder.string()));
    if (!std::filesystem::is_empty(folder, error) || error)
        throw ConfigError({"--out"}, fmt::format("{} is not empty", folder.string()));
}

void make_record_folders(const std::filesystem::path& folder,
                         std::initializer_list<const char*> parts) {
    for (const char* part : parts)
        make_folder(folder / part);
}

std::string utc_now() {
    return utc_text(std::time(nullptr));
}

std::optional<double> utc_seconds(const std::string& utc) {
    std::tm time{};
    const char* end = strptime(utc.c_str(), "%Y-%m-%dT%H:%M:%SZ", &time);
    if (!end || *end != '\0')
        return std::nullopt;
    const std::time_t seconds = timegm(&time);
    if (utc_text(seconds) != utc)  // "2026-3-7T...", or the 30th of February
        return std::nullopt;
    return static_cast<double>(seconds);
}

RunRecord::RunRecord(const std::filesystem::path& folder, std::initializer_list<const char*> parts)
    : folder_(made(folder, parts)), events_(folder / log_file) {}

RunRecord::RunRecord(const std::filesystem::path& folder, std::uintmax_t whole_bytes)
    : folder_(folder), events_(cut(folder / log_file, whole_bytes)) {
    make_record_folders(folder, {"frames", "renders"});
}

void RunRecord::log(const std::string& line) {
    events_.write(line + "\n");
}

void RunRecord::log_pose(VisitedPose& pose, const CaptureStatistics& counts) {
    images_.flush();
    for (FrameRecord& frame : pose.frames) {
        if (frame.file.empty())
            continue;
        sync_to_disk(folder_ / frame.file);
        frame.sha256 = sha256_of_file(folder_ / frame.file);
    }
    sync_to_disk(folder_ / "frames");
    for (const FrameRecord& frame : pose.frames)
        log(frame_event(pose.index, frame));
    log(pose_event(pose, counts));
    sync_to_disk(folder_ / log_file);
}

void RunRecord::write(const QualifyResult& result) {
    write_text(folder_ / "run.json", run_json(result));
    write_text(folder_ / "poses.csv", poses_csv(result));
}

const std::string& program_fingerprint() {
    static const std::string fingerprint = found_fingerprint();
    return fingerprint;
}

}  // namespace etalon
