// A USB device that is a program: USB/IP as Linux' virtual host controller (vhci_hcd) speaks it to
// whoever holds the other end of a socket. Device side only; bulk and control transfers only.
// Source: Linux, Documentation/usb/usbip_protocol.rst.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <variant>
#include <vector>

namespace etalon {

// The first 8 bytes of a control transfer (USB 2.0, 9.3).
struct UsbSetup {
    int type = 0, request = 0;
    int value = 0, index = 0, length = 0;
};

// What the host asks for; it waits for exactly one answer with the same id.
struct UsbTransfer {
    std::uint32_t id = 0;
    int endpoint = 0;
    bool to_host = false;
    std::size_t length = 0;          // bytes, at most, if to_host
    UsbSetup setup;                  // of endpoint 0
    std::vector<std::uint8_t> data;  // unless to_host
};

// The host no longer waits for the answer to `transfer`.
struct UsbCancellation {
    std::uint32_t id = 0, transfer = 0;
};

using UsbMessage = std::variant<UsbTransfer, UsbCancellation>;

// A plugged-in high-speed device. One thread at a time.
class UsbPlug {
public:
    // Plugs into the first port. Throws DeviceError where there is no such controller (the module
    // vhci_hcd is not loaded), it may not be used (only root may), or the port is taken.
    explicit UsbPlug(const std::filesystem::path& controller);
    ~UsbPlug();  // pulls it: for the host the device is gone
    UsbPlug(const UsbPlug&) = delete;
    UsbPlug& operator=(const UsbPlug&) = delete;

    // Readable when there is a message.
    int descriptor() const { return socket_; }

    // Waits for it; nothing once the host has let go of the device, or speaks another protocol.
    std::optional<UsbMessage> receive();

    // Answers. `data` must not be longer than was asked for.
    void send(const UsbTransfer& transfer, std::span<const std::uint8_t> data);
    void accept(const UsbTransfer& transfer);
    void stall(const UsbTransfer& transfer);
    // Whether the transfer's answer was still to come (it must not be sent any more).
    void confirm(const UsbCancellation& cancellation, bool was_waiting);

private:
    bool read_all(void* data, std::size_t size);
    void answer(std::uint32_t command, std::uint32_t id, int status, std::size_t length,
                std::span<const std::uint8_t> data);

    int socket_ = -1;
};

}  // namespace etalon
