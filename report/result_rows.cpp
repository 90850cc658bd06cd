#include "report/result_rows.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>

#include "core/file/sha256.h"
#include "core/file/text.h"
#include "report/json_text.h"

namespace etalon {

Shard parse_shard(const std::string& text) {
    if (text.empty())
        return {};
    const std::vector<std::string> parts = split(text, '/');
    const auto index = parts.size() == 2 ? parse_integer(parts[0]) : std::nullopt;
    const auto count = parts.size() == 2 ? parse_integer(parts[1]) : std::nullopt;
    if (!index || !count || *index < 1 || *index > *count || *count > 1'000'000)
        throw ConfigError({"--shard"}, "must be I/N with 1 <= I <= N, not '" + text + "'");
    return {static_cast<std::size_t>(*index), static_cast<std::size_t>(*count)};
}

namespace {

constexpr const char* results_file = "results.csv";

[[noreturn]] void refuse(const std::filesystem::path& folder, const std::string& why) {
    throw ConfigError({"--out"}, fmt::format("'{}' {}", folder.string(), why));
}

// Whether a folder without a description holds only what a program killed before it leaves.
bool is_only_begun(const std::filesystem::path& folder, const RowsDescription& description) {
    const std::string& header = description.header;
    std::error_code error;
    return std::ranges::all_of(
        std::filesystem::directory_iterator(folder, error), [&](const auto& entry) {
            const std::string name = entry.path().filename().string();
            return name == std::string(description.work.description) + ".part" ||
                   name == std::string(results_file) + ".part" ||
                   (name == results_file && entry.is_regular_file() &&
                    entry.file_size() == header.size() &&
                    sha256_of_file(entry.path()) == sha256(header));
        });
}

void require_same(const std::filesystem::path& folder, const RowsDescription& description) {
    const ShardedWork& work = description.work;
    const Json there = read_json(folder / work.description);
    if (!there.is_object())
        refuse(folder, fmt::format("holds a {} that cannot be read", work.description));
    const std::string different = first_difference(there, Json::parse(description.json));
    if (!different.empty())
        refuse(folder, fmt::format("belongs to another {}: its '{}' differs (see {})", work.what,
                                   different, work.description));
}

}  // namespace

RowRecord::RowRecord(const std::filesystem::path& folder, const RowsDescription& description)
    : folder_(folder) {
    lock_.emplace(claim_folder(folder));  // before anything is looked at
    const std::filesystem::path file = folder / description.work.description;
    std::error_code error;
    if (std::filesystem::exists(file, error)) {
        require_same(folder, description);
        results_.emplace(folder / results_file);
        keep_whole_units(description);
    } else {
        if (!is_only_begun(folder, description))
            refuse(folder, fmt::format("is not empty and holds no {}", description.work.what));
        write_text(folder / results_file, description.header);
        results_.emplace(folder / results_file);
        write_text(file, description.json + "\n");
    }
}

// Lines are counted, not read: whoever reads the results checks them.
void RowRecord::keep_whole_units(const RowsDescription& description) {
    const std::filesystem::path path = folder_ / results_file;
    std::ifstream file(path, std::ios::binary);
    std::string line;
    if (!std::getline(file, line) || line + "\n" != description.header)
        refuse(folder_,
               fmt::format("holds a {} of another {}", results_file, description.work.what));
    std::uintmax_t whole = line.size() + 1, at = whole;
    std::size_t rows = 0;
    while (std::getline(file, line) && !file.eof()) {
        at += line.size() + 1;
        if (++rows % description.rows_per_unit == 0)
            whole = at;
    }
    file.close();
    units_done_ = rows / description.rows_per_unit;
    std::error_code error;
    std::filesystem::resize_file(path, whole, error);
    if (error)
        fail_writing(path, error);
}

void RowRecord::add(const std::string& rows) {
    results_->write(rows);
    ++units_done_;
}

namespace {

Shard shard_in(const Json& description, const std::string& place) {
    const Json pair = description.value("shard", Json());
    const bool is_pair = pair.is_array() && pair.size() == 2 && pair[0].is_number_unsigned() &&
                         pair[1].is_number_unsigned();
    const Shard shard = is_pair ? Shard{pair[0], pair[1]} : Shard{0, 0};
    if (shard.index < 1 || shard.index > shard.count || shard.count > 1'000'000)
        throw ConfigError({place}, "is of no shard");
    return shard;
}

}  // namespace

std::vector<std::filesystem::path> shards_in_order(
    const ShardedWork& work, const std::vector<std::filesystem::path>& folders,
    const std::vector<std::string>& descriptions) {
    const auto place_of = [&](const std::filesystem::path& folder) {
        return (folder / work.description).string();
    };
    const Json first = Json::parse(descriptions.at(0));
    const Shard first_shard = shard_in(first, place_of(folders[0]));
    std::vector<std::filesystem::path> ordered(first_shard.count);
    for (std::size_t i = 0; i < folders.size(); ++i) {
        const std::string place = place_of(folders[i]);
        Json one = Json::parse(descriptions.at(i));
        const Shard shard = shard_in(one, place);
        std::filesystem::path& there = ordered.at(std::min(shard.index, ordered.size()) - 1);
        if (shard.count == first_shard.count && !there.empty())
            throw ConfigError({place}, "is the same shard as " + there.string());
        one["shard"][0] = first_shard.index;
        const std::string different = first_difference(one, first);
        if (!different.empty())
            throw ConfigError({place}, fmt::format("is of another {} than {}: its '{}' differs",
                                                   work.what, folders[0].string(), different));
        there = folders[i];
    }
    for (std::size_t i = 0; i < ordered.size(); ++i)
        if (ordered[i].empty())
            throw ConfigError({work.command},
                              fmt::format("shard {}/{} is missing", i + 1, ordered.size()));
    return ordered;
}

ShardRows::ShardRows(const std::vector<std::filesystem::path>& in_order,
                     const RowsDescription& whole)
    : folders_(in_order), whole_(whole), rows_(whole.rows_per_unit) {
    std::string header;
    for (const std::filesystem::path& folder : folders_) {
        files_.emplace_back(folder / results_file, std::ios::binary);
        if (!std::getline(files_.back(), header) || header + "\n" != whole.header)
            throw ConfigError({(folder / results_file).string(), 1},
                              fmt::format("is not this {}'s header", whole.work.what));
    }
}

const std::vector<std::string>& ShardRows::next() {
    const std::size_t from = unit_ % files_.size();
    const std::string start = fmt::format("{},", unit_);
    for (std::string& row : rows_)
        if (!std::getline(files_[from], row) || files_[from].eof() || !row.starts_with(start))
            throw ConfigError({(folders_[from] / results_file).string()},
                              fmt::format("{} {} is missing: the shard is not finished",
                                          whole_.work.unit, unit_));
    ++unit_;
    return rows_;
}

SourcePlace ShardRows::place(std::size_t i) const {
    const std::size_t unit = unit_ - 1, rows_before = unit / files_.size() * rows_.size();
    return {(folders_[unit % files_.size()] / results_file).string(),
            static_cast<int>(rows_before + i) + 2};
}

void merge_rows(const std::vector<std::filesystem::path>& in_order, const RowsDescription& whole,
                const std::filesystem::path& out) {
    ShardRows rows(in_order, whole);
    const RowRecord record(out, whole);  // refuses a folder that holds something else
    AtomicFile merged(out / results_file);
    merged.write(whole.header);
    for (std::size_t unit = 0; unit < whole.units; ++unit)
        for (const std::string& row : rows.next())
            merged.write(row + "\n");
    merged.commit();
}

}  // namespace etalon
