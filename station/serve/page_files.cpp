#include "station/serve/page_files.h"

#include "core/file/text.h"
#include "station/shell/installed_files.h"

namespace etalon {
namespace {

using Path = std::filesystem::path;

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
    for (const auto& entry : std::filesystem::directory_iterator(installed_file("web")))
        if (const std::string type = type_of(entry.path()); !type.empty())
            files["/" + entry.path().filename().string()] = {type, read_text(entry.path())};
    files["/"] = files.at("/index.html");
    return files;
}

}  // namespace etalon
