// `etalon init`: the files of a new station, for the devices that answer.
#include <fmt/format.h>
#include <unistd.h>

#include <iostream>
#include <nlohmann/json.hpp>

#include "core/file/text.h"
#include "core/program/errors.h"
#include "report/json_text.h"
#include "station/devices/commands.h"
#include "station/devices/station_draft.h"
#include "station/setup/station_file.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

struct InitArguments {
    std::filesystem::path folder;
    std::optional<std::string> camera, calibration, stage, profile, marker, axes;
    bool json = false;
};

// The one camera that answers, or nothing where there is none or a choice.
std::string found_camera() {
    std::vector<std::string> uris;
    for (const CameraBackend& backend : list_cameras())
        for (const CameraIdentity& identity : backend.cameras)
            uris.push_back(identity.uri);
    for (const std::string& uri : uris)
        fmt::print(stderr, "camera {}\n", uri);
    return uris.size() == 1 ? uris.front() : "";
}

// What was given, else the answer of whoever sits there, else `otherwise`, which is what an empty
// line means, too.
std::string asked(const std::optional<std::string>& given, const char* question,
                  const std::string& otherwise) {
    if (given)
        return *given;
    if (isatty(STDIN_FILENO) == 0)
        return otherwise;
    fmt::print(stderr, "{} [{}]: ", question, otherwise);
    std::string answer;
    std::getline(std::cin, answer);
    answer = trimmed(answer);
    return answer.empty() ? otherwise : answer;
}

StationTemplate draft_of(const InitArguments& arguments) {
    StationTemplate draft;
    const std::string found = arguments.camera ? "" : found_camera();
    if (!found.empty())
        draft.camera = found;
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
    make_folder(arguments.folder);
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
    fmt::print(stderr, "next: set what is marked \"yours\" in {}; {}\n", station.string(), next);
    if (arguments.json)
        fmt::print("{}\n",
                   text_of(ordered_json{{"etalon", "init/1"}, {"station", station.string()}}));
    else
        fmt::print("station {}\n", station.string());
    return 0;
}

}  // namespace

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
