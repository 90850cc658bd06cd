#include "station/shell/command.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>
#include <CLI/CLI.hpp>

#include <algorithm>

#include "core/file/text.h"

namespace etalon {
namespace {

// Refuses what is not a number, or one that `is_allowed` does not allow.
template <class Number, class Rule>
CLI::Validator number_rule(std::optional<Number> (*parse)(std::string_view), Rule is_allowed,
                           const std::string& words) {
    return CLI::Validator(
        [=](const std::string& text) -> std::string {
            const auto value = parse(text);
            return value && is_allowed(*value)
                       ? ""
                       : fmt::format("must be {}, not '{}'{}", words, text, number_hint(text));
        },
        "");
}

// CLI11 puts the only values behind the type's name: "M:{auto,E,C}".
std::vector<std::string> choices_of(const std::string& type) {
    const auto begin = type.find('{'), end = type.rfind('}');
    if (begin == std::string::npos || end == std::string::npos)
        return {};
    return split(type.substr(begin + 1, end - begin - 1), ',');
}

DescribedOption described(const CLI::Option& option) {
    DescribedOption one{.help = option.get_description(), .is_argument = option.get_positional()};
    if (one.is_argument)
        one.names = {option.get_name(/*positional=*/true)};
    for (const std::string& name : option.get_snames())
        one.names.push_back("-" + name);
    for (const std::string& name : option.get_lnames())
        one.names.push_back("--" + name);
    if (option.get_items_expected_max() > 0) {
        const std::string type = option.get_type_name();
        one.choices = choices_of(type);
        one.value = type.substr(0, type.find(':'));
    }
    return one;
}

DescribedCommand described(const CLI::App& app) {
    DescribedCommand command{app.get_name(), app.get_description(), {}, {}};
    for (const CLI::Option* option : app.get_options())
        command.options.push_back(described(*option));
    for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; }))
        command.commands.push_back(described(*sub));
    return command;
}

const SteadyClock steady_clock;

// They would forge lines of what is printed, and hide in paths and names.
void require_printable(int argc, char** argv) {
    for (int i = 1; i < argc; ++i)
        if (printable(argv[i]) != argv[i])
            throw CLI::ParseError(fmt::format("'{}' holds a control character", printable(argv[i])),
                                  CLI::ExitCodes::BaseClass);
}

// The first argument that this command does not know, and what it may have been meant to be; empty
// where it knows all.
std::string unknown_argument(const CLI::App& app) {
    std::vector<std::string> words = app.remaining();
    std::erase(words, "--");
    if (words.empty())
        return "";
    const bool is_option = words.front().starts_with("-");
    const std::string given = words.front().substr(0, is_option ? words.front().find('=') : -1);
    const DescribedCommand known = described(app);
    std::vector<std::string> names;
    bool takes_arguments = false;
    for (const DescribedOption& option : known.options) {
        takes_arguments |= option.is_argument;
        for (const std::string& name : option.names)
            if (is_option && name.starts_with("--"))
                names.push_back(name.substr(2));
    }
    for (const DescribedCommand& command : known.commands)
        if (!is_option)
            names.push_back(command.name);
    const std::size_t bare = std::min(given.find_first_not_of('-'), given.size());
    const std::string meant = nearest_word(given.substr(is_option ? bare : 0), names);
    return fmt::format(
        "'{}' is {}{}", given,
        is_option                                   ? "no option of " + known.name
        : known.commands.empty() || takes_arguments ? "one argument too many"
                                                    : "no command of " + known.name,
        meant.empty() ? "" : fmt::format("; did you mean '{}{}'?", is_option ? "--" : "", meant));
}

// CLI11's words for what a user meets most, in ours.
std::string in_our_words(const CLI::ParseError& error, const CLI::App& chosen) {
    const std::string text = error.what();
    const std::string name = text.substr(0, text.find(':'));
    if (error.get_name() == "ArgumentMismatch" && text.find(": At Most 1 ") != std::string::npos)
        return name + " is given more than once: it takes one value";
    if (error.get_name() == "ArgumentMismatch" && text.ends_with(" missing"))
        return name + " needs a value";
    if (error.get_name() == "ConversionError")
        return text + number_hint(text.substr(text.rfind(' ') + 1));
    if (text != "A subcommand is required")
        return text;
    std::vector<std::string> names;
    for (const DescribedCommand& command : described(chosen).commands)
        names.push_back(command.name);
    return fmt::format("{} needs one of {}", chosen.get_name(), fmt::join(names, ", "));
}

