// One of the built programs as a child process, for tests of what its user sees.
#pragma once

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/paths.h"
#include "tests/test.h"

namespace etalon {

// A child process with its stdout and stderr in one pipe; ended and reaped on destruction. `name`
// is relative to the build folder.
class Program {
public:
    // In a `terminal` it leads a session of its own, as under sshd, and its output is not read.
    Program(const std::string& name, std::vector<std::string> arguments,
            const char* terminal = nullptr) {
        std::array<int, 2> ends{-1, -1};
        posix_spawnattr_t attributes;
        posix_spawnattr_init(&attributes);
        posix_spawn_file_actions_t actions;
        posix_spawn_file_actions_init(&actions);
        if (terminal != nullptr) {
            // A session's leader that opens a terminal gets it for its own.
            posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSID);
            posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, terminal, O_RDWR, 0);
            posix_spawn_file_actions_adddup2(&actions, STDIN_FILENO, STDOUT_FILENO);
        } else {
            EXPECT_EQ(pipe(ends.data()), 0);
            posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
            posix_spawn_file_actions_addclose(&actions, ends[0]);
        }
        posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
        std::string program = built_program(name);
        std::vector<char*> argv{program.data()};
        for (std::string& argument : arguments)
            argv.push_back(argument.data());
        argv.push_back(nullptr);
        EXPECT_EQ(posix_spawn(&process_, argv[0], &actions, &attributes, argv.data(), environ), 0);
        posix_spawn_file_actions_destroy(&actions);
        posix_spawnattr_destroy(&attributes);
        close(ends[1]);
        output_ = ends[0];
    }
    ~Program() {
        if (process_ > 0) {
            kill(process_, SIGKILL);
            exit_code();
        }
        close(output_);
    }
    Program(const Program&) = delete;
    Program& operator=(const Program&) = delete;

    // The next line of its output; what there is if it ends without one.
    std::string line() {
        std::string text;
        for (char c = 0; read(output_, &c, 1) == 1 && c != '\n';)
            text += c;
        return text;
    }
    // All that it prints from now on; returns when it has closed its output.
    std::string rest() {
        std::string text;
        for (char c = 0; read(output_, &c, 1) == 1;)
            text += c;
        return text;
    }
    void send(int signal) { kill(process_, signal); }
    bool has_ended() const {
        siginfo_t info{};
        waitid(P_PID, static_cast<id_t>(process_), &info, WEXITED | WNOHANG | WNOWAIT);
        return info.si_pid != 0;
    }
    // A program that it started and that has not ended; 0: none.
    int child() const {
        for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
            if (std::atoi(entry.path().filename().c_str()) <= 0)
                continue;
            std::ifstream stat(entry.path() / "stat");
            const std::string text{std::istreambuf_iterator<char>(stat), {}};
            const std::size_t name_end = text.rfind(')');  // "4711 (etalon) S 4710 ..."
            if (name_end == std::string::npos || text.size() < name_end + 5)
                continue;
            if (std::atoi(text.c_str() + name_end + 4) == process_ && text[name_end + 2] != 'Z')
                return std::atoi(text.c_str());
        }
        return 0;
    }
    int exit_code() {
        int status = 0;
        waitpid(process_, &status, 0);
        process_ = 0;
        return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    }

private:
    pid_t process_ = 0;
    int output_ = -1;
};

inline std::unique_ptr<Program> start_program(const std::string& name,
                                              std::vector<std::string> arguments) {
    return std::make_unique<Program>(name, std::move(arguments));
}

}  // namespace etalon
