// The versions of this program and its libraries, for records, pages and `etalon --version`.
#pragma once

#include <string>
#include <vector>

namespace etalon {

struct SoftwareVersion {
    std::string name, version;  // "OpenCV", "4.6.0"
};
std::vector<SoftwareVersion> software_versions();

}  // namespace etalon
