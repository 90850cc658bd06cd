#include "tests/vm/device_events.h"

#include <linux/netlink.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "core/file/text.h"

namespace etalon {
namespace {

constexpr std::chrono::seconds patience(20);

// Words that end with a zero byte, "KEY=value" among others (udev's binary header).
DeviceEvents::Properties properties_of(const std::string& message) {
    DeviceEvents::Properties out;
    for (const std::string& word : split(message, '\0'))
        if (const std::size_t equals = word.find('='); equals != std::string::npos)
            out[word.substr(0, equals)] = word.substr(equals + 1);
    return out;
}

}  // namespace

DeviceEvents::DeviceEvents(From from)
    : socket_(socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_KOBJECT_UEVENT)) {
    sockaddr_nl name{};
    name.nl_family = AF_NETLINK;
    name.nl_groups = static_cast<unsigned>(from);
    if (socket_ < 0 || bind(socket_, reinterpret_cast<sockaddr*>(&name), sizeof name) != 0)
        throw DeviceError("device events", "listen", std::strerror(errno));
}

DeviceEvents::~DeviceEvents() {
    close(socket_);
}

std::optional<DeviceEvents::Properties> DeviceEvents::receive(Instant deadline) {
    SteadyClock clock;
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - clock.now());
    pollfd wanted{socket_, POLLIN, 0};
    if (left.count() <= 0 || poll(&wanted, 1, static_cast<int>(left.count())) <= 0)
        return std::nullopt;
    std::array<char, 8192> buffer{};
    const ssize_t size = recv(socket_, buffer.data(), buffer.size(), 0);
    return properties_of({buffer.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0))});
}

DeviceEvents::Properties DeviceEvents::next(const std::string& action,
                                            const std::string& subsystem) {
    const auto is_wanted = [&](Properties& event) {
        return event["ACTION"] == action && event["SUBSYSTEM"] == subsystem;
    };
    const Instant deadline = SteadyClock().now() + patience;
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

std::string next_camera(DeviceEvents& events) {
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
