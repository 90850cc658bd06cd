// What the page may make the stations do, and who does it: one run or motion at a time, however
// many browsers look on.
//
// Every run and motion is a command of `etalon` in a process of its own
// (core/process/subprocess.h), so the page and the command line drive the same runner, a run that
// hangs can be stopped all the same, and one that the server's death ends is resumed from its
// record. Besides these, the server itself holds at most a camera, for its live picture.
//
// Safe from every thread.
#pragma once

#include "core/process/subprocess.h"
#include "station/serve/live_camera.h"
#include "station/serve/run_monitor.h"

namespace etalon {

// The files (`etalon: camera/1`) of a folder with their serial numbers. One that cannot be read
// (broken, not UTF-8, not permitted) is skipped: no other camera waits for it. 0.2 ms each. Throws
// ConfigError for a folder that cannot be read.
struct Calibrations {
    std::vector<std::pair<std::filesystem::path, std::string>> cameras;
    std::vector<std::string> skipped;  // "FILE:line: why"
};
Calibrations read_calibrations(const std::filesystem::path& folder);

// The one that has this serial number. Throws ConfigError when none has it, naming those there and
// those skipped, or several.
std::filesystem::path calibration_of(const std::filesystem::path& folder,
                                     const std::string& serial);

// What cannot be done now, in a sentence for the operator.
class NotNow : public Error {
public:
    using Error::Error;
};

struct StationSession {
    std::filesystem::path file;
    StationFile station;
};

struct Workplace {
    std::vector<StationSession> stations;
    std::filesystem::path records;       // where runs are kept
    std::filesystem::path calibrations;  // empty: each station's own
};

enum class Work { none, run, homing, motion };

// Who does what.
struct Holder {
    Work work = Work::none;
    std::size_t station = 0;
    std::string who, since_utc;
};

// The run that the page shows: the one that goes on, else the last one that it began.
struct ShownRun {
    std::string name;  // of its record's folder
    std::size_t station = 0;
    std::string serial, operator_name;
    bool is_going = false;
    bool is_pausing = false;  // asked to end so that it can be resumed
    std::string said;         // the program's last line
    std::string failure;      // why it ended without an outcome
};

struct ControlState {
    Holder holder;
    std::optional<ShownRun> run;
    std::string failure;  // of the last motion or stop; empty: it went well
    std::string stop;     // the last one: "stopping", "confirmed", or why not; empty: none yet
};

class StationControl {
public:
    explicit StationControl(Workplace workplace);
    ~StationControl();  // ends what goes on, in order

    // Throws NotNow while something goes on, ConfigError for what cannot be. who: 1 to 60 letters.
    void start_run(std::size_t station, const std::string& serial, const std::string& who);
    void resume_run(const std::string& record, const std::string& who);
    void pause_run();
    void home(std::size_t station, const std::string& who);
    void jog(std::size_t station, const std::string& who, const std::string& axis, double step);

    // At any time, by anybody: asks what goes on to end, then stops the axes of every station by
    // connections of their own, whether or not it has ended, and kills what has not after 10 s.
    void stop();
    // Asks what goes on to end, and lets nothing more begin: the server is about to end.
    void close();

    // `etalon stage status --json`, asked once a second and while nothing moves. Empty: not known.
    std::string stage_status(std::size_t station);

    void start_live(std::size_t station);
    void end_live();
    std::shared_ptr<LiveCamera> live() const;

    const Workplace& workplace() const { return workplace_; }
    const StationSession& station_at(std::size_t index) const;  // throws ConfigError without one
    ControlState state() const;
    // What the record of this name is: a folder in `records`, never anything else.
    std::filesystem::path record_named(const std::string& name) const;

private:
    struct Status {
        Instant at{};
        std::string json;
    };
    std::size_t station_of(const std::filesystem::path& copy) const;
    void begin(Work work, std::size_t station, const std::string& who,
               const std::vector<std::string>& arguments, std::optional<ShownRun> run = {});
    void begin_run(ShownRun run, const std::vector<std::string>& arguments);
    void has_ended(Work work, const SubprocessResult& ended);
    std::string stop_stages() const;
    void stop_all(const std::stop_token& closing);
    bool wait_for_end(std::unique_lock<std::mutex>& lock, std::chrono::seconds time);

    const Workplace workplace_;
    mutable std::mutex mutex_;
    std::condition_variable changed_;
    ControlState state_;
    bool stop_wanted_ = false, is_closed_ = false;
    std::map<std::size_t, Status> statuses_;
    std::mutex status_mutex_;
    std::shared_ptr<LiveCamera> live_;
    std::unique_ptr<Subprocess> program_;
    std::jthread stopper_;
};

}  // namespace etalon
