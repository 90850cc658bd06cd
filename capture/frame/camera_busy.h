// Why a camera cannot be opened now, but perhaps soon.
#pragma once

#include <chrono>
#include <string>

#include "core/program/errors.h"

namespace etalon {

// Another program controls it, or one that was killed still seems to: the camera lets go of that
// one when its heartbeat has been missing for so long.
class CameraBusy : public DeviceError {
public:
    CameraBusy(const std::string& device, std::chrono::milliseconds heartbeat_timeout)
        : DeviceError(device, "open", "it is controlled by another program"),
          heartbeat_timeout_(heartbeat_timeout) {}

    std::chrono::milliseconds heartbeat_timeout() const { return heartbeat_timeout_; }

private:
    std::chrono::milliseconds heartbeat_timeout_;
};

}  // namespace etalon
