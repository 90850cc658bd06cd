#include "station/history/run_index.h"

#include <fmt/format.h>
#include <sqlite3.h>
#include <sys/stat.h>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <map>
#include <set>

#include "core/file/text.h"
#include "report/json_text.h"

namespace etalon {
namespace {

using Path = std::filesystem::path;

constexpr int index_version = 3;  // of the table below
constexpr const char* tables = R"(
    CREATE TABLE run(record TEXT PRIMARY KEY, stamp TEXT, started_utc TEXT, outcome TEXT,
        camera TEXT, station TEXT, run_json TEXT);
    CREATE INDEX run_started ON run(started_utc);)";

class IndexError : public Error {
public:
    explicit IndexError(const char* text) : Error(text) {}
    explicit IndexError(sqlite3* database)
        : Error(sqlite3_errmsg(database)), code_(sqlite3_errcode(database) & 0xff) {}

    [[noreturn]] void fail_in(const Path& folder) const {
        const SourcePlace place{(folder / run_index_file).string()};
        if (code_ == SQLITE_FULL || code_ == SQLITE_IOERR)
            throw DiskError(place, what());
        throw ConfigError(place, what());
    }

private:
    int code_ = SQLITE_ERROR;
};

// One statement. Columns and parameters count as in SQLite, from 0 and from 1.
class Statement {
public:
    Statement(sqlite3* database, const std::string& sql) : database_(database) {
        check(sqlite3_prepare_v2(database, sql.c_str(), -1, &statement_, nullptr));
    }
    ~Statement() { sqlite3_finalize(statement_); }
    Statement(const Statement&) = delete;
    Statement& operator=(const Statement&) = delete;

    Statement& bind(const std::string& text) {
        check(sqlite3_bind_text(statement_, ++bound_, text.c_str(), static_cast<int>(text.size()),
                                SQLITE_TRANSIENT));
        return *this;
    }
    Statement& bind(long long number) {
        check(sqlite3_bind_int64(statement_, ++bound_, number));
        return *this;
    }
    bool next() {
        const int code = sqlite3_step(statement_);
        if (code != SQLITE_ROW && code != SQLITE_DONE)
            check(code);
        return code == SQLITE_ROW;
    }
    void run() { next(); }
    std::string text(int column) const {
        const auto* bytes = sqlite3_column_text(statement_, column);
        return bytes ? reinterpret_cast<const char*>(bytes) : "";
    }
    int number(int column) const { return sqlite3_column_int(statement_, column); }

private:
    void check(int code) const {
        if (code != SQLITE_OK)
            throw IndexError(database_);
    }

    sqlite3* database_;
    sqlite3_stmt* statement_ = nullptr;
    int bound_ = 0;
};

void execute(sqlite3* database, const std::string& sql) {
    if (sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK)
        throw IndexError(database);
}

int version_of(sqlite3* database) {
    Statement version(database, "PRAGMA user_version");
    version.next();
    return version.number(0);
}

// Changes whenever the file does: it is replaced, never written over.
std::string stamp_of(const Path& run_file) {
    struct stat status {};
    if (stat(run_file.c_str(), &status) != 0)
        return {};
    return fmt::format("{} {} {}.{:09}", status.st_ino, status.st_size, status.st_mtim.tv_sec,
                       status.st_mtim.tv_nsec);
}

std::set<std::string> records_of(const Path& folder) {
    std::set<std::string> records;
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error))
        if (std::error_code ignored;
            std::filesystem::is_regular_file(entry.path() / "run.json", ignored))
            records.insert(entry.path().filename().string());
    return records;
}

std::map<std::string, std::string> known_stamps(sqlite3* database) {
    std::map<std::string, std::string> known;
    Statement all(database, "SELECT record, stamp FROM run");
    while (all.next())
        known[all.text(0)] = all.text(1);
    return known;
}

void forget(sqlite3* database, const std::string& record) {
    Statement(database, "DELETE FROM run WHERE record = ?").bind(record).run();
}

}  // namespace

