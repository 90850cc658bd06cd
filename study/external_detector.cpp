// A socket pair in place of two pipes: writing to a program that has ended is then an error and no
// SIGPIPE.
#include "study/external_detector.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <thread>

#include "core/program/errors.h"

extern char** environ;

namespace etalon {
namespace {

using Steady = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr std::size_t max_answer = 65536;  // bytes

// Waits until the socket may be used; false when the time is over.
bool wait_for(int socket, short events, Steady::time_point deadline) {
    for (;;) {
        const auto left = std::chrono::ceil<milliseconds>(deadline - Steady::now());
        pollfd ready{socket, events, 0};
        const int count =
            poll(&ready, 1, static_cast<int>(std::max(left.count(), milliseconds::rep{0})));
        if (count > 0)
            return true;
        if (count == 0 || errno != EINTR)
            return false;
    }
}

// Its own process group, so that what it starts ends with it; no signals blocked or ignored, and
// none of our files but standard error.
int spawn(const std::vector<std::string>& command, int socket, pid_t& process) {
    std::vector<char*> arguments;
    for (const std::string& argument : command)
        arguments.push_back(const_cast<char*>(argument.c_str()));  // posix_spawn does not write
    arguments.push_back(nullptr);
    posix_spawn_file_actions_t files;
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_adddup2(&files, socket, STDIN_FILENO);
    posix_spawn_file_actions_adddup2(&files, socket, STDOUT_FILENO);
    posix_spawn_file_actions_addclosefrom_np(&files, STDERR_FILENO + 1);
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    sigset_t none, all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setflags(
        &attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
    posix_spawnattr_setpgroup(&attributes, 0);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &all);
    const int error =
        posix_spawnp(&process, arguments[0], &files, &attributes, arguments.data(), environ);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&files);
    return error;
}

ExternalAnswer without_pose(const std::string& why) {
    return {std::nullopt, why};
}

std::optional<Rigid> pose_in(const nlohmann::json& numbers) {
    if (!numbers.is_array() || numbers.size() != 6)
        return std::nullopt;
    Vector6d pose;
    for (std::size_t i = 0; i < 6; ++i) {
        if (!numbers[i].is_number())
            return std::nullopt;
        pose[static_cast<Eigen::Index>(i)] = numbers[i].get<double>();
    }
    if (!pose.allFinite())
        return std::nullopt;
    return rigid_from_vector(pose);
}

}  // namespace

std::optional<ExternalAnswer> external_answer(const std::string& line) {
    const auto json = nlohmann::json::parse(line, nullptr, false);
    if (!json.is_object())
        return std::nullopt;
    if (const auto pose = json.find("camera_from_marker"); pose != json.end()) {
        const auto rigid = pose_in(*pose);
        return rigid ? std::optional(ExternalAnswer{rigid, ""}) : std::nullopt;
    }
    const auto failure = json.find("failure");
    if (failure == json.end() || !failure->is_string())
        return std::nullopt;
    return without_pose(failure->get<std::string>());
}

ExternalDetector::ExternalDetector(std::vector<std::string> command, milliseconds time_out,
                                   const std::string& place)
    : command_(std::move(command)), time_out_(time_out) {
    if (command_.empty() || command_[0].empty())
        throw ConfigError({place}, "no program is named");
    if (const int error = start(); error != 0)
        throw ConfigError(
            {place}, fmt::format("{} cannot be started: {}", command_[0], std::strerror(error)));
}

ExternalDetector::~ExternalDetector() {
    constexpr milliseconds patience(500), nap(5);
    if (process_ < 0)
        return;
    shutdown(socket_, SHUT_WR);  // end of its input
    siginfo_t info{};
    for (const auto deadline = Steady::now() + patience;
         Steady::now() < deadline && info.si_pid == 0; std::this_thread::sleep_for(nap))
        if (waitid(P_PID, static_cast<id_t>(process_), &info, WEXITED | WNOHANG | WNOWAIT) != 0)
            break;
    end();
}

