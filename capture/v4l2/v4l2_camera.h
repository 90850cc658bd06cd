// Cameras with a Video for Linux driver: USB cameras (UVC), sensors on a board, frame grabbers.
//
// Such a camera runs freely: there is no trigger. frame_after(t) throws frames away until one began
// its exposure after t, by the driver's time stamp. What a stamp proves, and no more:
//
//   monotonic, start of exposure    the exposure began then, within 0.5 ms
//   monotonic, end of frame         the exposure had ended, at most one frame period earlier
//   any other clock, or ahead of    the frame came between the moment at which the queue was last
//   its frame's arrival             seen empty and now; else as end of frame
//
// The driver uvcvideo calls the arrival of a frame's first data the start of its exposure: what any
// of its stamps proves is in v4l2_timing.h.
//
// Stamps that lie further in the future or do not advance make a frame `corrupt`; frames that are
// old by their stamps are thrown away until the time-out.
//
// Gains of this interface have no unit: gain_db must be 0, which is the lowest gain; set others
// by name in CaptureSettings::controls. So is the frame rate, as "frame_rate" (Hz).
#pragma once

#include "capture/v4l2/v4l2_device.h"

namespace etalon {

// `id` is a node ("/dev/video0", or a link to one) or a device's place on its bus
// ("usb-0000:00:14.0-1"), which stays the same when it is plugged in again. Throws DeviceError when
// there is none or it is no camera. The system outlives the camera.
std::unique_ptr<Camera> open_v4l2_camera(const std::string& id, const CameraLink& link,
                                         Clock& clock, V4l2System& system = v4l2_system());

// Every node that captures video, and those that this user may not open, which say so.
std::vector<CameraIdentity> list_v4l2_cameras(V4l2System& system = v4l2_system());

}  // namespace etalon
