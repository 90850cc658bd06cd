#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

#include <iostream>

#include "compare/qualification/judged_quantities.h"
#include "core/file/file_writing.h"
#include "core/file/text.h"
#include "core/program/print_stderr.h"
#include "report/json_text.h"
#include "station/devices/commands.h"
#include "station/devices/new_station.yaml.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

// In double quotes as YAML reads them; other characters need no escape there.
std::string quoted(const std::string& text, const char* option) {
    if (text.empty() || text.find_first_of("\"\\\n\r\t") != std::string::npos)
        throw ConfigError({option}, fmt::format("cannot stand in a file: '{}'", text));
    return '"' + text + '"';
}

std::string link_text(const std::string& stage) {
    if (stage.starts_with("/"))
        return fmt::format("{{device: {}}}", quoted(stage, "--stage"));
    const auto colon = stage.rfind(':');
    const auto port =
        colon == std::string::npos ? std::optional(502LL) : parse_integer(stage.substr(colon + 1));
    if (!port || *port < 1 || *port > 65535)
        throw ConfigError({"--stage"}, "must be HOST, HOST:PORT or a serial line, not " + stage);
    return fmt::format("{{host: {}, port: {}}}", quoted(stage.substr(0, colon), "--stage"), *port);
}

std::string axis_text(const std::string& name) {
    const char direction = name.back();
    const char* along = direction == 'x'   ? "[1, 0, 0]"
                        : direction == 'y' ? "[0, 1, 0]"
                                           : "[0, 0, 1]";
    if (name.starts_with("r"))
        return fmt::format(R"(    - name: {}
      kind: rotary
      direction: {}
      point_mm: [0, 0, 0]           # yours: a point on the axis
      travel_deg: [-5, 5]           # yours: soft limits
      speed_deg: 5                  # deg/s
)",
                           name, along);
    return fmt::format(R"(    - name: {}
      kind: linear
      direction: {}
      travel: [-5, 5]               # yours: soft limits, mm
      speed: 5                      # mm/s
)",
                       name, along);
}

void require_axes(const std::vector<std::string>& axes) {
    constexpr std::array known = {"x", "y", "z", "rx", "ry", "rz"};
    for (const std::string& axis : axes)
        if (std::ranges::count(known, axis) == 0 || std::ranges::count(axes, axis) != 1)
            throw ConfigError({"--axes"}, fmt::format("must be some of {}, each once; not '{}'",
                                                      fmt::join(known, ", "), axis));
}

// Every axis over nine tenths of its soft limits.
std::string volume_text(const std::vector<std::string>& axes) {
    std::string text;
    for (const std::string& axis : axes)
        text += fmt::format("    {}: [-4.5, 4.5]\n", axis);
    return text;
}

struct InitArguments {
    std::filesystem::path folder;
    std::optional<std::string> camera, calibration, stage, profile, marker, axes;
    bool json = false;
};

// The one camera that answers, or nothing where there is none or a choice.
std::optional<std::string> found_camera() {
    std::vector<std::string> uris;
    for (const CameraBackend& backend : list_cameras())
        for (const CameraIdentity& identity : backend.cameras)
            uris.push_back(identity.uri);
    for (const std::string& uri : uris)
        print_stderr("camera {}\n", uri);
    return uris.size() == 1 ? std::optional(uris.front()) : std::nullopt;
}

// What was given, else the user's answer, else `otherwise`, also for an empty line.
std::string asked(const std::optional<std::string>& given, const char* question,
                  const std::string& otherwise) {
    if (given)
        return *given;
    if (isatty(STDIN_FILENO) == 0)
        return otherwise;
    print_stderr("{} [{}]: ", question, otherwise);
    std::string answer;
    std::getline(std::cin, answer);
    answer = trimmed(answer);
    return answer.empty() ? otherwise : answer;
}

