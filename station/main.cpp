// The program `etalon`: its command line, and what an error ends with.
#include <fmt/format.h>

#include <malloc.h>

#include <csignal>
#include <limits>

#include "capture/frame/camera.h"
#include "core/file/file_writing.h"
#include "core/program/version.h"
#include "report/software_versions.h"
#include "station/commands.h"

namespace etalon {
namespace {

std::string version_text() {
    std::string text = fmt::format("etalon {}\n", version);
    text += "libraries:\n";
    for (const SoftwareVersion& software : software_versions())
        if (software.name != "etalon")
            text += fmt::format("  {:<14}{}\n", software.name, software.version);
    text += "camera backends:\n";
    for (const CameraBackend& backend : camera_backends())
        text += fmt::format("  {:<14}{}\n", backend.name, backend.detail);
    text += "stage backends:\n  modbus-tcp    built in";
    return text;
}

// Keeps freed memory: new pages for pictures of many megapixels cost more than the work on them.
// Not the server's, which lives for months (docs/performance.md).
void keep_memory() {
    mallopt(M_MMAP_MAX, 0);
    mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
}

// A result that nobody got is none: the disk may be full, the reader gone.
int printed(int code) {
    if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0)
        return code;
    return fail(ExitCode::run_error, "stdout: cannot be written");
}

}  // namespace
}  // namespace etalon

int main(int argc, char** argv) {
    using namespace etalon;
    if (argc < 2 || std::string_view(argv[1]) != "serve")
        keep_memory();
    // A reader that goes away (`etalon qualify ... | head`) must not end a run with moving axes.
    std::signal(SIGPIPE, SIG_IGN);
    const InputGuard inputs;
    try {
        const auto command = parse_command_line(
            argc, argv,
            {"etalon: qualifies calibrated cameras on a motorised stage",
             "Exit codes: 0 PASS or done, 1 FAIL, 2 INCONCLUSIVE, 3 usage or input error,\n"
             "4 device or run error, 130 interrupted.\n\n"
             "`etalon COMMAND --help` explains a command.\n",
             version_text},
            declare_commands);
        return printed(command());
    } catch (const DiskError& error) {
        return fail(ExitCode::run_error, error.what());
    } catch (const ConfigError& error) {
        return fail(ExitCode::usage_error, error.what());
    } catch (const Interrupted& error) {
        return fail(ExitCode::interrupted, error.what());
    } catch (const std::exception& error) {  // ours, OpenCV's and the standard library's
        return fail(ExitCode::run_error, error.what());
    }
}
