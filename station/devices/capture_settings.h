// The camera of `etalon capture`, as its command line describes it.
#pragma once

#include "capture/frame/camera.h"
#include "station/devices/commands.h"

namespace etalon {

// Throws ConfigError for a --set that is no NAME=NUMBER.
CaptureSettings capture_settings(const CaptureArguments& arguments);

CameraLink camera_link(const CaptureArguments& arguments);

}  // namespace etalon
