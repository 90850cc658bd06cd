// Cameras behind libcamera: sensors on embedded boards, with or without an image processor, and USB
// ones. They run freely; a frame is waited for, not triggered.
//
// Fresh: a request is queued only when its buffer has been looked at, and its frame is taken only
// if the exposure began after the moment asked for. The frame's SensorTimestamp is defined as the
// beginning of its first line's exposure, but what most drivers stamp is that line's readout. So
// the exposure began within the ExposureTime before the stamp; or, where the metadata do not tell
// it, after the stamp of the frame before, since a line is not exposed again before it was read.
//
// Settings reach the sensor some frames late. They are in force when the frames' metadata say so,
// which configure() and arm() wait for, at most 20 frames, and which every frame is asked again.
// What is asked for and is never mentioned there (USB cameras tell no exposure) is refused; v4l2:
// reads such cameras back.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "capture/libcamera_device.h"

namespace etalon {

using LibcameraOpener = std::function<std::unique_ptr<LibcameraDevice>(const std::string& id)>;

// `id` as libcamera has it; `open` is asked again for it after a loss. Throws DeviceError when
// there is no such camera or another program has it.
std::unique_ptr<Camera> open_libcamera_camera(const std::string& id, const CameraLink& link,
                                              Clock& clock,
                                              LibcameraOpener open = open_libcamera_device);

}  // namespace etalon
