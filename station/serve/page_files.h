// The page itself: every file of web/, read once. No request reaches the file system for one.
#pragma once

#include <filesystem>
#include <map>
#include <string>

namespace etalon {

struct PageFile {
    std::string type, content;  // "text/css"
};

// By its path in the address: "/", "/run.js". Of the folder that was installed beside this program
// (share/etalon/web), else that of the sources that it was built from. Throws ConfigError when
// there is none.
std::map<std::string, PageFile> page_files();

}  // namespace etalon
