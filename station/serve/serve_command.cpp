// `etalon serve`: the operator's page.
#include <arpa/inet.h>
#include <fmt/format.h>
#include <unistd.h>

#include "core/file/text.h"
#include "core/program/print_stderr.h"
#include "station/serve/http_server.h"
#include "station/serve/page_server.h"
#include "station/shell/command.h"
#include "station/shell/signals.h"

namespace etalon {
namespace {

struct ServeArguments {
    std::vector<std::filesystem::path> stations;
    std::filesystem::path records = "runs", calibrations;
    std::string listen;
    int port = 7530;
    bool json = false;
};

constexpr const char* loopback = "127.0.0.1";

AccessRules access_rules(const ServeArguments& arguments) {
    AccessRules rules{.token = {}, .action_token = random_token(), .host_names = {"localhost"}};
    if (arguments.listen.empty())
        return rules;
    rules.token = random_token();
    std::array<char, 256> name{};
    rules.host_names.clear();
    if (gethostname(name.data(), name.size() - 1) == 0)
        rules.host_names.emplace_back(name.data());
    return rules;
}

Workplace workplace_of(const ServeArguments& arguments) {
    Workplace workplace;
    for (const std::filesystem::path& file : arguments.stations)
        workplace.stations.push_back({std::filesystem::absolute(file), read_station(file)});
    make_folder(arguments.records);
    workplace.records = std::filesystem::absolute(arguments.records);
    if (!arguments.calibrations.empty()) {
        workplace.calibrations = std::filesystem::absolute(arguments.calibrations);
        for (const std::string& file : read_calibrations(arguments.calibrations).skipped)
            print_stderr("etalon serve: skipped: {}\n", file);
    }
    return workplace;
}

void require_address(const std::string& listen) {
    std::array<unsigned char, sizeof(in6_addr)> address{};
    if (!listen.empty() && inet_pton(AF_INET, listen.c_str(), address.data()) != 1 &&
        inet_pton(AF_INET6, listen.c_str(), address.data()) != 1)
        throw ConfigError({"--listen"}, fmt::format("{} is no IP address of this machine", listen));
    if (listen == "0.0.0.0" || listen == "::")
        throw ConfigError({"--listen"}, "names one address of this machine, not all of them");
}

std::string link_to(const ServeArguments& arguments, const AccessRules& rules, int port) {
    const std::string address = arguments.listen.empty() ? loopback : arguments.listen;
    const bool is_six = address.find(':') != std::string::npos;
    return fmt::format("http://{}:{}/{}", is_six ? "[" + address + "]" : address, port,
                       rules.token.empty() ? "" : "?token=" + rules.token);
}

int run_serve(const ServeArguments& arguments) {
    require_address(arguments.listen);
    std::stop_source stop;
    const StopOnSignals signals(stop);
    const AccessRules rules = access_rules(arguments);
    PageServer server(rules, workplace_of(arguments));
    const auto http = make_http_server(
        {}, [&server](const WebRequest& request) { return server.answer(request); });
    const int port =
        http->open(arguments.listen.empty() ? loopback : arguments.listen, arguments.port);
    fmt::print("page {}\n", link_to(arguments, rules, port));
    std::fflush(stdout);
    // The run first: readers that are slow may keep their connections for long.
    const std::stop_callback close(stop.get_token(), [&] {
        server.close();
        http->close();
    });
    http->serve();
    return 0;
}

}  // namespace

void declare_serve(Command& program) {
    auto [command, asked] = program.add(
        run_serve, "serve", "the operator's page: set up, run, look back",
        "Prints `page http://...` and serves it until Ctrl-C. A run that is started on\n"
        "the page is `etalon qualify`, with its record in --records; it goes on when the\n"
        "page is closed, is stopped when the server ends, however it ends, and is then\n"
        "resumed from the page. Only this machine reaches the page, unless --listen\n"
        "names another of its addresses: then the link that is printed holds a token,\n"
        "and whoever has the link may move the stage. docs/serve.md.\n");
    command.required("STATION", asked->stations, "station.yaml: one or more");
    command.option("--records", asked->records, "folder of the runs' records (runs)", "DIR");
    command.option("--calibrations", asked->calibrations,
                   "folder of camera files: a camera's is found by its serial number;\n"
                   "without it the station's own is used",
                   "DIR");
    command.option("--listen", asked->listen, "an address in place of 127.0.0.1", "ADDRESS");
    command.option("--port", asked->port, "(7530; 0: any)", "PORT").within(0, 65535);
}

}  // namespace etalon