// An argument that is not known comes first: it may be why another one is missing.
std::string cause_of(const CLI::ParseError& error, const CLI::App& program) {
    const CLI::App* app = &program;
    for (;;) {
        if (const std::string unknown = unknown_argument(*app); !unknown.empty())
            return unknown;
        if (app->get_subcommands().empty())
            return in_our_words(error, *app);
        app = app->get_subcommands().front();
    }
}

}  // namespace

void Option::require() const {
    option_->required();
}

Option Option::one_each() const {
    option_->allow_extra_args(false);
    return *this;
}

Option Option::positive() const {
    option_->check(number_rule(
        parse_number, [](double value) { return value > 0.0; }, "a number above 0"));
    return *this;
}

Option Option::whole() const {
    option_->check(number_rule(
        parse_integer, [](auto value) { return value >= 0; }, "a whole number"));
    return *this;
}

Option Option::within(int low, int high) const {
    option_->check(number_rule(
        parse_integer, [=](auto value) { return value >= low && value <= high; },
        fmt::format("a whole number from {} to {}", low, high)));
    return *this;
}

Option Option::in_range(double low, double high) const {
    option_->check(CLI::Range(low, high));
    return *this;
}

Option Option::one_of(const std::vector<std::string>& names) const {
    option_->check(CLI::IsMember(names));
    return *this;
}

Option Option::needs(const Option& other) const {
    option_->needs(other.option_);
    return *this;
}

Option Option::excludes(const Option& other) const {
    option_->excludes(other.option_);
    return *this;
}

template <class Type>
Option Command::option(const std::string& name, Type& target, const std::string& help,
                       const std::string& type_name) {
    return Option(*app_->add_option(name, target, help)->type_name(type_name));
}

using Text = const std::string&;
template Option Command::option(Text, int&, Text, Text);
template Option Command::option(Text, double&, Text, Text);
template Option Command::option(Text, std::uint64_t&, Text, Text);
template Option Command::option(Text, std::string&, Text, Text);
template Option Command::option(Text, std::filesystem::path&, Text, Text);
template Option Command::option(Text, std::optional<int>&, Text, Text);
template Option Command::option(Text, std::optional<std::string>&, Text, Text);
template Option Command::option(Text, std::optional<double>&, Text, Text);
template Option Command::option(Text, std::optional<std::uint64_t>&, Text, Text);
template Option Command::option(Text, std::vector<std::string>&, Text, Text);
template Option Command::option(Text, std::vector<std::filesystem::path>&, Text, Text);

Option Command::flag(const std::string& name, bool& target, const std::string& help) {
    return Option(*app_->add_flag(name, target, help));
}

Command Command::add_group(const std::string& name, const std::string& summary) {
    CLI::App* group = app_->add_subcommand(name, summary);
    group->set_help_flag("-h,--help", "show this help");
    group->require_subcommand(1);
    return {*group, *run_};
}

// CLI11 calls a command's callback after those of the commands below it.
Command Command::add(std::function<int()> action, bool& json, const std::string& name,
                     const std::string& summary, const std::string& details) {
    CLI::App* sub = app_->add_subcommand(name, summary);
    sub->footer(details);
    sub->set_help_flag("-h,--help", "show this help");
    sub->callback([sub, run = run_, action = std::move(action)] {
        if (sub->get_subcommands().empty())
            *run = action;
    });
    sub->add_flag("--json", json, "print the whole result as JSON on stdout");
    return {*sub, *run_};
}

int fail(int exit_code, const std::string& message) {
    std::string line = message;
    std::replace(line.begin(), line.end(), '\n', ' ');
    std::fprintf(stderr, "etalon: %s\n", printable(trimmed(line)).c_str());
    return exit_code;
}

