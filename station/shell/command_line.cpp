#include "station/shell/command_line.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "core/text.h"

namespace etalon {

CLI::Validator positive_number() {
    return CLI::Validator(
        [](const std::string& text) -> std::string {
            const auto value = parse_number(text);
            return value && *value > 0.0 ? ""
                                         : fmt::format("must be a number above 0, not '{}'", text);
        },
        "");
}

CLI::Validator whole_number() {
    return CLI::Validator(
        [](const std::string& text) -> std::string {
            const auto value = parse_integer(text);
            return value && *value >= 0 ? ""
                                        : fmt::format("must be a whole number, not '{}'", text);
        },
        "");
}

CLI::Validator within(int low, int high) {
    return CLI::Validator(
        [=](const std::string& text) -> std::string {
            const auto value = parse_integer(text);
            return value && *value >= low && *value <= high
                       ? ""
                       : fmt::format("must be a whole number from {} to {}, not '{}'", low, high,
                                     text);
        },
        "");
}

CLI::App* add_command(CLI::App& app, Run& run, Run command, bool& json, const std::string& name,
                      const std::string& summary, const std::string& details) {
    CLI::App* sub = app.add_subcommand(name, summary);
    sub->footer(details);
    sub->set_help_flag("-h,--help", "show this help");
    sub->callback([&run, command = std::move(command)] { run = command; });
    sub->add_flag("--json", json, "print the whole result as JSON on stdout");
    return sub;
}

}  // namespace etalon
