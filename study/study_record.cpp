#include "study/study_record.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/errors.h"
#include "core/text.h"
#include "report/csv.h"
#include "study/study_results.h"

namespace etalon {
namespace {

constexpr const char* description_file = "study.json";
constexpr const char* results_file = "results.csv";

[[noreturn]] void refuse(const std::filesystem::path& folder, const std::string& why) {
    throw ConfigError({"--out"}, fmt::format("'{}' {}", folder.string(), why));
}

void append_numbers(std::string& line, std::span<const double> numbers) {
    for (const double number : numbers)
        fmt::format_to(std::back_inserter(line), "{:.6f},", number);
}

std::string findings_text(const StudyFinding& finding, const std::string& common) {
    std::string line = fmt::format("{:d},{:d},{:.3f},", finding.error.has_value(),
                                   finding.error && finding.error->flip, finding.size_px);
    if (finding.corner_rms_px)
        fmt::format_to(std::back_inserter(line), "{:.6f}", *finding.corner_rms_px);
    line += "," + common;
    if (finding.error)
        append_numbers(line, finding.error->measures);
    else
        line.append(error_measure_count, ',');
    return line + csv_text(finding.failure) + "\n";
}

// Whether a folder without study.json holds nothing but what a study leaves that was killed before
// it had written that.
bool is_only_begun(const std::filesystem::path& folder, const std::string& header) {
    std::error_code error;
    return std::ranges::all_of(
        std::filesystem::directory_iterator(folder, error), [&](const auto& entry) {
            const std::string name = entry.path().filename().string();
            return name == std::string(description_file) + ".part" ||
                   name == std::string(results_file) + ".part" ||
                   (name == results_file && entry.is_regular_file() &&
                    entry.file_size() == header.size() && read_text(entry.path()) == header);
        });
}

}  // namespace

StudyRecord::StudyRecord(const std::filesystem::path& folder, const StudyDescription& description)
    : folder_(folder), description_(description) {
    std::error_code error;
    if (std::filesystem::exists(folder / description_file, error)) {
        const std::string different = first_difference(read_description(folder), description);
        if (!different.empty())
            refuse(folder, fmt::format("belongs to another study: its '{}' differs (see {})",
                                       different, description_file));
        lock_.emplace(folder / results_file);
        keep_whole_poses();
    } else {
        std::filesystem::create_directories(folder, error);
        if (error)
            refuse(folder, "cannot be made: " + error.message());
        if (!is_only_begun(folder, results_header(description)))
            refuse(folder, "is not empty and holds no study");
        write_text(folder / results_file, results_header(description));
        lock_.emplace(folder / results_file);
        write_text(folder / description_file, description_text(description));
    }
    results_.open(folder / results_file, std::ios::binary | std::ios::app);
    if (!results_)
        refuse(folder, std::string("holds a ") + results_file + " that cannot be written");
}

// Lines are counted, not read: whoever reads the results checks them.
void StudyRecord::keep_whole_poses() {
    const std::filesystem::path path = folder_ / results_file;
    std::ifstream file(path, std::ios::binary);
    std::string line;
    if (!std::getline(file, line) || line + "\n" != results_header(description_))
        refuse(folder_, std::string("holds a ") + results_file + " of another study");
    std::uintmax_t whole = line.size() + 1, at = whole;
    std::size_t rows = 0;
    while (std::getline(file, line) && !file.eof()) {
        at += line.size() + 1;
        if (++rows % description_.rows_per_pose() == 0)
            whole = at;
    }
    file.close();
    poses_done_ = rows / description_.rows_per_pose();
    std::filesystem::resize_file(path, whole);
}

void StudyRecord::add(const StudyPose& pose, const std::vector<double>& axis_values,
                      const std::vector<StudyFinding>& findings) {
    std::string common;
    append_numbers(common, pose_components(pose.camera_from_marker));
    append_numbers(common, axis_values);
    std::string lines;
    for (std::size_t i = 0; i < findings.size(); ++i) {
        const std::size_t detectors = description_.detectors.size();
        lines +=
            fmt::format("{},{},{},", pose.index, csv_text(description_.variants[i / detectors]),
                        csv_text(description_.detectors[i % detectors].name));
        lines += findings_text(findings[i], common);
    }
    results_ << lines << std::flush;
    if (!results_)
        throw ConfigError({(folder_ / results_file).string()}, "cannot be written");
    ++poses_done_;
}

// --------------------------------------------------------------------------------------- merging

namespace {

std::string place_of(const std::filesystem::path& shard) {
    return (shard / description_file).string();
}

// By index; every one of them once, of one study.
std::vector<std::filesystem::path> in_order(const std::vector<std::filesystem::path>& shards,
                                            const StudyDescription& first) {
    std::vector<std::filesystem::path> ordered(first.shard.count);
    for (const std::filesystem::path& folder : shards) {
        StudyDescription one = read_description(folder);
        std::filesystem::path& place = ordered.at(std::min(one.shard.index, ordered.size()) - 1);
        if (one.shard.count == first.shard.count && !place.empty())
            throw ConfigError({place_of(folder)}, "is the same shard as " + place.string());
        const StudyShard shard = one.shard;
        one.shard.index = first.shard.index;
        const std::string different = first_difference(one, first);
        if (!different.empty())
            throw ConfigError({place_of(folder)}, "is of another study than " +
                                                      shards.front().string() + ": its '" +
                                                      different + "' differs");
        ordered[shard.index - 1] = folder;
    }
    for (std::size_t i = 0; i < ordered.size(); ++i)
        if (ordered[i].empty())
            throw ConfigError({"study merge"},
                              fmt::format("shard {}/{} is missing", i + 1, ordered.size()));
    return ordered;
}

void copy_pose(std::ifstream& from, const std::filesystem::path& shard, std::size_t pose,
               std::size_t rows, std::ofstream& to) {
    std::string line;
    for (std::size_t row = 0; row < rows; ++row) {
        if (!std::getline(from, line) || from.eof() || !line.starts_with(fmt::format("{},", pose)))
            throw ConfigError({(shard / results_file).string()},
                              fmt::format("pose {} is missing: the shard is not finished", pose));
        to << line << '\n';
    }
}

}  // namespace

void merge_shards(const std::vector<std::filesystem::path>& shards,
                  const std::filesystem::path& out) {
    StudyDescription whole = read_description(shards.front());
    const auto ordered = in_order(shards, whole);
    whole.shard = {};
    std::vector<std::ifstream> files;
    std::string header;
    for (const std::filesystem::path& shard : ordered) {
        files.emplace_back(shard / results_file, std::ios::binary);
        if (!std::getline(files.back(), header) || header + "\n" != results_header(whole))
            throw ConfigError({(shard / results_file).string(), 1}, "is not this study's header");
    }
    StudyRecord(out, whole);  // refuses a folder that holds something else
    const std::filesystem::path path = out / results_file, part = path.string() + ".part";
    std::ofstream merged(part, std::ios::binary | std::ios::trunc);
    merged << results_header(whole);
    for (std::size_t pose = 0; pose < whole.poses; ++pose)
        copy_pose(files[pose % files.size()], ordered[pose % files.size()], pose,
                  whole.rows_per_pose(), merged);
    merged.close();
    std::error_code error;
    std::filesystem::rename(part, path, error);
    if (!merged || error)
        throw ConfigError({path.string()}, "cannot be written");
}

}  // namespace etalon
