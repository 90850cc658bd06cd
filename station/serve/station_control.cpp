#include "station/serve/station_control.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <csignal>
#include <future>
#include <set>

#include "calib/files/camera_file.h"
#include "core/file/text.h"
#include "station/record/run_record.h"

namespace etalon {
namespace {

using Path = std::filesystem::path;

std::vector<Path> files_of(const Path& folder) {
    std::vector<Path> files;
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
        const std::string kind = entry.path().extension().string();
        std::error_code ignored;
        if ((kind == ".yml" || kind == ".yaml" || kind == ".json") &&
            entry.is_regular_file(ignored))
            files.push_back(entry.path());
    }
    if (error)
        throw ConfigError({folder.string()}, "cannot be read: " + error.message());
    std::ranges::sort(files);
    return files;
}

// The words after `head`, not all of a long list; nothing of an empty one.
std::string some_of(const std::string& head, const std::vector<std::string>& words,
                    const char* between) {
    constexpr std::size_t most = 8;
    if (words.empty())
        return "";
    const auto end = words.begin() + static_cast<std::ptrdiff_t>(std::min(words.size(), most));
    return head + fmt::format("{}", fmt::join(words.begin(), end, between)) +
           (words.size() > most ? fmt::format(" and {} more", words.size() - most) : "");
}

using namespace std::chrono_literals;

// In the order of Work.
constexpr const char* work_words[] = {"nothing", "a run", "homing", "a motion"};

void require_name(const std::string& who) {
    const auto is_control = [](unsigned char c) { return c < 0x20 || c == 0x7f; };
    if (trimmed(who).empty() || who.size() > 60 || std::ranges::any_of(who, is_control))
        throw ConfigError({"operator"}, "needs a name of 1 to 60 characters");
}

// Of the letters that a file name may have everywhere.
std::string new_record_name(const std::string& serial) {
    std::string name;
    for (const char c : serial)
        name += std::isalnum(static_cast<unsigned char>(c)) || c == '-' ? c : '_';
    return fmt::format("{}-{:%Y%m%dT%H%M%SZ}", name.substr(0, 40), fmt::gmtime(std::time(nullptr)));
}

// The line that a person needs: the program's own, without its name.
std::string reason_of(const SubprocessResult& ended) {
    const std::vector<std::string> lines = split(std::string(trimmed(ended.stderr_tail)), '\n');
    constexpr std::string_view mark = "etalon: ";
    for (const std::string& line : lines)
        if (line.starts_with(mark))
            return line.substr(mark.size());
    if (ended.exit_code < 0)
        return "was ended by a signal";
    return lines.empty() || lines.back().empty() ? fmt::format("ended with {}", ended.exit_code)
                                                 : lines.back();
}

}  // namespace

Calibrations read_calibrations(const Path& folder) {
    Calibrations read;
    for (const Path& file : files_of(folder)) {
        try {
            if (is_etalon_file(file))
                read.cameras.emplace_back(file, read_any_camera(file).serial);
        } catch (const ConfigError& error) {
            if (error.place().key != "etalon")  // of another kind: a station's file, for instance
                read.skipped.emplace_back(error.what());
        }
    }
    return read;
}

Path calibration_of(const Path& folder, const std::string& serial) {
    const Calibrations read = read_calibrations(folder);
    std::vector<Path> found;
    std::vector<std::string> others;
    for (const auto& [file, there] : read.cameras)
        if (!there.empty() && there == serial)
            found.push_back(file);
        else if (!there.empty())
            others.push_back(there);
    if (found.size() == 1)
        return found.front();
    if (found.size() > 1)
        throw ConfigError(
            {folder.string()},
            fmt::format("{} and {} are both of camera {}: keep one", found[0].filename().string(),
                        found[1].filename().string(), serial));
    throw ConfigError(
        {folder.string()},
        fmt::format("has no calibration of camera {}{}{}", serial,
                    some_of("; there are those of ", others, ", "),
                    some_of("; skipped, as it cannot be read: ", read.skipped, "; ")));
}

StationControl::StationControl(Workplace workplace)
    : workplace_(std::move(workplace)), stopper_([this](const std::stop_token& closing) {
          std::unique_lock lock(mutex_);
          const std::stop_callback wake(closing, [this] { changed_.notify_all(); });
          while (!closing.stop_requested()) {
              changed_.wait_for(lock, 1s, [&] { return stop_wanted_; });
              if (!std::exchange(stop_wanted_, false))
                  continue;
              lock.unlock();
              stop_all(closing);
              lock.lock();
          }
      }) {}

StationControl::~StationControl() {
    stopper_.request_stop();
    changed_.notify_all();
    stopper_.join();
    end_live();
    const Holder last = state().holder;
    program_.reset();  // in order, or after ten seconds by force
    if (last.work != Work::none)
        run_subprocess(this_program({"stage", "stop", station_at(last.station).file.string()}));
}

