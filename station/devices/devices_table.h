// The cameras that answer, with their formats and controls, as text for people in lines of at most
// 79 columns (longer only where a single word is). For programs there is `etalon devices --json`.
#pragma once

#include "capture/frame/camera.h"

namespace etalon {

struct ListedCamera {
    CameraIdentity identity;
    CameraAbilities abilities;
    std::string fault;  // why it has none: it is in use, or we may not open it
};

struct ListedBackend {
    CameraBackend backend;
    std::vector<ListedCamera> cameras;
};

std::string devices_table(const std::vector<ListedBackend>& backends,
                          const std::vector<std::string>& stage_profiles);

}  // namespace etalon
