#include "station/setup/station_inputs.h"

#include <fmt/format.h>

#include "core/config/strict_reader.h"
#include "core/file/file_writing.h"
#include "core/file/sha256.h"
#include "core/file/text.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

using Path = std::filesystem::path;

InputFile identify(const std::string& role, const Path& path) {
    return {role, path, sha256_of_file(path), ""};
}

// The value at the end of a chain of keys, if all are there.
std::optional<Value> value_at(const Value& root, std::initializer_list<const char*> keys) {
    std::optional<Value> value = root;
    for (const char* key : keys) {
        if (!value || !value->is_mapping())
            return std::nullopt;
        value = value->find(key);
    }
    return value;
}

void add_camera_parts(std::vector<InputFile>& inputs, const Path& calibration) {
    if (!is_etalon_file(calibration))
        return;
    const StrictFile file(calibration, "camera/1");
    if (const auto profile = value_at(file.root(), {"lens", "psf", "measured", "file"}))
        inputs.push_back(identify("point spread", file.resolve(profile->text())));
    if (const auto table = value_at(file.root(), {"sensor", "transfer", "table", "file"}))
        inputs.push_back(identify("transfer table", file.resolve(table->text())));
}

// A profile extends another one beside it, or a built-in one. Their reader has refused circles.
void add_profiles(std::vector<InputFile>& inputs, Path profile) {
    std::error_code ignored;
    while (std::filesystem::is_regular_file(profile, ignored)) {
        inputs.push_back(identify("stage profile", profile));
        const StrictFile file(profile, "stage-profile/1");
        const auto base = file.root().find("extends");
        if (!base)
            return;
        profile = file.resolve(base->text() + ".yaml");
    }
}

Path full_path(const Path& path) {
    return std::filesystem::absolute(path).lexically_normal();
}

bool is_within(const Path& path, const Path& folder) {
    const Path relative = path.lexically_relative(folder);
    return !relative.empty() && *relative.begin() != "..";
}

Path common_folder(const std::vector<InputFile>& inputs) {
    Path folder = full_path(inputs.front().path).parent_path();
    for (const InputFile& input : inputs)
        while (!is_within(full_path(input.path), folder))
            folder = folder.parent_path();
    return folder;
}

std::string difference(const InputFile& recorded, const std::string& sha256) {
    return fmt::format("is not the {} file that the run was made with: its SHA-256 is {}, not {}",
                       recorded.role, sha256, recorded.sha256);
}

void require_recorded_bytes(const Path& record, const InputFile& input) {
    const Path copy = Path(input.copy).lexically_normal();
    if (copy.is_absolute() || !is_within(copy, "inputs"))
        throw ConfigError({record.string()},
                          fmt::format("the copy '{}' is not in inputs/", input.copy));
    const std::string found = sha256_of_file(record / copy);
    if (found != input.sha256)
        throw ConfigError({(record / copy).string()}, difference(input, found));
}

}  // namespace

std::vector<InputFile> station_inputs(const Path& station, const Path& calibration,
                                      const Path& limits, const std::string& profile) {
    std::vector<InputFile> inputs = {identify("station", station),
                                     identify("calibration", calibration),
                                     identify("limits", limits)};
    add_camera_parts(inputs, calibration);
    if (profile.ends_with(".yaml"))
        add_profiles(inputs, profile);
    return inputs;
}

void copy_inputs(std::vector<InputFile>& inputs, const Path& record) {
    const Path folder = common_folder(inputs);
    for (InputFile& input : inputs) {
        const Path copy = "inputs" / full_path(input.path).lexically_relative(folder);
        std::error_code error;
        make_folder((record / copy).parent_path());
        std::filesystem::copy_file(input.path, record / copy,
                                   std::filesystem::copy_options::overwrite_existing, error);
        if (error)
            fail_writing(record / copy, error);
        input.copy = copy.generic_string();
        require_recorded_bytes(record, input);
        for (Path kept = full_path(record / copy); kept != full_path(record).parent_path();
             kept = kept.parent_path())
            sync_to_disk(kept);
    }
    sync_to_disk(full_path(record).parent_path());
}

StationFile read_recorded_station(const Path& record, const std::vector<InputFile>& inputs) {
    if (inputs.empty() || inputs.front().role != "station")
        throw ConfigError({record.string()}, "the record names no station file");
    for (const InputFile& input : inputs)
        require_recorded_bytes(record, input);
    const bool has_calibration = inputs.size() > 1 && inputs[1].role == "calibration";
    StationFile station = read_station(record / inputs.front().copy,
                                       has_calibration ? record / inputs[1].copy : Path());
    require_same_inputs(inputs, station.inputs);
    for (std::size_t i = 0; i < inputs.size(); ++i)
        if (station.inputs[i].path == station.stage.profile)
            station.stage.profile = inputs[i].path.string();
    station.inputs = inputs;
    return station;
}

void require_same_inputs(const std::vector<InputFile>& recorded,
                         const std::vector<InputFile>& given) {
    for (std::size_t i = 0; i < std::min(recorded.size(), given.size()); ++i)
        if (recorded[i].role != given[i].role || recorded[i].sha256 != given[i].sha256)
            throw ConfigError({given[i].path.string()}, difference(recorded[i], given[i].sha256));
    if (recorded.size() != given.size())
        throw ConfigError(
            {given.front().path.string()},
            fmt::format("names {} files, the run was made with {}", given.size(), recorded.size()));
}

}  // namespace etalon