const StationSession& StationControl::station_at(std::size_t index) const {
    if (index >= workplace_.stations.size())
        throw ConfigError({"station"}, "there is no such one");
    return workplace_.stations[index];
}

void StationControl::begin(Work work, std::size_t station, const std::string& who,
                           const std::vector<std::string>& arguments, std::optional<ShownRun> run) {
    std::unique_ptr<Subprocess> over;  // joined when the lock is gone: its thread may want it
    const std::lock_guard lock(mutex_);
    if (state_.holder.work != Work::none)
        throw NotNow(fmt::format("{} by {} goes on since {}",
                                 work_words[static_cast<int>(state_.holder.work)],
                                 state_.holder.who, state_.holder.since_utc));
    if (is_closed_)
        throw NotNow("the server is about to end");
    over = std::move(program_);
    SubprocessOptions options;
    options.on_stderr_line = [this, work](const std::string& line) {
        const std::lock_guard inner(mutex_);
        if (work == Work::run && state_.run)
            state_.run->said = line;
    };
    options.on_end = [this, work](const SubprocessResult& ended) { has_ended(work, ended); };
    program_ = std::make_unique<Subprocess>(this_program(arguments), std::move(options));
    state_.holder = {work, station, who, utc_now()};
    if (run)
        state_.run = std::move(run);
    state_.failure.clear();
    state_.stop.clear();
}

void StationControl::has_ended(Work work, const SubprocessResult& ended) {
    {
        const std::lock_guard lock(mutex_);
        if (state_.holder.work == work)
            state_.holder = {};
        const bool went_wrong = ended.exit_code < 0 || ended.exit_code == ExitCode::usage_error ||
                                ended.exit_code == ExitCode::run_error;
        if (work == Work::run && state_.run) {
            state_.run->is_going = false;
            state_.run->failure = went_wrong ? reason_of(ended) : "";
        } else if (ended.exit_code != 0 && ended.exit_code != ExitCode::interrupted) {
            state_.failure = reason_of(ended);
        }
    }
    if (work != Work::run) {
        const std::lock_guard lock(status_mutex_);
        statuses_.clear();
    }
    changed_.notify_all();
}

void StationControl::begin_run(ShownRun run, const std::vector<std::string>& arguments) {
    end_live();
    run.is_going = true;
    begin(Work::run, run.station, run.operator_name, arguments, run);
    end_live();  // which somebody may have begun in between: the run waits for the camera
}

void StationControl::start_run(std::size_t station, const std::string& serial,
                               const std::string& who) {
    const StationSession& served = station_at(station);
    require_name(who);
    if (trimmed(serial).empty())
        throw ConfigError({"serial"}, "type or scan the camera's serial number");
    Path calibration = served.station.inputs.at(1).path;
    if (!workplace_.calibrations.empty())
        calibration = calibration_of(workplace_.calibrations, serial);
    else if (served.station.camera.model.serial != serial)
        throw ConfigError({served.file.string()},
                          fmt::format("names the calibration of camera {}, not {}",
                                      served.station.camera.model.serial, serial));
    const std::string record = new_record_name(serial);
    begin_run({record, station, serial, who},
              {"qualify", served.file.string(), "--calibration", calibration.string(), "--operator",
               who, "--out", (workplace_.records / record).string()});
}

void StationControl::resume_run(const std::string& record, const std::string& who) {
    require_name(who);
    const Path folder = record_named(record);
    RunMonitor watch(folder);
    watch.look();
    if (watch.state().inputs.empty())
        throw ConfigError({record}, "has no log that could be resumed");
    const std::size_t station = station_of(folder / watch.state().inputs.front().copy);
    begin_run({record, station, "", who},
              {"qualify", "--resume", folder.string(), "--operator", who});
}

void StationControl::pause_run() {
    const std::lock_guard lock(mutex_);
    if (state_.holder.work != Work::run || !state_.run)
        throw NotNow("no run goes on");
    state_.run->is_pausing = true;
    program_->send(SIGTERM);
}

void StationControl::home(std::size_t station, const std::string& who) {
    require_name(who);
    begin(Work::homing, station, who,
          {"stage", "home", station_at(station).file.string(), "--yes", "--operator", who});
}

void StationControl::jog(std::size_t station, const std::string& who, const std::string& axis,
                         double step) {
    require_name(who);
    const StationSession& served = station_at(station);
    const auto& axes = served.station.stage.axes;
    if (std::ranges::find(axes, axis, &Axis::name) == axes.end())
        throw ConfigError({"axis"}, "there is no such one");
    begin(Work::motion, station, who,
          {"stage", "jog", served.file.string(), fmt::format("{}={}", axis, exact(step)),
           "--operator", who});
}

