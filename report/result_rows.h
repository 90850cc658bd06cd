// Results of many units (poses, runs) as rows of a table, in a folder:
//
//   study.json     what the results follow from, as JSON with "shard": [I, N]; the name is the
//                  kind's
//   results.csv    so many rows for each unit, in the order of the units
//
// Units are written in order, so an interrupted work is a whole beginning of the full one and goes
// on where it ended. A shard (report/result_rows.h) holds every n-th unit; read in turn, the
// shards' rows are those of the work in one piece. No more than a row is in memory.
#pragma once

#include <cstddef>
#include <fstream>
#include <optional>
#include <vector>

#include "core/file/file_writing.h"
#include "core/program/errors.h"

namespace etalon {

// Part `index` of `count` of a work of many equal units that several machines do together: the
// units index - 1, index - 1 + count, ..., so that the parts take the same time.
struct Shard {
    std::size_t index = 1, count = 1;

    bool is_all() const { return count == 1; }
    bool holds(std::size_t unit) const { return unit % count == index - 1; }
    std::size_t units(std::size_t of) const { return (of + count - index) / count; }
};

// "2/5", of at most a million; "" is all. Throws ConfigError at --shard for anything else.
Shard parse_shard(const std::string& text);

// A kind of work that is done in shards, in words.
struct ShardedWork {
    const char* what;         // "study"
    const char* unit;         // "pose"
    const char* command;      // "study merge"
    const char* description;  // the file "study.json"
};

// One work of such a kind.
struct RowsDescription {
    ShardedWork work;
    std::string json;    // of the description file, with "shard"
    std::string header;  // the first line of results.csv, with its end
    std::size_t units = 0, rows_per_unit = 1;
};

// Writes the rows. Not thread-safe.
class RowRecord {
public:
    // Makes the folder, or continues the one that was made with the same description; what was half
    // written is cut off. Throws ConfigError (place --out) when the folder holds something else or
    // a work that differs: in what, is said. Throws it too while another program writes there.
    RowRecord(const std::filesystem::path& folder, const RowsDescription& description);

    const std::filesystem::path& folder() const { return folder_; }
    std::size_t units_done() const { return units_done_; }  // of the shard

    // All rows of the next unit, with line ends; in the file on return. Throws as fail_writing().
    void add(const std::string& rows);

private:
    void keep_whole_units(const RowsDescription& description);

    std::filesystem::path folder_;
    std::size_t units_done_ = 0;
    std::optional<FolderLock> lock_;
    std::optional<AppendFile> results_;
};

// The folders by their shards' index; `descriptions` are theirs, JSON with "shard". Throws
// ConfigError that says which are missing, doubled or of different works.
std::vector<std::filesystem::path> shards_in_order(
    const ShardedWork& work, const std::vector<std::filesystem::path>& folders,
    const std::vector<std::string>& descriptions);

// Reads the rows of all shards, unit by unit in the order of the work in one piece.
class ShardRows {
public:
    // `in_order`: of shards_in_order(). Throws ConfigError for a results.csv of other work.
    ShardRows(const std::vector<std::filesystem::path>& in_order, const RowsDescription& whole);

    // The next unit's rows, without line ends. Throws ConfigError where they are missing.
    const std::vector<std::string>& next();
    // Where row `i` of these stands.
    SourcePlace place(std::size_t i) const;

private:
    std::vector<std::filesystem::path> folders_;
    RowsDescription whole_;
    std::vector<std::ifstream> files_;
    std::size_t unit_ = 0;
    std::vector<std::string> rows_;
};

// Writes the whole from all shards. Throws ConfigError as above, or when `out` holds other things.
void merge_rows(const std::vector<std::filesystem::path>& in_order, const RowsDescription& whole,
                const std::filesystem::path& out);

}  // namespace etalon
