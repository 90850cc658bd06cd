// GenICam cameras (GigE Vision, USB3 Vision) through Aravis 0.8: triggered by software, by a line,
// or running freely.
//
// A GigE Vision camera reaches us over UDP, and every default of the transport was measured to fail
// somewhere, so all of it is set here on purpose: the kernel's packet socket is not used (it binds
// the wrong network card), the packet size is given and never negotiated, the receive buffer is
// asked for in one piece, and the first frame after a start is thrown away (unless a line
// triggers).
//
// Freshness: a frame that answers a software trigger began between sending that trigger and its own
// arrival. Of any other the device's clock must say so: it is read before each frame, and a stamp
// may lie anywhere in the exposure. A device without a readable clock is stopped and started again
// after the moment asked for. A frame whose stamp contradicts what the station saw (a clock that
// was set, wrapped or went back) is `corrupt`, and a triggered one is dated by its trigger alone. A
// clock that PTP has not synchronised yet counts as none.
//
// Where the device says what a frame was taken with (chunks), a frame that was taken otherwise than
// asked is `corrupt`.
//
// Loss: a request to a device that has gone fails after the control protocol's own five tries of
// 0.5 s, which no setting of the library shortens (and waits for the heartbeat's). From then on
// every call fails at once, and what the library still wants to tell the device is told in the
// background. reconnect() makes all anew.
#pragma once

#include "capture/frame/camera.h"

namespace etalon {

// `id` is an IP address or a device id as `etalon devices` prints it. Throws DeviceError when the
// device does not answer (within 3 s), CameraBusy when it is controlled by another program. What an
// earlier program left streaming is ended.
std::unique_ptr<Camera> open_genicam_camera(const std::string& id, const CameraLink& link,
                                            Clock& clock);

// Asks every network card and the USB bus; takes about a second.
std::vector<CameraIdentity> list_genicam_cameras();

}  // namespace etalon