std::function<int()> parse_command_line(int argc, char** argv, const ProgramText& text,
                                        const std::function<void(Command&)>& declare) {
    CLI::App app(text.summary, "etalon");
    app.set_help_flag("-h,--help", "show this help");
    app.set_version_flag("--version", text.version, "show versions and backends");
    app.get_formatter()->column_width(26);
    app.get_formatter()->label("SUBCOMMAND", "COMMAND");
    app.get_formatter()->label("Subcommands", "Commands");
    app.footer(text.footer);
    std::function<int()> run;
    Command program(app, run);
    declare(program);
    int exit_code = 0;
    try {
        require_printable(argc, argv);
        app.parse(argc, argv);
        if (run)
            return run;
        exit_code = fail(ExitCode::usage_error, "no command given; see `etalon --help`");
    } catch (const CLI::Success& request) {  // --help, --version
        exit_code = app.exit(request);
    } catch (const CLI::ParseError& error) {
        exit_code = fail(ExitCode::usage_error, cause_of(error, app));
    }
    return [exit_code] { return exit_code; };
}

DescribedCommand describe_program(const std::function<void(Command&)>& declare) {
    CLI::App app("", "etalon");
    app.set_help_flag("-h,--help", "show this help");
    app.set_version_flag("--version", "", "show versions and backends");
    std::function<int()> run;
    Command program(app, run);
    declare(program);
    return described(app);
}

const std::string homed_help = "confirms that axes which do not tell are homed";

const std::string marker_help =
    "Markers:\n"
    "  apriltag:36h11:5@50mm   family, id, side of the black square\n"
    "  aruco:4X4_50:7@50mm     OpenCV's predefined dictionary, id, side\n"
    "  stag:HD21:3@50mm        STag: family or table file, id, side\n"
    "  topotag:4x4:123@50mm    vertices, id, side of the white square; 4x4-circle\n"
    "  chessboard:9x6@25mm     inner corners, side of a square\n"
    "  charuco:4X4_50:9x6@30mm/22mm   squares, side of a square and of a marker\n"
    "  aprilgrid:36h11:6x5@40mm/12mm  Kalibr's grid: tags, side of a tag, gap\n"
    "  charuco-legacy:...      as OpenCV before 4.6 drew boards with even rows\n"
    "  circles:7x6@20mm/12mm   circles: spacing, diameter\n"
    "  acircles:4x11@20mm/12mm  OpenCV's asymmetric circles\n"
    "  hexcircles:28x24@12mm/10mm  BoofCV's hexagonal grid\n"
    "  squares:4x3@30mm/20mm   black squares: side, gap\n"
    "  bitmap:FILE@50x50mm     each pixel a cell, 0..255 = radiance 0..1 (linear)\n";

const std::string pose_help =
    "A pose is camera_from_marker: the rotation vector (axis times angle) in rad,\n"
    "then the translation in mm. Camera: x right, y down, z forward. Marker: origin\n"
    "at its centre (a chessboard's: its first inner corner), x right, y down, z into\n"
    "the marker: 0,0,0,0,0,300 is a marker seen squarely from 300 mm.\n";

void print_report(const std::filesystem::path& folder) {
    if (!folder.empty())
        fmt::print("report {}\n", (folder / "report.html").string());
}

StderrProgress::StderrProgress() : Progress(stderr, isatty(STDERR_FILENO) != 0, steady_clock) {}

void StderrProgress::count() {
    const std::lock_guard lock(mutex_);
    step();
}

std::filesystem::path program_folder() {
    return std::filesystem::read_symlink("/proc/self/exe").parent_path();
}

std::filesystem::path installed_file(const std::string& name) {
    const std::filesystem::path installed = program_folder().parent_path() / "share/etalon" / name;
    const std::filesystem::path built = program_folder() / "share/etalon" / name;
    for (const std::filesystem::path& path : {installed, built})
        if (std::filesystem::exists(path))
            return path;
    throw ConfigError({installed.string()}, "is missing: it should be installed with the program");
}

}  // namespace etalon