StationTemplate draft_of(const InitArguments& arguments) {
    StationTemplate draft;
    if (!arguments.camera)
        draft.camera = found_camera().value_or(draft.camera);
    draft.camera = asked(arguments.camera, "camera", draft.camera);
    draft.calibration = asked(arguments.calibration, "its calibration", draft.calibration);
    draft.stage = asked(arguments.stage, "stage: HOST:PORT or a serial line", draft.stage);
    draft.profile = asked(arguments.profile, "its controller (`etalon devices`)", draft.profile);
    draft.marker = asked(arguments.marker, "marker", draft.marker);
    draft.axes = split(asked(arguments.axes, "axes, from the base on", "x,y,z,rz"), ',');
    return draft;
}

// Neither file is ever written over.
void write_new(const std::filesystem::path& path, const std::string& text) {
    if (std::filesystem::exists(path))
        throw ConfigError({path.string()}, "is there already");
    write_text(path, text);
}

int run_init(const InitArguments& arguments) {
    const StationTemplate draft = draft_of(arguments);
    const std::string text = drafted_station(draft);
    const std::filesystem::path station = arguments.folder / "station.yaml";
    const FolderLock lock = claim_folder(arguments.folder);
    write_new(station, text);
    write_new(arguments.folder / "limits.yaml", drafted_limits());
    const bool is_calibrated =
        std::filesystem::is_regular_file(arguments.folder / draft.calibration);
    if (is_calibrated)
        read_station(station);
    else
        read_station_stage(station);
    const std::string next =
        is_calibrated ? fmt::format("`etalon plan {}` says what it can see", station.string())
                      : fmt::format("{} is missing: `etalon calibrate` makes it",
                                    (arguments.folder / draft.calibration).string());
    print_stderr("next: set what is marked \"yours\" in {}; {}\n", station.string(), next);
    if (arguments.json)
        fmt::print("{}\n", text_of(Json{{"etalon", "init/1"}, {"station", station.string()}}));
    else
        fmt::print("station {}\n", station.string());
    return 0;
}

}  // namespace

std::string drafted_station(const StationTemplate& draft) {
    require_axes(draft.axes);
    std::string axes;
    for (const std::string& axis : draft.axes)
        axes += axis_text(axis);
    return fmt::format(fmt::runtime(new_station_yaml),
                       fmt::arg("camera", quoted(draft.camera, "--camera")),
                       fmt::arg("calibration", quoted(draft.calibration, "--calibration")),
                       fmt::arg("link", link_text(draft.stage)),
                       fmt::arg("profile", quoted(draft.profile, "--profile")),
                       fmt::arg("axes", axes), fmt::arg("marker", quoted(draft.marker, "--marker")),
                       fmt::arg("volume", volume_text(draft.axes)));
}

std::string drafted_limits() {
    std::string text =
        "# What the camera is judged by: the limits are yours. `etalon plan station.yaml` says "
        "how\n"
        "# small a bias this station can see.\n"
        "etalon: limits/1\n"
        "id: limits-1\n";
    for (const QuantityKind& kind : quantity_kinds())
        if (kind.is_required)
            text += fmt::format("{}: {{limit: 0.5, unit: {}}}\n", kind.name, kind.unit);
    return text;
}

void declare_init(Command& program) {
    auto [command, asked] = program.add(
        run_init, "init", "write station.yaml and limits.yaml for a new station",
        "Asks what is not given, with a default for each: the camera that answers, if\n"
        "it is the only one. Where stdin is no terminal the defaults are taken. Axes\n"
        "are some of x, y, z, rx, ry, rz; travel and speed are a few millimetres until\n"
        "you say more. What only you know is marked \"yours\" in the files. No file is\n"
        "written over. Prints `station DIR/station.yaml`.\n");
    command.required("DIR", asked->folder, "folder for the files");
    command.option("--camera", asked->camera, "as `etalon devices` names it", "URI");
    command.option("--calibration", asked->calibration, "camera file, seen from DIR", "FILE");
    command.option("--stage", asked->stage, "HOST:PORT (Modbus TCP) or a serial line", "WHERE");
    command.option("--profile", asked->profile, "of the stage's controller", "NAME");
    command.option("--marker", asked->marker, "as for `etalon render`", "M");
    command.option("--axes", asked->axes, "from the base on: x,y,z,rz", "NAMES");
}

}  // namespace etalon
