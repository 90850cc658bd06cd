// What the kernel says about devices that come and go, for tests that plug them in and wait.
// Source: Linux, Documentation/core-api/kobject.rst (uevents); netlink(7).
#pragma once

#include <linux/netlink.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <list>
#include <map>

#include "core/file/text.h"
#include "core/time/clock.h"

namespace etalon {

class DeviceEvents {
public:
    // From udev, once its database knows the device, or straight from the kernel.
    enum class From { kernel = 1, udev = 2 };

    // Listens from now on, so it is made before the device is plugged in.
    explicit DeviceEvents(From from)
        : socket_(socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_KOBJECT_UEVENT)) {
        sockaddr_nl name{};
        name.nl_family = AF_NETLINK;
        name.nl_groups = static_cast<unsigned>(from);
        if (socket_ < 0 || bind(socket_, reinterpret_cast<sockaddr*>(&name), sizeof name) != 0)
            throw DeviceError("device events", "listen", std::strerror(errno));
    }
    ~DeviceEvents() { close(socket_); }
    DeviceEvents(const DeviceEvents&) = delete;
    DeviceEvents& operator=(const DeviceEvents&) = delete;

    using Properties = std::map<std::string, std::string>;

    // The properties of the next event of this kind ("add", "video4linux"); those of other kinds
    // are kept for other calls. Waits up to 20 s. Throws DeviceError when there is none.
    Properties next(const std::string& action, const std::string& subsystem) {
        const auto is_wanted = [&](Properties& event) {
            return event["ACTION"] == action && event["SUBSYSTEM"] == subsystem;
        };
        const Instant deadline = SteadyClock().now() + std::chrono::seconds(20);
        auto found = std::find_if(kept_.begin(), kept_.end(), is_wanted);
        while (found == kept_.end()) {
            auto event = receive(deadline);
            if (!event)
                throw DeviceError("device events", "wait for " + action + " of " + subsystem,
                                  "none in 20 s");
            kept_.push_back(std::move(*event));
            if (is_wanted(kept_.back()))
                found = std::prev(kept_.end());
        }
        Properties event = std::move(*found);
        kept_.erase(found);
        return event;
    }

private:
    std::optional<Properties> receive(Instant deadline) {
        SteadyClock clock;
        const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - clock.now());
        pollfd wanted{socket_, POLLIN, 0};
        if (left.count() <= 0 || poll(&wanted, 1, static_cast<int>(left.count())) <= 0)
            return std::nullopt;
        std::array<char, 8192> buffer{};
        const ssize_t size = recv(socket_, buffer.data(), buffer.size(), 0);
        // Words that end with a zero byte, "KEY=value" among others (udev's binary header).
        Properties out;
        for (const std::string& word :
             split({buffer.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0))}, '\0'))
            if (const std::size_t equals = word.find('='); equals != std::string::npos)
                out[word.substr(0, equals)] = word.substr(equals + 1);
        return out;
    }

    int socket_ = -1;
    std::list<Properties> kept_;
};

// Waits for all that the kernel makes of a USB camera: a node for pictures, one for metadata, one
// for the whole. The path of the first ("/dev/video0").
inline std::string next_camera(DeviceEvents& events) {
    std::string pictures;
    for (int nodes = 0; nodes < 2;) {
        auto properties = events.next("add", "video4linux");
        std::ifstream index("/sys" + properties["DEVPATH"] + "/index");
        int number = -1;
        if (!(index >> number))
            continue;  // it is gone again
        ++nodes;
        if (number == 0)
            pictures = (std::filesystem::path("/dev") / properties["DEVNAME"]).string();
    }
    events.next("add", "media");
    return pictures;
}

}  // namespace etalon
