#include "station/serve/child_program.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <deque>
#include <future>
#include <system_error>

#include "core/time/clock.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t most_output = 1u << 20, most_line = 4096, kept_lines = 6;
constexpr Duration patience = 10s;

struct Pipe {
    std::array<int, 2> ends{-1, -1};
    Pipe() {
        if (pipe2(ends.data(), O_CLOEXEC) != 0)
            throw std::system_error(errno, std::generic_category(), "no pipe for a program");
    }
    ~Pipe() {
        close(ends[0]);
        close(ends[1]);
    }
    Pipe(const Pipe&) = delete;
    Pipe& operator=(const Pipe&) = delete;
};

// Between fork and exec only what is safe there: no memory is asked for.
[[noreturn]] void become(char* const* arguments, int output, int errors, pid_t parent) {
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent)  // it died in between
        _exit(1);
    sigset_t none;
    sigemptyset(&none);
    sigprocmask(SIG_SETMASK, &none, nullptr);
    setpgid(0, 0);  // a Ctrl-C in the terminal is for the parent, which asks in order
    dup2(output, STDOUT_FILENO);
    dup2(errors, STDERR_FILENO);
    const int nothing = open("/dev/null", O_RDONLY);
    dup2(nothing, STDIN_FILENO);
    close_range(3, ~0u, 0);
    execv("/proc/self/exe", arguments);
    _exit(127);
}

// Lines as they come, and the last of them.
class LineReader {
public:
    explicit LineReader(const std::function<void(const std::string&)>& said) : said_(said) {}

    void add(std::string_view text) {
        for (const char c : text) {
            if (c != '\n' && line_.size() < most_line)
                line_ += c;
            if (c == '\n')
                end_line();
        }
    }
    std::string last_words() {
        end_line();
        std::string text;
        for (const std::string& line : last_)
            text += line + "\n";
        return text;
    }

private:
    void end_line() {
        if (line_.empty())
            return;
        if (said_)
            said_(line_);
        last_.push_back(std::move(line_));
        if (last_.size() > kept_lines)
            last_.pop_front();
        line_.clear();
    }

    const std::function<void(const std::string&)>& said_;
    std::string line_;
    std::deque<std::string> last_;
};

}  // namespace

ChildProgram::ChildProgram(const std::vector<std::string>& arguments,
                           std::function<void(const std::string& line)> said,
                           std::function<void(const EndedProgram&)> ended)
    : said_(std::move(said)), ended_(std::move(ended)) {
    Pipe output, errors;
    std::vector<std::string> words = {"etalon"};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> argv;
    for (std::string& word : words)
        argv.push_back(word.data());
    argv.push_back(nullptr);
    std::promise<int> started;
    std::future<int> process = started.get_future();
    // The death of the thread that forks is what the child hears of: it lives as long as the child.
    const int from = fcntl(output.ends[0], F_DUPFD_CLOEXEC, 0);
    const int errors_from = fcntl(errors.ends[0], F_DUPFD_CLOEXEC, 0);
    thread_ = std::thread([&, this, from, errors_from, promise = std::move(started)]() mutable {
        const pid_t parent = getpid();
        const pid_t child = fork();
        if (child == 0)
            become(argv.data(), output.ends[1], errors.ends[1], parent);
        process_ = child;
        promise.set_value(child < 0 ? errno : 0);  // from here on nothing of the caller's is used
        if (child > 0)
            follow(from, errors_from);
    });
    if (const int error = process.get()) {
        thread_.join();
        close(from);
        close(errors_from);
        throw std::system_error(error, std::generic_category(), "no process for a program");
    }
}

ChildProgram::~ChildProgram() {
    send(SIGTERM);
    {
        std::unique_lock lock(mutex_);
        over_.wait_for(lock, patience, [this] { return process_ == 0; });
    }
    send(SIGKILL);
    thread_.join();
}

bool ChildProgram::send(int signal) {
    const std::lock_guard lock(mutex_);
    // By force with all that it began: it leads a group of its own.
    return process_ > 0 && kill(signal == SIGKILL ? -process_ : process_, signal) == 0;
}

void ChildProgram::follow(int output, int errors) {
    EndedProgram ended = read_all(output, errors);
    close(output);
    close(errors);
    siginfo_t info{};
    while (waitid(P_PID, static_cast<id_t>(process_), &info, WEXITED | WNOWAIT) != 0 &&
           errno == EINTR) {
    }
    {
        // Reaped under the lock: until then the number is its own, and no other's is signalled.
        const std::lock_guard lock(mutex_);
        int status = 0;
        waitpid(process_, &status, 0);
        ended.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
        process_ = 0;
    }
    over_.notify_all();
    if (ended_)
        ended_(ended);
}

EndedProgram ChildProgram::read_all(int output, int errors) {
    EndedProgram ended;
    LineReader lines(said_);
    std::array<pollfd, 2> sources{{{output, POLLIN, 0}, {errors, POLLIN, 0}}};
    std::array<char, 4096> bytes{};
    while (sources[0].fd >= 0 || sources[1].fd >= 0) {
        if (poll(sources.data(), sources.size(), -1) < 0 && errno != EINTR)
            break;
        for (pollfd& source : sources) {
            if (source.fd < 0 || source.revents == 0)
                continue;
            const ssize_t count = read(source.fd, bytes.data(), bytes.size());
            if (count <= 0 && !(count < 0 && errno == EINTR))
                source.fd = -1;
            else if (source.fd == errors)
                lines.add({bytes.data(), static_cast<std::size_t>(std::max<ssize_t>(count, 0))});
            else if (count > 0 && ended.output.size() < most_output)
                ended.output.append(bytes.data(), static_cast<std::size_t>(count));
        }
    }
    ended.last_words = lines.last_words();
    return ended;
}

EndedProgram run_program(const std::vector<std::string>& arguments) {
    std::promise<EndedProgram> promise;
    std::future<EndedProgram> ended = promise.get_future();
    try {
        const ChildProgram program(arguments, {},
                                   [&](const EndedProgram& end) { promise.set_value(end); });
        return ended.get();
    } catch (const std::system_error& error) {
        return {-1, "", error.what()};
    }
}

}  // namespace etalon
