// A backend whose SDK is loaded when a camera of it is asked for (core/program/plugin.h): Aravis
// and GLib, libcamera.
#pragma once

#include "capture/frame/camera.h"

namespace etalon {

// The plugin's table.
struct CameraPlugin {
    std::vector<CameraIdentity> (*list)();
    // `id` is what follows the colon of the URI.
    std::unique_ptr<Camera> (*open)(const std::string& id, const CameraLink& link, Clock& clock);
};

}  // namespace etalon
