#include "core/program/subprocess.h"

#include <fcntl.h>
#include <linux/close_range.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <deque>
#include <future>
#include <memory>

namespace etalon {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t most_output = 1u << 20, most_line = 4096, kept_lines = 6;
constexpr const char* own_file = "/proc/self/exe";
constexpr Duration patience = 10s;  // between SIGTERM and SIGKILL

void require(bool is_done) {
    if (!is_done)
        throw std::system_error(errno, std::generic_category());
}

class Descriptor {
public:
    Descriptor() = default;
    ~Descriptor() { reset(); }
    Descriptor(const Descriptor&) = delete;
    Descriptor& operator=(const Descriptor&) = delete;

    operator int() const { return number_; }
    void reset(int number = -1) {
        if (number_ >= 0)
            close(number_);
        number_ = number;
    }
    int release() { return std::exchange(number_, -1); }

private:
    int number_ = -1;
};

void make_pipe(Descriptor& read_end, Descriptor& write_end) {
    std::array<int, 2> ends{};
    require(pipe2(ends.data(), O_CLOEXEC) == 0);
    read_end.reset(ends[0]);
    write_end.reset(ends[1]);
}

// A socket: writing to a program that has ended is an error and no SIGPIPE.
void make_socket(Descriptor& ours, Descriptor& theirs) {
    std::array<int, 2> ends{};
    require(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) == 0);
    ours.reset(ends[0]);
    theirs.reset(ends[1]);
}

// Lines as they come, and the last of them.
class LineReader {
public:
    explicit LineReader(const std::function<void(const std::string&)>& on_line)
        : on_line_(on_line) {}

    void add(std::string_view text) {
        for (const char c : text) {
            if (c != '\n' && line_.size() < most_line)
                line_ += c;
            if (c == '\n')
                end_line();
        }
    }
    std::string tail() {
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
        if (on_line_)
            on_line_(line_);
        last_.push_back(std::move(line_));
        if (last_.size() > kept_lines)
            last_.pop_front();
        line_.clear();
    }

    const std::function<void(const std::string&)>& on_line_;
    std::string line_;
    std::deque<std::string> last_;
};

// What there is; calls `take` with it. False at the end of the file.
template <class Take>
bool read_some(int file, Take take) {
    std::array<char, 4096> bytes{};
    for (;;) {
        const ssize_t count = read(file, bytes.data(), bytes.size());
        if (count > 0)
            take(std::string_view(bytes.data(), static_cast<std::size_t>(count)));
        else if (count == 0 || errno != EINTR)
            return count < 0 && errno == EAGAIN;
    }
}

int poll_limit(Duration left) {
    return static_cast<int>(std::clamp<std::int64_t>(
        std::chrono::ceil<std::chrono::milliseconds>(left).count(), 0, 1'000'000));
}

// A thread that is started inside takes no signals: they are for the thread that waits for them.
class BlockedSignals {
public:
    BlockedSignals() {
        sigset_t all;
        sigfillset(&all);
        pthread_sigmask(SIG_SETMASK, &all, &before_);
    }
    ~BlockedSignals() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
    BlockedSignals(const BlockedSignals&) = delete;
    BlockedSignals& operator=(const BlockedSignals&) = delete;

private:
    sigset_t before_{};
};

}  // namespace

struct Subprocess::Files {
    Descriptor input, output, errors, failure;  // ends of the child; failure: errno of exec
    Descriptor from_output, from_errors, from_failure, end;  // ours; end: the process itself
    std::vector<std::string> words;
    std::vector<char*> arguments;
    const char* program = nullptr;

    Files(const std::vector<std::string>& command, const SubprocessOptions& options)
        : words(command), program(command.at(0).c_str()) {
        if (words[0] == own_file)
            words[0] = program_invocation_name;
        for (std::string& word : words)
            arguments.push_back(word.data());
        arguments.push_back(nullptr);
        make_pipe(from_output, output);
        make_pipe(from_failure, failure);
        if (!options.inherits_stderr) {
            make_pipe(from_errors, errors);
            fcntl(from_errors, F_SETFL, O_NONBLOCK);
        }
        fcntl(from_output, F_SETFL, O_NONBLOCK);
        if (!options.has_input)
            input.reset(open("/dev/null", O_RDONLY | O_CLOEXEC));
    }

    // Between fork and exec only what is safe there: no memory is asked for.
    [[noreturn]] void become_program(pid_t parent) const {
        prctl(PR_SET_PDEATHSIG, SIGTERM);
        if (getppid() != parent)  // it died in between
            _exit(1);
        for (int signal = 1; signal < NSIG; ++signal)
            std::signal(signal, SIG_DFL);
        sigset_t none;
        sigemptyset(&none);
        sigprocmask(SIG_SETMASK, &none, nullptr);
        setpgid(0, 0);
        dup2(input, STDIN_FILENO);
        dup2(output, STDOUT_FILENO);
        if (errors >= 0)
            dup2(errors, STDERR_FILENO);
        close_range(STDERR_FILENO + 1, ~0u, CLOSE_RANGE_CLOEXEC);
        execvp(program, arguments.data());
        const int error = errno;
        [[maybe_unused]] const ssize_t count = ::write(failure, &error, sizeof error);
        _exit(127);
    }

