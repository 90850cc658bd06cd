#include "core/process/subprocess.h"

#include <linux/close_range.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <future>

namespace etalon {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t most_output = 1u << 20, most_line = 4096;
constexpr std::ptrdiff_t kept_lines = 6;
constexpr Duration patience = 10s;  // between SIGTERM and SIGKILL
constexpr const char* own_file = "/proc/self/exe";

// Sockets and no pipes: writing to a program that has ended is then an error and no SIGPIPE.
struct SocketPair {
    FileDescriptor ours, theirs;

    SocketPair() {
        std::array<int, 2> ends{};
        if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0)
            throw std::system_error(errno, std::generic_category());
        ours = FileDescriptor(ends[0]);
        theirs = FileDescriptor(ends[1]);
    }
};

// Between fork and exec only what is safe there: no memory is asked for.
[[noreturn]] void become(const char* program, char* const* arguments, int talk, int errors,
                         int failure, pid_t parent) {
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent)  // it died in between
        _exit(1);
    for (int signal = 1; signal < NSIG; ++signal)
        std::signal(signal, SIG_DFL);
    sigset_t none;
    sigemptyset(&none);
    sigprocmask(SIG_SETMASK, &none, nullptr);
    setpgid(0, 0);
    dup2(talk, STDIN_FILENO);
    dup2(talk, STDOUT_FILENO);
    dup2(errors, STDERR_FILENO);
    close_range(STDERR_FILENO + 1, ~0u, CLOSE_RANGE_CLOEXEC);
    execvp(program, arguments);
    const int error = errno;
    send(failure, &error, sizeof error, MSG_NOSIGNAL);
    _exit(127);
}

// What there is; calls `take` with it. False at the end.
template <class Take>
bool receive(int socket, Take take) {
    std::array<char, 4096> bytes{};
    for (;;) {
        const ssize_t count = recv(socket, bytes.data(), bytes.size(), MSG_DONTWAIT);
        if (count > 0)
            take(std::string_view(bytes.data(), static_cast<std::size_t>(count)));
        else if (count == 0 || errno != EINTR)
            return count < 0 && errno == EAGAIN;
    }
}

int milliseconds_left(Instant deadline) {
    const auto left =
        std::chrono::ceil<std::chrono::milliseconds>(deadline - SteadyClock().now()).count();
    return static_cast<int>(std::clamp<std::int64_t>(left, 0, 1'000'000));
}

}  // namespace

Subprocess::Subprocess(const std::vector<std::string>& command, SubprocessOptions options)
    : options_(std::move(options)) {
    std::promise<void> promise;
    std::future<void> started = promise.get_future();
    // The kernel's SIGTERM follows the thread that forks: it lives as long as the child.
    thread_ = std::thread([this, &command, promise = std::move(promise)]() mutable {
        try {
            start(command);
        } catch (const std::system_error&) {
            promise.set_exception(std::current_exception());
            return;
        }
        promise.set_value();  // from here on nothing of the caller's is used
        follow();
    });
    try {
        started.get();
    } catch (const std::system_error&) {
        thread_.join();
        throw;
    }
}

Subprocess::~Subprocess() {
    send(SIGTERM);
    if (!wait_for(patience))
        send(SIGKILL);
    thread_.join();
}

// On a thread that takes no signals: they are for the one that waits for them.
void Subprocess::start(const std::vector<std::string>& command) {
    sigset_t all;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, nullptr);
    std::vector<char*> arguments;
    for (const std::string& word : command)
        arguments.push_back(const_cast<char*>(word.c_str()));  // exec does not write
    arguments.push_back(nullptr);
    if (command.at(0) == own_file)
        arguments[0] = program_invocation_name;
    SocketPair talk, errors, failure;
    const int their_errors = options_.inherits_stderr ? STDERR_FILENO : errors.theirs.get();
    const pid_t parent = getpid(), child = fork();
    if (child == 0)
        become(command[0].c_str(), arguments.data(), talk.theirs.get(), their_errors,
               failure.theirs.get(), parent);
    int error = child < 0 ? errno : 0;
    for (SocketPair* pair : {&talk, &errors, &failure})
        pair->theirs = FileDescriptor();
    if (child > 0 && read(failure.ours.get(), &error, sizeof error) <= 0) {
        end_ = FileDescriptor(static_cast<int>(syscall(SYS_pidfd_open, child, 0)));
        error = end_ ? 0 : errno;
    }
    if (error != 0) {
        if (child > 0) {
            kill(child, SIGKILL);
            waitpid(child, nullptr, 0);
        }
        throw std::system_error(error, std::generic_category());
    }
    talk_ = std::move(talk.ours);
    errors_ = std::move(errors.ours);
    process_ = child;
    if (!options_.has_input)
        close_input();
}

bool Subprocess::send(int signal) {
    const std::lock_guard lock(mutex_);
    return process_ > 0 && kill(signal == SIGKILL ? -process_ : process_, signal) == 0;
}

std::error_code Subprocess::write(std::string_view text, Duration limit) {
    const Instant deadline = SteadyClock().now() + limit;
    while (!text.empty()) {
        pollfd ready{talk_.get(), POLLOUT, 0};
        if (poll(&ready, 1, milliseconds_left(deadline)) == 0)
            return std::make_error_code(std::errc::timed_out);
        const ssize_t sent =
            ::send(talk_.get(), text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
        if (sent > 0)
            text.remove_prefix(static_cast<std::size_t>(sent));
        else if (errno != EINTR && errno != EAGAIN)
            return {errno, std::generic_category()};
    }
    return {};
}

void Subprocess::close_input() {
    shutdown(talk_.get(), SHUT_WR);
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

void Subprocess::follow() {
    std::array<pollfd, 3> sources{
        {{talk_.get(), POLLIN, 0}, {errors_.get(), POLLIN, 0}, {end_.get(), POLLIN, 0}}};
    bool has_ended = false;
    while (!has_ended) {
        poll(sources.data(), sources.size(), -1);
        has_ended = sources[2].revents != 0;
        if (has_ended)
            kill(-process_, SIGKILL);  // what it left running; until it is reaped the id is its own
        if (!receive(errors_.get(), [this](std::string_view text) { add_errors(text); }))
            sources[1].fd = -1;
        const std::lock_guard lock(mutex_);
        const bool goes_on = receive(talk_.get(), [this](std::string_view text) {
            result_.output.append(text.substr(0, most_output - result_.output.size()));
        });
        if (!goes_on)
            sources[0].fd = -1;
        has_closed_output_ = has_ended || !goes_on;
        changed_.notify_all();
    }
    add_errors("\n");
    {
        const std::lock_guard lock(mutex_);  // nobody signals the id of another process
        int status = 0;
        waitpid(process_, &status, 0);
        result_.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
        result_.signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
        process_ = 0;
    }
    changed_.notify_all();
    if (options_.on_end)
        options_.on_end(result_);
}

// Lines as they come; the last ones are kept.
void Subprocess::add_errors(std::string_view text) {
    for (const char c : text) {
        if (c != '\n' && line_.size() < most_line)
            line_ += c;
        if (c != '\n' || line_.empty())
            continue;
        if (options_.on_stderr_line)
            options_.on_stderr_line(line_);
        const std::lock_guard lock(mutex_);
        std::string& tail = result_.stderr_tail += line_ + "\n";
        if (std::ranges::count(tail, '\n') > kept_lines)
            tail.erase(0, tail.find('\n') + 1);
        line_.clear();
    }
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