// The one whose stage a record's copy names: that is what would have to be stopped.
std::size_t StationControl::station_of(const Path& copy) const {
    const std::string stage = describe(read_station_stage(copy).link);
    for (std::size_t i = 0; i < workplace_.stations.size(); ++i)
        if (describe(workplace_.stations[i].station.stage.link) == stage)
            return i;
    throw ConfigError({copy.string()},
                      fmt::format("names the stage {}, which this page does not serve", stage));
}

void StationControl::stop() {
    const std::lock_guard lock(mutex_);
    if (program_)
        program_->send(SIGTERM);
    state_.stop = "stopping";
    stop_wanted_ = true;
    changed_.notify_all();
}

void StationControl::close() {
    const std::lock_guard lock(mutex_);
    is_closed_ = true;
    if (program_)
        program_->send(SIGTERM);
}

// All at once, as one may not answer. Why it is not known that one stands still, or empty.
std::string StationControl::stop_stages() const {
    std::set<std::string> stages;
    std::vector<std::pair<std::string, std::future<SubprocessResult>>> stops;
    for (const StationSession& served : workplace_.stations)
        if (stages.insert(describe(served.station.stage.link)).second)
            stops.emplace_back(served.station.id,
                               std::async(std::launch::async, run_subprocess,
                                          this_program({"stage", "stop", served.file.string()})));
    std::string failure;
    for (auto& [station, stopped] : stops)
        if (const SubprocessResult ended = stopped.get(); ended.exit_code != 0)
            failure += (failure.empty() ? "" : "; ") + station + ": " + reason_of(ended);
    return failure;
}

bool StationControl::wait_for_end(std::unique_lock<std::mutex>& lock, std::chrono::seconds time) {
    return changed_.wait_for(lock, time, [this] { return state_.holder.work == Work::none; });
}

// A healthy program has stopped its axes within the first second and says so in its record. The
// second connection is for one that hangs; where all went well it only confirms.
void StationControl::stop_all(const std::stop_token& closing) {
    std::unique_lock lock(mutex_);
    wait_for_end(lock, 1s);
    lock.unlock();
    std::string failure = stop_stages();
    lock.lock();
    if (!closing.stop_requested() && !wait_for_end(lock, 9s)) {
        program_->send(SIGKILL);
        wait_for_end(lock, 2s);
        lock.unlock();
        failure = stop_stages();
        lock.lock();
    }
    state_.stop = failure.empty() ? "confirmed" : failure;
}

std::string StationControl::stage_status(std::size_t station) {
    const StationSession& served = station_at(station);
    const std::lock_guard lock(status_mutex_);
    Status& status = statuses_[station];
    const Instant now = SteadyClock().now();
    if (state().holder.work != Work::none || (status.at != Instant{} && now - status.at < 1s))
        return status.json;
    const SubprocessResult ended =
        run_subprocess(this_program({"stage", "status", served.file.string(), "--json"}));
    status.json = ended.exit_code == 0 ? ended.output : "";
    status.at = SteadyClock().now();
    if (ended.exit_code != 0) {
        const std::lock_guard inner(mutex_);
        state_.failure = reason_of(ended);
    }
    return status.json;
}

void StationControl::start_live(std::size_t station) {
    const StationSession& served = station_at(station);
    const std::lock_guard lock(mutex_);
    if (state_.holder.work == Work::run)
        throw NotNow(fmt::format("a run by {} has the camera", state_.holder.who));
    if (!live_ || live_->has_ended())
        live_ = std::make_shared<LiveCamera>(served.station);
}

void StationControl::end_live() {
    std::shared_ptr<LiveCamera> live;
    {
        const std::lock_guard lock(mutex_);
        live = std::move(live_);
    }
    if (live)
        live->release();
}

std::shared_ptr<LiveCamera> StationControl::live() const {
    const std::lock_guard lock(mutex_);
    return live_;
}

ControlState StationControl::state() const {
    const std::lock_guard lock(mutex_);
    return state_;
}

Path StationControl::record_named(const std::string& name) const {
    const bool is_plain = !name.empty() && name.size() <= 200 && name[0] != '.' &&
                          name.find('/') == std::string::npos &&
                          name.find('\0') == std::string::npos;
    const auto is_own = [&](const Path& path, std::filesystem::file_type type) {
        std::error_code ignored;  // a link may lead anywhere
        return std::filesystem::symlink_status(path, ignored).type() == type;
    };
    const Path record = workplace_.records / name;
    if (!is_plain || !is_own(record, std::filesystem::file_type::directory) ||
        !is_own(record / log_file, std::filesystem::file_type::regular))
        throw ConfigError({"record"}, "is no record of this page");
    return record;
}

}  // namespace etalon