RunIndex::RunIndex(Path folder) : folder_(std::move(folder)) {
    try {
        open();
    } catch (const IndexError&) {  // it is made from the records alone: again
        sqlite3_close(database_);
        std::error_code ignored;
        std::filesystem::remove(folder_ / run_index_file, ignored);
        try {
            open();
        } catch (const IndexError& error) {
            sqlite3_close(database_);
            error.fail_in(folder_);
        }
    }
}

RunIndex::~RunIndex() {
    sqlite3_close(database_);
}

void RunIndex::open() {
    const Path file = folder_ / run_index_file;
    if (sqlite3_open(file.c_str(), &database_) != SQLITE_OK)
        throw IndexError(database_);
    sqlite3_busy_timeout(database_, 5000);
    execute(database_, "PRAGMA synchronous = OFF");  // what a power cut breaks is made again
    execute(database_, "BEGIN IMMEDIATE");           // two programs may come to make it
    const int found = version_of(database_);
    if (found == 0)
        execute(database_, fmt::format("{} PRAGMA user_version = {};", tables, index_version));
    execute(database_, "COMMIT");
    if (found != 0 && found != index_version)
        throw IndexError("of another version");
    known_stamps(database_);
}

IndexUpdate RunIndex::update() {
    IndexUpdate update;
    try {
        execute(database_, "BEGIN IMMEDIATE");
        std::map<std::string, std::string> known = known_stamps(database_);
        for (const std::string& record : records_of(folder_)) {
            const std::string stamp = stamp_of(folder_ / record / "run.json");
            const bool is_known = known.contains(record) && known[record] == stamp;
            known.erase(record);
            if (is_known)
                continue;
            forget(database_, record);
            try {
                take(folder_ / record, stamp);
                ++update.read;
            } catch (const ConfigError& error) {
                update.refused.emplace_back(error.what());
            }
        }
        for (const auto& [record, stamp] : known)
            forget(database_, record);
        update.gone = static_cast<int>(known.size());
        Statement count(database_, "SELECT count(*) FROM run");
        count.next();
        update.runs = count.number(0);
        count.run();
        execute(database_, "COMMIT");
    } catch (const IndexError& error) {
        sqlite3_exec(database_, "ROLLBACK", nullptr, nullptr, nullptr);
        error.fail_in(folder_);
    }
    return update;
}

void RunIndex::take(const Path& record, const std::string& stamp) {
    const HistoricRun run = read_run(record, read_text(record / "run.json"));
    const Json all = read_json(record / "run.json");
    Json kept;
    for (const char* key : historic_keys)
        if (all.contains(key))
            kept[key] = all[key];
    Statement row(database_, "INSERT INTO run VALUES(?, ?, ?, ?, ?, ?, ?)");
    for (const std::string& cell : {record.filename().string(), stamp, run.started_utc, run.outcome,
                                    run.camera, run.station, kept.dump()})
        row.bind(cell);
    row.run();
}

std::vector<HistoricRun> RunIndex::runs(const RunFilter& filter) const {
    std::string sql =
        "SELECT record, run_json FROM run WHERE (?1 = '' OR camera = ?1) AND "
        "(?2 = '' OR station = ?2) AND (?3 = '' OR outcome = ?3)";
    if (filter.unfinished)
        sql += " AND outcome IN ('ERROR', 'ABORTED')";
    sql += " ORDER BY started_utc DESC, camera DESC, record DESC LIMIT ?4";
    try {
        Statement rows(database_, sql);
        rows.bind(filter.camera).bind(filter.station).bind(filter.outcome);
        rows.bind(static_cast<long long>(filter.at_most));
        std::vector<HistoricRun> runs;
        while (rows.next())
            runs.push_back(read_run(folder_ / rows.text(0), rows.text(1)));
        std::ranges::reverse(runs);
        return runs;
    } catch (const IndexError& error) {
        error.fail_in(folder_);
    }
}

}  // namespace etalon
