// Cameras behind libcamera: sensors on embedded boards, with or without an image processor, and USB
// ones. They run freely; a frame is waited for, not triggered. What a request brings is taken only
// if its exposure began after the moment asked for (FrameTiming in libcamera_device.h); older ones
// are queued again. A camera is silent when no frame comes within the link's frame_timeout.
//
// Settings reach the sensor some frames late. They are in force when the frames' metadata say so,
// which configure() and arm() wait for, at most 20 frames, and which every frame is asked again.
// What is asked for and is never mentioned there (USB cameras tell no exposure) is refused; v4l2:
// reads such cameras back.
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
