// etalon-twin: a virtual stage (on 127.0.0.1 or a serial line) and camera to try `etalon qualify`
// on. Runs until it is interrupted. Exit codes: 0 interrupted as intended, 3 usage or config error,
// 4 a port is taken.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <optional>

#include "core/errors.h"
#include "core/exit_codes.h"
#include "core/text.h"
#include "mocks/ending_signals.h"
#include "mocks/twin/twin.h"

namespace {

struct Arguments {
    std::filesystem::path file;
    std::optional<std::uint64_t> seed;
    std::filesystem::path ready_file;
};

void declare(CLI::App& app, Arguments& arguments) {
    app.add_option("file", arguments.file, "The twin's twin.yaml")->required();
    app.add_option("--seed", arguments.seed, "In place of the file's seed");
    app.add_option("--ready-file", arguments.ready_file,
                   "Written once both devices listen, with the line that is printed");
}

int run(const Arguments& arguments) {
    const sigset_t signals = etalon::block_ending_signals();
    etalon::TwinFile file = etalon::read_twin_file(arguments.file);
    if (arguments.seed)
        file.seed = *arguments.seed;
    const etalon::Twin twin(file);
    const std::string ready =
        fmt::format("twin ready: stage {}, camera 127.0.0.1 (GigE Vision)\n", twin.stage_place());
    fmt::print("{}", ready);
    std::fflush(stdout);
    if (!arguments.ready_file.empty())
        etalon::write_text(arguments.ready_file, ready);
    int signal = 0;
    sigwait(&signals, &signal);
    return 0;
}

int failed(int code, const std::exception& error) {
    fmt::print(stderr, "etalon-twin: {}\n", error.what());
    return code;
}

}  // namespace

int main(int argc, char** argv) {
    Arguments arguments;
    CLI::App app("A virtual stage (Modbus) and camera (GigE Vision) on 127.0.0.1.");
    declare(app, arguments);
    try {
        app.parse(argc, argv);
        return run(arguments);
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? 0 : etalon::ExitCode::usage_error;  // --help is no error
    } catch (const etalon::ConfigError& error) {
        return failed(etalon::ExitCode::usage_error, error);
    } catch (const std::exception& error) {
        return failed(etalon::ExitCode::run_error, error);
    }
}
