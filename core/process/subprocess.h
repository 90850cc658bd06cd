// Another program as a child process, in a process group of its own: a Ctrl-C is for the parent,
// which ends it in order. It gets SIGTERM when the parent dies (PR_SET_PDEATHSIG, so fork() and no
// posix_spawn()); what it left running in its group is killed when it ends. It inherits none of our
// files but stderr, where asked for, and no blocked or ignored signals.
#pragma once

#include <functional>
#include <system_error>
#include <thread>
#include <vector>

#include "core/file/file_descriptor.h"
#include "core/time/clock.h"

namespace etalon {

struct SubprocessResult {
    int exit_code = -1;       // -1: a signal ended it
    int signal = 0;           // that ended it; 0: none
    std::string output;       // what was not taken by read_output(): the first MiB
    std::string stderr_tail;  // the last lines; empty where stderr is inherited
};

// Both functions are called on a thread of the subprocess.
struct SubprocessOptions {
    bool has_input = false;        // stdin is what write() sends; otherwise it is empty
    bool inherits_stderr = false;  // otherwise its tail is kept
    std::function<void(const std::string& line)> on_stderr_line = {};
    std::function<void(const SubprocessResult&)> on_end = {};
};

// The command that runs this very program, even when its file has been replaced since.
std::vector<std::string> this_program(std::vector<std::string> arguments);

inline constexpr Duration no_time_limit = std::chrono::hours(24 * 365);

// Thread-safe, but for write() and read_output(): each from one thread at a time.
class Subprocess {
public:
    // command[0] is looked for as a shell does. Throws std::system_error when it cannot be started.
    explicit Subprocess(const std::vector<std::string>& command, SubprocessOptions options = {});
    // SIGTERM, SIGKILL 10 s later, and waits.
    ~Subprocess();

    // SIGKILL goes to the whole group. False when it has ended before.
    bool send(int signal);

    // timed_out when the program does not read in time, broken_pipe when it reads no more.
    std::error_code write(std::string_view text, Duration limit);
    void close_input();

    // Takes what it has printed on stdout; waits for it if there is nothing. Empty when nothing
    // came in time, or nothing comes any more.
    std::string read_output(Duration limit);
    bool has_closed_output() const;

    // Waits for the end. False when the time is over or a stop requested first.
    bool wait_for(Duration limit, const std::stop_token& stop = {});
    SubprocessResult result() const;  // after the end

private:
    void start(const std::vector<std::string>& command);
    void follow();
    void add_errors(std::string_view text);

    SubprocessOptions options_;
    mutable std::mutex mutex_;
    std::condition_variable_any changed_;
    int process_ = 0;                     // 0: it has ended
    FileDescriptor talk_, errors_, end_;  // its stdin and stdout, its stderr, its pidfd
    bool has_closed_output_ = false;
    std::string line_;  // of stderr, not yet whole
    SubprocessResult result_;
    std::thread thread_;
};

// Runs it to its end. One that cannot be started has ended with -1 and the reason as its stderr.
SubprocessResult run_subprocess(const std::vector<std::string>& command);

}  // namespace etalon
