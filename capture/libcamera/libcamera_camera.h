// Cameras behind libcamera: embedded sensors, and USB cameras. They run freely; a frame is waited
// for, and taken only if its exposure began after the moment asked for (FrameTiming in
// libcamera_device.h). Silent: no frame within the link's frame_timeout.
//
// Settings reach the sensor some frames late. configure() and arm() wait until the frames' metadata
// say that they are in force, at most 20 frames; every frame is asked again. What the metadata
// never mention (USB cameras tell no exposure) is refused; v4l2: reads such cameras back.
#pragma once

#include "capture/libcamera/libcamera_device.h"

namespace etalon {

using LibcameraOpener = std::function<std::unique_ptr<LibcameraDevice>(const std::string& id)>;

// `id` as libcamera has it; `open` is asked again for it after a loss. Throws DeviceError when
// there is no such camera or another program has it.
std::unique_ptr<Camera> open_libcamera_camera(const std::string& id, const CameraLink& link,
                                              Clock& clock,
                                              LibcameraOpener open = open_libcamera_device);

}  // namespace etalon
