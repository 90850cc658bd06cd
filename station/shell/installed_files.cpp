#include "station/shell/installed_files.h"

#include "core/program/errors.h"

namespace etalon {

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
