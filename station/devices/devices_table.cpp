#include <fmt/format.h>

#include "core/file/text.h"
#include "station/devices/commands.h"
#include "station/record/record_json.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

constexpr std::size_t max_column = 30;  // a longer name pushes the rest of its line
constexpr const char* of_camera = "      ";
constexpr const char* of_feature = "          ";

struct Row {
    std::string name, value;
    std::vector<std::string> words;
};

std::string rows_text(const std::vector<Row>& rows) {
    std::size_t names = 0, values = 0;
    for (const Row& row : rows) {
        names = std::max(names, std::min(row.name.size(), max_column));
        values = std::max(values, std::min(row.value.size(), max_column));
    }
    const std::size_t indent = std::string(of_feature).size() + names + values + 4;
    std::string text;
    for (const Row& row : rows) {
        const std::string line =
            fmt::format("{}{:<{}}  {:<{}}  ", of_feature, row.name, names, row.value, values);
        text += wrapped_words(line, row.words, ", ", indent);
    }
    return text;
}

std::string sizes_text(const FrameSizes& sizes) {
    const auto text = [](cv::Size size) { return fmt::format("{}x{}", size.width, size.height); };
    if (sizes.smallest == sizes.largest)
        return text(sizes.largest);
    return text(sizes.smallest) + " to " + text(sizes.largest);
}

std::string formats_text(const std::vector<CameraFormat>& formats) {
    std::vector<Row> rows;
    std::vector<std::string> useless;
    for (const CameraFormat& format : formats) {
        if (format.bits == 0) {
            useless.push_back(format.name);
            continue;
        }
        Row row{format.name, fmt::format("{} bits", format.bits), {}};
        for (const FrameSizes& sizes : format.sizes)
            row.words.push_back(sizes_text(sizes));
        rows.push_back(row);
    }
    const std::string heading = std::string(of_feature) + "cannot be unpacked: ";
    return rows_text(rows) +
           (useless.empty() ? "" : wrapped_words(heading, useless, ", ", heading.size()));
}

// Whole numbers in full: 10000000, not 1e+07.
std::string number(double value) {
    const bool whole = value == std::trunc(value) && std::abs(value) < 1e15;
    return whole ? fmt::format("{:.0f}", value) : fmt::format("{:g}", value);
}

std::string range_text(const CameraControl& control) {
    std::string text;
    if (control.low && control.high)
        text = number(*control.low) + " to " + number(*control.high);
    if (control.step && *control.step != 1.0)
        text += (text.empty() ? "steps " : ", steps ") + number(*control.step);
    return text;
}

std::string controls_text(const std::vector<CameraControl>& controls) {
    std::vector<Row> rows;
    for (const CameraControl& control : controls) {
        Row row{control.name, control.value, control.choices};
        if (!control.unit.empty())
            row.value += " " + control.unit;
        if (row.words.empty())
            row.words.push_back(range_text(control));
        if (control.read_only)
            row.words.emplace_back("read only");
        std::erase(row.words, "");
        rows.push_back(row);
    }
    return rows_text(rows);
}

std::string camera_text(const ListedCamera& camera) {
    const CameraIdentity& identity = camera.identity;
    const std::string name = fmt::format("{} {}, serial {}", identity.vendor, identity.model,
                                         identity.serial.empty() ? "unknown" : identity.serial);
    std::string text =
        wrapped_words(of_camera + identity.uri + "  ", {std::string(trimmed(name))}, ", ", 8);
    if (!camera.fault.empty())
        text += wrapped_text("        ", camera.fault);
    if (!camera.abilities.formats.empty())
        text += "        formats\n" + formats_text(camera.abilities.formats);
    if (!camera.abilities.controls.empty())
        text += "        controls\n" + controls_text(camera.abilities.controls);
    return text;
}

// One width for cameras and stages.
std::size_t name_width(const std::vector<ListedBackend>& backends,
                       const std::vector<std::string>& stage_profiles) {
    std::size_t width = 0;
    for (const ListedBackend& listed : backends)
        width = std::max(width, listed.backend.name.size());
    for (const std::string& profile : stage_profiles)
        width = std::max(width, profile.size());
    return width;
}

