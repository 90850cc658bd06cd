// What the kernel says about devices that come and go, for tests that plug them in and wait.
// Source: Linux, Documentation/core-api/kobject.rst (uevents); netlink(7).
#pragma once

#include <list>
#include <map>

#include "core/time/clock.h"

namespace etalon {

class DeviceEvents {
public:
    // From udev, once its database knows the device, or straight from the kernel.
    enum class From { kernel = 1, udev = 2 };

    // Listens from now on, so it is made before the device is plugged in.
    explicit DeviceEvents(From from);
    ~DeviceEvents();
    DeviceEvents(const DeviceEvents&) = delete;
    DeviceEvents& operator=(const DeviceEvents&) = delete;

    using Properties = std::map<std::string, std::string>;

    // The properties of the next event of this kind ("add", "video4linux"); those of other kinds
    // are kept for other calls. Waits up to 20 s. Throws DeviceError when there is none.
    Properties next(const std::string& action, const std::string& subsystem);

private:
    std::optional<Properties> receive(Instant deadline);

    int socket_ = -1;
    std::list<Properties> kept_;
};

// Waits for all that the kernel makes of a USB camera: a node for pictures, one for metadata, one
// for the whole. The path of the first ("/dev/video0").
std::string next_camera(DeviceEvents& events);

}  // namespace etalon
