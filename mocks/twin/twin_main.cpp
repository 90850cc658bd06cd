// etalon-twin: a virtual stage (on 127.0.0.1 or a serial line) and camera for `etalon qualify`.
// Exit codes: 0 interrupted as intended, 3 usage or config error, 4 a port is taken.

#include <CLI/CLI.hpp>
#include <cstdio>

#include "core/config/file_schema.h"
#include "core/file/file_writing.h"
#include "core/file/text.h"
#include "core/program/print_stderr.h"
#include "mocks/ending_signals.h"
#include "mocks/twin/twin.h"

namespace {

struct Arguments {
    std::vector<std::filesystem::path> files;  // one, but for a schema
    std::optional<std::uint64_t> seed;
    std::filesystem::path ready_file, schema;
};

void declare(CLI::App& app, Arguments& arguments) {
    app.add_option(
        "--schema", arguments.schema,
        "Only write the JSON Schema of such files, from what these have, to this folder");
    app.add_option("file", arguments.files, "The twin's twin.yaml; for --schema any number")
        ->required();
    app.add_option("--seed", arguments.seed, "In place of the file's seed");
    app.add_option("--ready-file", arguments.ready_file,
                   "Written once both devices listen, with the line that is printed");
}

int run(const Arguments& arguments) {
    const sigset_t signals = etalon::block_ending_signals();
    if (arguments.files.size() != 1)
        throw etalon::ConfigError({"file"}, "a twin has one file");
    etalon::TwinFile file = etalon::read_twin_file(arguments.files.front());
    if (arguments.seed)
        file.seed = *arguments.seed;
    const etalon::Twin twin(file);
    const std::string room =
        twin.room_port() ? fmt::format(", room 127.0.0.1:{}", twin.room_port()) : "";
    const std::string ready = fmt::format(
        "twin ready: stage {}, camera 127.0.0.1 (GigE Vision){}\n", twin.stage_place(), room);
    fmt::print("{}", ready);
    std::fflush(stdout);
    if (!arguments.ready_file.empty())
        etalon::write_text(arguments.ready_file, ready);
    int signal = 0;
    sigwait(&signals, &signal);
    return 0;
}

int write_schema(const Arguments& arguments) {
    etalon::ReadTrace trace;
    for (const std::filesystem::path& file : arguments.files)
        etalon::read_twin_file(file);
    std::erase_if(trace.files, [](const auto& file) { return file->kind != "twin/1"; });
    etalon::write_schemas(trace, arguments.schema);
    return 0;
}

int failed(int code, const std::exception& error) {
    etalon::print_stderr("etalon-twin: {}\n", error.what());
    return code;
}

}  // namespace

int main(int argc, char** argv) {
    Arguments arguments;
    CLI::App app("A virtual stage (Modbus) and camera (GigE Vision) on 127.0.0.1.");
    declare(app, arguments);
    const etalon::InputGuard inputs;
    try {
        app.parse(argc, argv);
        return arguments.schema.empty() ? run(arguments) : write_schema(arguments);
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? 0 : etalon::ExitCode::usage_error;  // --help is no error
    } catch (const etalon::ConfigError& error) {
        return failed(etalon::ExitCode::usage_error, error);
    } catch (const std::exception& error) {
        return failed(etalon::ExitCode::run_error, error);
    }
}
