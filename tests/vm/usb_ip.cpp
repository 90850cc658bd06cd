#include "tests/vm/usb_ip.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>
#include <string>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr std::uint32_t submit = 1, unlink_request = 2, submit_answer = 3, unlink_answer = 4;
constexpr int high_speed = 3;                 // enum usb_device_speed
constexpr std::uint32_t port_free = 4;        // VDEV_ST_NULL
constexpr std::uint32_t device_id = 0x10002;  // bus 1, device 2: any will do
constexpr std::size_t max_write = 1 << 16;    // from the host: settings, never data

// All words are big-endian. Their meaning past the first five depends on the command.
struct Header {
    std::uint32_t command = 0, id = 0, device = 0, to_host = 0, endpoint = 0;
    std::uint32_t flags_or_status = 0, length = 0, start_frame = 0, packets = 0, interval = 0;
    std::array<std::uint8_t, 8> setup{};
};
static_assert(sizeof(Header) == 48);

UsbSetup setup_of(const Header& header) {
    const auto& s = header.setup;  // little-endian, as on the wire
    return {s[0], s[1], s[2] | s[3] << 8, s[4] | s[5] << 8, s[6] | s[7] << 8};
}

// The controller's table: hub, port, state, ... of each port, one line each below a heading. Always
// the first port, since a camera's identity is where it is plugged in.
int first_port(const std::filesystem::path& controller) {
    std::ifstream table(controller / "status");
    if (!table)
        throw DeviceError(controller.string(), "plug in",
                          "there is no such controller: is the module vhci_hcd loaded?");
    std::string line;
    while (std::getline(table, line)) {
        std::istringstream words(line);
        std::string hub;
        int port = 0;
        std::uint32_t state = 0;
        if (words >> hub >> port >> state && hub == "hs") {
            if (state != port_free)
                throw DeviceError(controller.string(), "plug in", "its first port is taken");
            return port;
        }
    }
    throw DeviceError(controller.string(), "plug in", "it has no high-speed port");
}

// Hands the socket's other end to the kernel.
void attach(const std::filesystem::path& controller, int socket) {
    const std::string order =
        fmt::format("{} {} {} {}", first_port(controller), socket, device_id, high_speed);
    const int file = open((controller / "attach").c_str(), O_WRONLY | O_CLOEXEC);
    const bool done =
        file >= 0 && write(file, order.data(), order.size()) == static_cast<ssize_t>(order.size());
    const std::string cause = done ? "" : std::strerror(errno);
    if (file >= 0)
        close(file);
    if (!done)
        throw DeviceError(controller.string(), "plug in", cause);
}

}  // namespace

UsbPlug::UsbPlug(const std::filesystem::path& controller) {
    std::array<int, 2> ends{};
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0)
        throw DeviceError(controller.string(), "make a socket", std::strerror(errno));
    socket_ = ends[0];
    try {
        attach(controller, ends[1]);
    } catch (const Error&) {
        close(ends[0]);
        close(ends[1]);
        throw;
    }
    close(ends[1]);
}

UsbPlug::~UsbPlug() {
    close(socket_);
}

bool UsbPlug::read_all(void* data, std::size_t size) {
    return size == 0 || recv(socket_, data, size, MSG_WAITALL) == static_cast<ssize_t>(size);
}

std::optional<UsbMessage> UsbPlug::receive() {
    Header header;
    if (!read_all(&header, sizeof header))
        return std::nullopt;
    const std::uint32_t id = ntohl(header.id);
    if (ntohl(header.command) == unlink_request)
        return UsbCancellation{id, ntohl(header.flags_or_status)};
    if (ntohl(header.command) != submit)
        return std::nullopt;
    UsbTransfer transfer;
    transfer.id = id;
    transfer.endpoint = static_cast<int>(ntohl(header.endpoint));
    transfer.to_host = ntohl(header.to_host) != 0;
    transfer.length = ntohl(header.length);
    transfer.setup = setup_of(header);
    if (!transfer.to_host) {
        if (transfer.length > max_write)
            return std::nullopt;
        transfer.data.resize(transfer.length);
        if (!read_all(transfer.data.data(), transfer.data.size()))
            return std::nullopt;
    }
    return transfer;
}

void UsbPlug::send(const UsbTransfer& transfer, std::span<const std::uint8_t> data) {
    answer(submit_answer, transfer.id, 0, data.size(), data);
}

void UsbPlug::accept(const UsbTransfer& transfer) {
    answer(submit_answer, transfer.id, 0, transfer.data.size(), {});
}

void UsbPlug::stall(const UsbTransfer& transfer) {
    answer(submit_answer, transfer.id, -EPIPE, 0, {});
}

void UsbPlug::confirm(const UsbCancellation& cancellation, bool was_waiting) {
    answer(unlink_answer, cancellation.id, was_waiting ? -ECONNRESET : 0, 0, {});
}

// A host that has let go is noticed by the next receive().
void UsbPlug::answer(std::uint32_t command, std::uint32_t id, int status, std::size_t length,
                     std::span<const std::uint8_t> data) {
    Header header;
    header.command = htonl(command);
    header.id = htonl(id);
    header.flags_or_status = htonl(static_cast<std::uint32_t>(status));
    header.length = htonl(static_cast<std::uint32_t>(length));
    std::array<iovec, 2> parts{iovec{&header, sizeof header},
                               iovec{const_cast<std::uint8_t*>(data.data()), data.size()}};
    msghdr message{};
    message.msg_iov = parts.data();
    message.msg_iovlen = parts.size();
    (void)sendmsg(socket_, &message, MSG_NOSIGNAL);  // blocking: all of it or none
}

}  // namespace etalon
