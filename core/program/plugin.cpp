#include "core/program/plugin.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <string_view>

#include "core/program/errors.h"
#include "core/program/version.h"

namespace etalon {
namespace {

// The program, shared library or Python module that holds this code.
std::filesystem::path file_of_this_code() {
    Dl_info found{};
    const void* here = reinterpret_cast<const void*>(&load_plugin);
    // The program itself is named as it was called, maybe without its folder.
    const bool is_known = dladdr(here, &found) != 0 && found.dli_fname != nullptr &&
                          std::filesystem::path(found.dli_fname).is_absolute();
    std::error_code ignored;
    return std::filesystem::canonical(is_known ? found.dli_fname : "/proc/self/exe", ignored);
}

// The nearest one; the bare name, for the dynamic linker's own search, where there is none.
std::filesystem::path plugin_path(const std::string& file) {
    std::error_code ignored;
    std::filesystem::path folder = file_of_this_code();
    for (int up = 0; up < 6 && folder.has_relative_path(); ++up) {
        folder = folder.parent_path();
        const std::filesystem::path path = folder / ETALON_LIBDIR / "etalon" / file;
        if (std::filesystem::exists(path, ignored))
            return path;
    }
    return file;
}

template <class Function>
Function* function_of(void* library, const char* name) {
    return reinterpret_cast<Function*>(dlsym(library, name));
}

}  // namespace

const void* load_plugin(const std::string& name) {
    const std::string file = "etalon_" + name + ".so";
    const std::filesystem::path path = plugin_path(file);
    void* library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
    if (library == nullptr)
        throw Error(
            fmt::format("{} cannot be loaded ({}): install Etalon's libraries again (Debian "
                        "package libetalon0; in a build folder, the target etalon_plugins)",
                        file, dlerror()));
    const auto plugin_version = function_of<const char*()>(library, "etalon_plugin_version");
    const auto table = function_of<const void*()>(library, "etalon_plugin_table");
    if (plugin_version == nullptr || table == nullptr ||
        version != std::string_view(plugin_version()))
        throw Error(
            fmt::format("{} is not of etalon {}: install Etalon's libraries again (Debian "
                        "package libetalon0)",
                        path.string(), version));
    return table();
}

}  // namespace etalon
