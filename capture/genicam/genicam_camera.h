// GenICam cameras (GigE Vision, USB3 Vision) through Aravis 0.8: triggered by software, by a line,
// or running freely. Every default of GigE Vision's transport was measured to fail somewhere, so
// all of it is set: no packet socket (it binds the wrong network card), a packet size that is never
// negotiated, one large receive buffer; the first frame is thrown away (unless a line triggers).
//
// Freshness: a frame that answers a software trigger began between that trigger and its own
// arrival. Of any other the device's clock must say so, which is read before each frame; a stamp
// may lie anywhere in the exposure. A device without a readable clock is started again after the
// moment asked for. A clock that PTP has not synchronised yet counts as none. A frame whose stamp
// contradicts what the station saw is `corrupt`; a triggered one is dated by its trigger alone. So
// is a frame whose chunks say that it was taken otherwise than asked.
//
// Loss: a request to a device that has gone fails after five tries of 0.5 s, which no setting of
// the library shortens (and waits for the heartbeat's). From then on every call fails at once, and
// what the library still wants to tell the device is told in the background.
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
