// GenICam cameras (GigE Vision, USB3 Vision) through Aravis 0.8, triggered by software, by a line,
// or running freely. All of GigE Vision's transport is set, since each default was measured to fail
// somewhere: no packet socket (it binds the wrong network card), a packet size never negotiated, a
// large receive buffer. The first frame is thrown away (unless a line triggers).
//
// Freshness: a software-triggered frame began between its trigger and its arrival. For others the
// device's clock, read before each frame, must say so; a stamp may lie anywhere in the exposure.
// Without a readable, PTP-steady clock the stream is restarted after the moment asked for. A frame
// whose stamp contradicts what the station saw is `corrupt` (a triggered one is dated by its
// trigger alone), and so is one whose chunks say that it was taken otherwise than asked.
//
// Loss: a request to a lost device fails after five tries of 0.5 s, which no setting shortens. Then
// every call fails at once; what the library still tells the device runs in the background.
#pragma once

#include "capture/frame/camera.h"

namespace etalon {

// `id`: an IP address or a device id of `etalon devices`. Throws DeviceError without an answer in
// 3 s, CameraBusy under another program's control. Ends what an earlier program left streaming.
std::unique_ptr<Camera> open_genicam_camera(const std::string& id, const CameraLink& link,
                                            Clock& clock);

// Asks every network card and the USB bus; takes about a second.
std::vector<CameraIdentity> list_genicam_cameras();

}  // namespace etalon