std::string backend_text(const ListedBackend& listed, std::size_t width) {
    const CameraBackend& backend = listed.backend;
    std::string text = wrapped_text(
        fmt::format("  {:<{}}  {:<5}", backend.name, width, backend.built_in ? "yes" : "no"),
        backend.detail);
    for (const ListedCamera& camera : listed.cameras)
        text += camera_text(camera);
    if (backend.built_in && backend.name != "files" && listed.cameras.empty())
        text += std::string(of_camera) + "no camera answers\n";
    return text;
}

ListedCamera listed(const CameraIdentity& identity, Clock& clock) {
    ListedCamera camera{identity, {}, ""};
    try {
        camera.abilities = open_camera(identity.uri, {}, clock)->abilities();
    } catch (const Error& error) {
        camera.fault = error.what();
    }
    return camera;
}

std::vector<ListedBackend> listed_backends() {
    SteadyClock clock;
    std::vector<ListedBackend> backends;
    for (CameraBackend& backend : list_cameras()) {
        std::vector<ListedCamera> cameras;
        for (const CameraIdentity& identity : backend.cameras)
            cameras.push_back(listed(identity, clock));
        backends.push_back({std::move(backend), std::move(cameras)});
    }
    return backends;
}

Json pair_of(cv::Size size) {
    return {size.width, size.height};
}

Json format_json(const CameraFormat& format) {
    return {{"name", format.name},
            {"description", format.description},
            {"bits", format.bits},
            {"sizes", json_list(format.sizes, [](const FrameSizes& sizes) {
                 return Json{{"smallest", pair_of(sizes.smallest)},
                             {"largest", pair_of(sizes.largest)},
                             {"step", pair_of(sizes.step)}};
             })}};
}

Json control_json(const CameraControl& control) {
    return {{"name", control.name},          {"value", control.value},
            {"unit", control.unit},          {"low", or_null(control.low)},
            {"high", or_null(control.high)}, {"step", or_null(control.step)},
            {"choices", control.choices},    {"read_only", control.read_only}};
}

Json listed_camera_json(const ListedCamera& camera) {
    Json json = camera.identity;
    json["fault"] = camera.fault;
    json["formats"] = json_list(camera.abilities.formats, format_json);
    json["controls"] = json_list(camera.abilities.controls, control_json);
    return json;
}

Json backend_json(const ListedBackend& listed) {
    return {{"name", listed.backend.name},
            {"built_in", listed.backend.built_in},
            {"detail", listed.backend.detail},
            {"cameras", json_list(listed.cameras, listed_camera_json)}};
}

}  // namespace

std::string devices_table(const std::vector<ListedBackend>& backends,
                          const std::vector<std::string>& stage_profiles) {
    const std::size_t width = name_width(backends, stage_profiles);
    std::string text = "cameras\n";
    for (const ListedBackend& listed : backends)
        text += backend_text(listed, width);
    text += "stages\n";
    for (const std::string& profile : stage_profiles)
        text += fmt::format("  {:<{}}  {:<5}Modbus TCP\n", profile, width, "yes");
    return text;
}

int run_devices(const DevicesArguments& arguments) {
    const std::vector<ListedBackend> backends = listed_backends();
    if (arguments.json)
        fmt::print("{}\n", text_of({{"etalon", "devices/1"},
                                    {"camera_backends", json_list(backends, backend_json)},
                                    {"stage_profiles", builtin_stage_profile_names()}}));
    else
        fmt::print("{}", devices_table(backends, builtin_stage_profile_names()));
    return 0;
}

void declare_devices(Command& program) {
    program.add(run_devices, "devices", "list cameras, and the backends that are built in",
                "Each camera is opened for a moment to ask for its pixel formats and controls. A\n"
                "backend whose SDK was missing when this program was built is named as left out,\n"
                "with the reason.\n");
}

}  // namespace etalon