    // Returns its id, or throws std::system_error.
    pid_t start() {
        const pid_t parent = getpid();
        const pid_t child = fork();
        if (child == 0)
            become_program(parent);
        require(child > 0);
        for (Descriptor* theirs : {&input, &output, &errors, &failure})
            theirs->reset();
        int error = 0;
        if (read(from_failure, &error, sizeof error) == 0)
            end.reset(static_cast<int>(syscall(SYS_pidfd_open, child, 0)));
        else
            errno = error;
        if (end < 0) {
            error = errno;
            kill(child, SIGKILL);
            waitpid(child, nullptr, 0);
            throw std::system_error(error, std::generic_category());
        }
        return child;
    }
};

Subprocess::Subprocess(const std::vector<std::string>& command, SubprocessOptions options)
    : options_(std::move(options)) {
    auto files = std::make_unique<Files>(command, options_);
    Descriptor ours;
    if (options_.has_input)
        make_socket(ours, files->input);
    std::promise<void> promise;
    std::future<void> started = promise.get_future();
    {
        const BlockedSignals blocked;
        // The kernel's SIGTERM follows the thread that forks: it lives as long as the child.
        thread_ = std::thread([this, &promise, files = std::move(files)] {
            try {
                process_ = files->start();
                promise.set_value();
            } catch (const std::system_error&) {
                promise.set_exception(std::current_exception());
                return;
            }
            follow(*files);
        });
    }
    try {
        started.get();
    } catch (...) {
        thread_.join();
        throw;
    }
    input_ = ours.release();
}

Subprocess::~Subprocess() {
    send(SIGTERM);
    if (!wait_for(patience))
        send(SIGKILL);
    thread_.join();
    if (input_ >= 0)
        close(input_);
}

bool Subprocess::send(int signal) {
    const std::lock_guard lock(mutex_);
    return process_ > 0 && kill(signal == SIGKILL ? -process_ : process_, signal) == 0;
}

std::error_code Subprocess::write(std::string_view text, Duration limit) {
    const Instant deadline = SteadyClock().now() + limit;
    while (!text.empty()) {
        pollfd ready{input_, POLLOUT, 0};
        const int count = poll(&ready, 1, poll_limit(deadline - SteadyClock().now()));
        if (count == 0)
            return std::make_error_code(std::errc::timed_out);
        const ssize_t sent =
            count < 0 ? -1 : ::send(input_, text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
        if (sent > 0)
            text.remove_prefix(static_cast<std::size_t>(sent));
        else if (errno != EINTR && errno != EAGAIN)
            return {errno, std::generic_category()};
    }
    return {};
}

void Subprocess::close_input() {
    shutdown(input_, SHUT_WR);
}

std::string Subprocess::read_output(Duration limit) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, limit,
                      [this] { return !result_.output.empty() || has_closed_output_; });
    return std::exchange(result_.output, {});
}

bool Subprocess::has_closed_output() const {
    const std::lock_guard lock(mutex_);
    return has_closed_output_;
}

bool Subprocess::wait_for(Duration limit, const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, stop, limit, [this] { return process_ == 0; });
}

SubprocessResult Subprocess::result() const {
    const std::lock_guard lock(mutex_);
    return result_;
}

void Subprocess::follow(Files& files) {
    LineReader lines(options_.on_stderr_line);
    std::array<pollfd, 3> sources{
        {{files.from_output, POLLIN, 0}, {files.from_errors, POLLIN, 0}, {files.end, POLLIN, 0}}};
    const auto take = [this](std::string_view text) {
        const std::lock_guard lock(mutex_);
        result_.output.append(text.substr(0, most_output - result_.output.size()));
    };
    bool has_ended = false;
    while (!has_ended) {
        poll(sources.data(), sources.size(), -1);
        has_ended = sources[2].revents != 0;
        if (has_ended)
            kill(-process_, SIGKILL);  // what it left running; until it is reaped the id is its own
        if (sources[0].fd >= 0 && !read_some(sources[0].fd, take))
            sources[0].fd = -1;
        if (sources[1].fd >= 0 &&
            !read_some(sources[1].fd, [&](std::string_view text) { lines.add(text); }))
            sources[1].fd = -1;
        const std::lock_guard lock(mutex_);
        has_closed_output_ = has_ended || sources[0].fd < 0;
        changed_.notify_all();
    }
    end(lines.tail());
}

void Subprocess::end(std::string stderr_tail) {
    {
        const std::lock_guard lock(mutex_);  // nobody signals the id of another process
        int status = 0;
        while (waitpid(process_, &status, 0) < 0 && errno == EINTR) {
        }
        result_.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
        result_.signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
        result_.stderr_tail = std::move(stderr_tail);
        process_ = 0;
    }
    changed_.notify_all();
    if (options_.on_end)
        options_.on_end(result());
}

std::vector<std::string> this_program(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), own_file);
    return arguments;
}

SubprocessResult run_subprocess(const std::vector<std::string>& command) {
    try {
        Subprocess process(command);
        process.wait_for(no_time_limit);
        return process.result();
    } catch (const std::system_error& error) {
        return {-1, 0, "", error.what()};
    }
}

}  // namespace etalon
