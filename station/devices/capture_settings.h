// The camera of `etalon capture`, as its command line describes it.
#pragma once

#include "capture/frame/camera.h"
#include "station/devices/commands.h"

namespace etalon {

// Throws ConfigError for a --set that is no NAME=NUMBER.
CaptureSettings capture_settings(const CaptureArguments& arguments);

// Opened; one that another program controls is waited for, and it is said on stderr. Throws as
// open_when_free().
std::unique_ptr<Camera> opened_camera(const CaptureArguments& arguments, Clock& clock,
                                      const std::stop_token& stop);

}  // namespace etalon
