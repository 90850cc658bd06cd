#include "station/certify/pdf_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <system_error>
#include <vector>

namespace etalon {
namespace {

// Its stdin and stdout are nothing: words on stdout are ours. Returns its id, or 0.
pid_t start(std::vector<std::string> words) {
    std::vector<char*> pointers;
    for (std::string& word : words)
        pointers.push_back(word.data());
    pointers.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    pid_t process = 0;
    const int error =
        posix_spawnp(&process, pointers.front(), &actions, nullptr, pointers.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    return error == 0 ? process : 0;
}

// False when it had to be killed.
bool ends_within(pid_t process, std::chrono::seconds patience) {
    const int handle = static_cast<int>(syscall(SYS_pidfd_open, process, 0));
    pollfd watched{handle, POLLIN, 0};
    const auto limit = static_cast<int>(std::chrono::milliseconds(patience).count());
    const bool ended = handle >= 0 && poll(&watched, 1, limit) == 1;
    if (!ended)
        kill(process, SIGKILL);
    if (handle >= 0)
        close(handle);
    return ended;
}

}  // namespace

std::string write_pdf(const std::filesystem::path& html, const std::filesystem::path& pdf,
                      std::chrono::seconds patience, const std::string& program) {
    std::error_code ignored;
    std::filesystem::remove(pdf, ignored);  // one from before would be taken for this one's
    const pid_t process = start({program, html.string(), pdf.string()});
    if (process == 0)
        return fmt::format("{} is not installed", program);
    const bool in_time = ends_within(process, patience);
    int status = 0;
    waitpid(process, &status, 0);
    if (!in_time)
        return fmt::format("{} took longer than {} s", program, patience.count());
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0 || !std::filesystem::exists(pdf, ignored))
        return fmt::format("{} failed; `{} {} {}` says why", program, program, html.string(),
                           pdf.string());
    return "";
}

}  // namespace etalon
