// GenICam cameras (GigE Vision, USB3 Vision) through Aravis 0.8, triggered by software.
//
// A GigE Vision camera reaches us over UDP, and every default of the transport was measured to fail
// somewhere, so all of it is set here on purpose: the kernel's packet socket is not used (it binds
// the wrong network card), the packet size is given and never negotiated, the receive buffer is
// asked for in one piece, and the first frame after each start is thrown away. A frame is handed on
// only if it is whole (the library calls truncated ones good, so sizes are compared), newer than
// the last one, and answered a trigger that was sent after the moment asked for.
//
// Time: the device's clock is not used. The exposure began between sending the trigger and the
// frame's arrival; the middle and half the width of that interval are what a Frame says.
//
// Loss: a request to a device that has gone fails after the control protocol's own five tries of
// 0.5 s, which no setting of the library shortens. From then on every call fails at once, and what
// the library still wants to tell the device is told in the background. A lost camera is not opened
// again by this class.
#pragma once

#include <memory>
#include <string>

#include "capture/camera.h"

namespace etalon {

// `id` is an IP address or a device id as `etalon devices` prints it. Throws DeviceError when the
// device does not answer (within 3 s) or is controlled by another program.
std::unique_ptr<Camera> open_genicam_camera(const std::string& id, const CameraLink& link,
                                            Clock& clock);

// Asks every network card and the USB bus; takes about a second.
std::vector<CameraIdentity> list_genicam_cameras();

// Of the headers that this program was built with.
std::string genicam_sdk_version();

}  // namespace etalon