int ExternalDetector::start() {
    std::array<int, 2> sockets{};
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, sockets.data()) != 0)
        return errno;
    const int error = spawn(command_, sockets[1], process_);
    close(sockets[1]);
    if (error != 0) {
        close(sockets[0]);
        process_ = -1;
        return error;
    }
    socket_ = sockets[0];
    return 0;
}

void ExternalDetector::end() {
    if (process_ < 0)
        return;
    kill(-process_, SIGKILL);  // the whole group; it may be gone already
    while (waitpid(process_, nullptr, 0) < 0 && errno == EINTR) {
    }
    close(socket_);
    process_ = socket_ = -1;
}

std::string ExternalDetector::ended() {
    constexpr milliseconds patience(200), nap(1);
    siginfo_t info{};
    for (const auto deadline = Steady::now() + patience; Steady::now() < deadline;
         std::this_thread::sleep_for(nap))
        if (waitid(P_PID, static_cast<id_t>(process_), &info, WEXITED | WNOHANG | WNOWAIT) != 0 ||
            info.si_pid != 0)
            break;
    if (info.si_pid == 0)
        return "the program has closed its output";
    if (info.si_code == CLD_EXITED)
        return fmt::format("the program ended with exit code {}", info.si_status);
    return fmt::format("the program was ended by signal {} ({})", info.si_status,
                       strsignal(info.si_status));
}

ExternalAnswer ExternalDetector::failed(const std::string& why) {
    end();
    return without_pose(why);
}

bool ExternalDetector::said_more() {
    return wait_for(socket_, POLLIN, Steady::now());
}

std::optional<std::string> ExternalDetector::send(const std::string& line, Deadline deadline) {
    for (std::size_t sent = 0; sent < line.size();) {
        if (!wait_for(socket_, POLLOUT, deadline))
            return fmt::format("the program did not read its input within {} ms",
                               time_out_.count());
        const ssize_t count =
            ::send(socket_, line.data() + sent, line.size() - sent, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (count > 0)
            sent += static_cast<std::size_t>(count);
        else if (errno != EINTR && errno != EAGAIN)
            return ended();
    }
    return std::nullopt;
}

ExternalAnswer ExternalDetector::receive(Deadline deadline) {
    std::string line;
    std::array<char, 4096> part{};
    while (line.find('\n') == std::string::npos) {
        if (line.size() > max_answer)
            return failed(fmt::format("the answer is longer than {} bytes", max_answer));
        if (!wait_for(socket_, POLLIN, deadline))
            return failed(fmt::format("no answer within {} ms", time_out_.count()));
        const ssize_t count = recv(socket_, part.data(), part.size(), MSG_DONTWAIT);
        if (count > 0)
            line.append(part.data(), static_cast<std::size_t>(count));
        else if (count == 0 || (errno != EINTR && errno != EAGAIN))
            return failed(ended());
    }
    if (line.find('\n') + 1 != line.size())
        return failed("the answer is more than one line");
    const auto answer = external_answer(line);
    return answer ? *answer : failed("the answer is neither a pose nor a failure");
}

ExternalAnswer ExternalDetector::detect(const std::filesystem::path& image,
                                        const std::filesystem::path& camera) {
    const std::string line = image.string() + "\t" + camera.string() + "\n";
    if (line.find_first_of("\t\n") != image.string().size() ||
        line.find_first_of("\t\n", image.string().size() + 1) != line.size() - 1)
        throw ConfigError({image.string()}, "a path with a tab or a line break has no line");
    if (process_ >= 0 && said_more())
        end();  // its next line would not belong to this image
    if (process_ < 0)
        if (const int error = start(); error != 0)
            return without_pose(
                fmt::format("the program cannot be started: {}", std::strerror(error)));
    const Deadline deadline = Steady::now() + time_out_;
    if (const auto problem = send(line, deadline))
        return failed(*problem);
    return receive(deadline);
}

}  // namespace etalon
