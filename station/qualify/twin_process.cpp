#include "station/qualify/twin_process.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "core/program/errors.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

// Of the child, between fork() and exec: calls that are safe there only.
[[noreturn]] void become(const char* program, char* const* arguments, int out, pid_t parent) {
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() == parent && dup2(out, STDOUT_FILENO) >= 0)
        execv(program, arguments);
    _exit(ExitCode::run_error);
}

}  // namespace

TwinProcess::TwinProcess(const std::vector<std::string>& arguments) {
    std::vector<std::string> words = {(program_folder() / "etalon-twin").string()};
    words.insert(words.end(), arguments.begin(), arguments.end());
    if (access(words.front().c_str(), X_OK) != 0)
        throw DeviceError("twin", "start",
                          words.front() + " is missing: a build without Aravis has no twin");
    std::vector<char*> pointers;
    for (std::string& word : words)
        pointers.push_back(word.data());
    pointers.push_back(nullptr);
    int ends[2] = {};
    const pid_t parent = getpid();
    if (pipe2(ends, O_CLOEXEC) != 0 || (id_ = fork()) < 0)
        throw DeviceError("twin", "start", "no process can be made");
    if (id_ == 0)
        become(pointers.front(), pointers.data(), ends[1], parent);
    close(ends[1]);
    said_ = fdopen(ends[0], "r");
}

TwinProcess::~TwinProcess() {
    if (id_ > 0) {
        kill(id_, SIGTERM);
        exit_code();
    }
    std::fclose(said_);
}

std::string TwinProcess::ready_line() {
    char line[256];
    return std::fgets(line, sizeof line, said_) ? line : "";
}

int TwinProcess::exit_code() {
    int status = 0;
    waitpid(id_, &status, 0);
    id_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : int{ExitCode::run_error};
}

}  // namespace etalon
