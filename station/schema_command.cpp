// `etalon schema`: JSON Schemas for editors, made of what the readers of this program ask.
#include <fmt/format.h>

#include "calib/files/camera_file.h"
#include "core/config/file_schema.h"
#include "core/file/text.h"
#include "stage/profile/profile.h"
#include "station/certify/certificate.h"
#include "station/commands.h"
#include "study/study_file.h"

namespace etalon {
namespace {

struct SchemaArguments {
    std::vector<std::filesystem::path> files;
    std::filesystem::path out;
    bool json = false;
};

struct ReaderOfKind {
    const char* kind;
    void (*read)(const std::filesystem::path& path);
};

constexpr ReaderOfKind readers[] = {
    {"certificate/1", [](const auto& path) { read_certificate_form(path); }},
    {"camera/1", [](const auto& path) { read_any_camera(path); }},
    {"limits/1", [](const auto& path) { read_limits(path); }},
    {"stage-profile/1", [](const auto& path) { read_stage_profile(path); }},
    {"station/1", [](const auto& path) { read_station(path); }},
    {"study/1", [](const auto& path) { read_study(path); }},
};

std::string kind_of(const std::filesystem::path& path) {
    constexpr std::string_view key = "etalon:";
    for (const std::string& line : split(read_text(path), '\n'))
        if (line.starts_with(key))
            return std::string(trimmed(line.substr(key.size())));
    return "";
}

void read_as_declared(const std::filesystem::path& path) {
    const std::string kind = kind_of(path);
    const auto* reader =
        std::ranges::find_if(readers, [&](const ReaderOfKind& one) { return one.kind == kind; });
    if (reader == std::end(readers))
        throw ConfigError({path.string()}, fmt::format("there is no schema of '{}' here", kind));
    reader->read(path);
}

int run_schema(const SchemaArguments& arguments) {
    ReadTrace trace;
    for (const std::filesystem::path& path : arguments.files)
        read_as_declared(path);
    write_schemas(trace, arguments.out);
    return 0;
}

}  // namespace

void declare_schema(Command& program) {
    auto [command, asked] = program.add(
        run_schema, "schema", "make JSON Schemas of our files, for editors",
        "Reads FILES and writes to DIR a JSON Schema of each kind among them, with the\n"
        "keys, types and ranges that the reader asked for: files that have every key\n"
        "give whole schemas (examples/every-key). Those that are installed in\n"
        "share/etalon/schema are made so, and named in the first lines of our\n"
        "examples. What one key says about another only the reader knows.\n");
    command.required("FILES", asked->files, "files without an error");
    command.required("--out", asked->out, "folder for camera.json, station.json, ...", "DIR");
}

}  // namespace etalon
