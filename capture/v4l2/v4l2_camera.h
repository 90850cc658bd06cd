// Cameras with a Video for Linux driver: USB cameras (UVC), sensors on a board, frame grabbers.
//
// They run freely, without a trigger. frame_after(t) throws frames away until one began its
// exposure after t, by the driver's time stamp. What a stamp proves, and no more:
//
//   monotonic, start of exposure    the exposure began then, within 0.5 ms
//   monotonic, end of frame         the exposure had ended, at most one frame period earlier
//   any other clock, or ahead of    the frame came between the moment at which the queue was last
//   its frame's arrival             seen empty and now; else as end of frame
//
// For uvcvideo, which stamps a frame's first data as start of exposure, see v4l2_timing.h. A stamp
// further in the future, or that does not advance, makes a frame `corrupt`.
//
// Gains have no unit here: gain_db must be 0, the lowest gain; others are set by name in
// CaptureSettings::controls, and so is the frame rate, as "frame_rate" (Hz).
#pragma once

#include "capture/v4l2/v4l2_device.h"

namespace etalon {

// `id`: a node ("/dev/video0", or a link) or a place on the bus ("usb-0000:00:14.0-1"), the same
// after replugging. Throws DeviceError without a camera there. The system outlives the camera.
std::unique_ptr<Camera> open_v4l2_camera(const std::string& id, const CameraLink& link,
                                         Clock& clock, V4l2System& system = v4l2_system());

// Every node that captures video, and those that this user may not open, which say so.
std::vector<CameraIdentity> list_v4l2_cameras(V4l2System& system = v4l2_system());

}  // namespace etalon
