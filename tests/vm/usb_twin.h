// The twin with a USB camera: a stage over Modbus TCP on 127.0.0.1 and pictures that follow it, as
// in mocks/twin/twin.h, shown by a camera on this kernel's virtual USB port. It runs freely and is
// a consumer's: as it powers up, it chooses its own exposure and sharpens.
#pragma once

#include "mocks/twin/twin.h"
#include "tests/vm/usb_camera.h"

namespace etalon {

class UsbTwin {
public:
    // `sharpness` is the camera's after power-up, 0 to 7. Throws as TwinRig and UsbCamera do.
    UsbTwin(const TwinFile& file, int sharpness);

private:
    std::vector<std::uint8_t> expose(const UsbExposure& exposure) const;

    TwinRig rig_;
    UsbCamera camera_;  // last: its thread uses the rig
};

}  // namespace etalon
