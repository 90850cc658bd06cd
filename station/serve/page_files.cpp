#include "station/serve/page_files.h"

#include "core/errors.h"
#include "core/text.h"

namespace etalon {
namespace {

using Path = std::filesystem::path;

Path page_folder() {
    std::error_code error;
    const Path program = std::filesystem::read_symlink("/proc/self/exe", error);
    for (const Path& folder :
         {program.parent_path().parent_path() / "share/etalon/web", Path(ETALON_WEB_FOLDER)})
        if (std::filesystem::is_regular_file(folder / "index.html", error))
            return folder;
    throw ConfigError({ETALON_WEB_FOLDER}, "the page's files are not there, nor beside " +
                                               program.string() + " in ../share/etalon/web");
}

std::string type_of(const Path& file) {
    const std::string kind = file.extension().string();
    if (kind == ".html")
        return "text/html; charset=utf-8";
    if (kind == ".css")
        return "text/css; charset=utf-8";
    if (kind == ".js")
        return "text/javascript; charset=utf-8";
    return kind == ".svg" ? "image/svg+xml" : "";
}

}  // namespace

std::map<std::string, PageFile> page_files() {
    std::map<std::string, PageFile> files;
    for (const auto& entry : std::filesystem::directory_iterator(page_folder()))
        if (const std::string type = type_of(entry.path()); !type.empty())
            files["/" + entry.path().filename().string()] = {type, read_text(entry.path())};
    files["/"] = files.at("/index.html");
    return files;
}

}  // namespace etalon
