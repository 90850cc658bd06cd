// `etalon demo`: the main job on a machine without devices, with the files that are installed.
#include <fmt/chrono.h>
#include <fmt/format.h>

#include <ctime>

#include "station/qualify/commands.h"
#include "station/shell/command.h"
#include "station/shell/installed_files.h"

namespace etalon {
namespace {

struct DemoArguments {
    std::filesystem::path out;
    std::vector<std::string> twin;  // more arguments for etalon-twin
    bool json = false;
};

std::filesystem::path new_record() {
    const std::time_t now = std::time(nullptr);
    return fmt::format("etalon-demo-{:%Y%m%d-%H%M%S}", fmt::localtime(now));
}

int run_demo(const DemoArguments& arguments) {
    QualifyArguments run;
    run.station = installed_file("examples/demo/station.yaml");
    run.out = arguments.out.empty() ? new_record() : arguments.out;
    run.twin = {installed_file("examples/demo/twin.yaml").string()};
    run.twin.insert(run.twin.end(), arguments.twin.begin(), arguments.twin.end());
    run.json = arguments.json;
    return run_qualify(run);
}

}  // namespace

void declare_demo(Command& program) {
    auto [command, asked] = program.add(
        run_demo, "demo", "qualify a simulated camera: needs no device",
        "Starts etalon-twin, a stage (Modbus TCP, port 1502) and a camera (GigE Vision)\n"
        "on 127.0.0.1, runs `etalon qualify` on them, and ends the twin again. Prints\n"
        "what `etalon qualify` prints, with its exit code. Takes a minute and a half.\n\n"
        "The files are examples/demo, installed in PREFIX/share/etalon: copy them to\n"
        "give the simulated camera errors (twin.yaml), and run\n"
        "`etalon qualify station.yaml --twin twin.yaml --out DIR`.\n");
    command.option("--out", asked->out, "folder of the record (default etalon-demo-TIME)", "DIR");
    command.option("TWIN", asked->twin,
                   "arguments for etalon-twin, after `--`: `etalon demo -- --seed 3`", "...");
}

}  // namespace etalon
