#include "tests/vm/usb_camera.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/eventfd.h>

#include <deque>
#include <fstream>
#include <sstream>

#include "core/program/errors.h"
#include "tests/vm/device_events.h"

namespace etalon {
namespace {

// ---- a USB device that is a program: USB/IP as Linux' virtual host controller (vhci_hcd) speaks
// it to whoever holds the other end of a socket. Device side only; bulk and control transfers only.
// Source: Linux, Documentation/usb/usbip_protocol.rst.

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

// A plugged-in high-speed device. One thread at a time.
class UsbPlug {
public:
    // Plugs into the first port. Throws DeviceError where there is no such controller (the module
    // vhci_hcd is not loaded), it may not be used (only root may), or the port is taken.
    explicit UsbPlug(const std::filesystem::path& controller) {
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

    // Pulls it: for the host the device is gone.
    ~UsbPlug() { close(socket_); }

    UsbPlug(const UsbPlug&) = delete;
    UsbPlug& operator=(const UsbPlug&) = delete;

    // Readable when there is a message.
    int descriptor() const { return socket_; }

    // Waits for it; nothing once the host has let go of the device, or speaks another protocol.
    std::optional<UsbMessage> receive() {
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

    // Answers. `data` must not be longer than was asked for.
    void send(const UsbTransfer& transfer, std::span<const std::uint8_t> data) {
        answer(submit_answer, transfer.id, 0, data.size(), data);
    }

    void accept(const UsbTransfer& transfer) {
        answer(submit_answer, transfer.id, 0, transfer.data.size(), {});
    }

    void stall(const UsbTransfer& transfer) { answer(submit_answer, transfer.id, -EPIPE, 0, {}); }

    // Whether the transfer's answer was still to come (it must not be sent any more).
    void confirm(const UsbCancellation& cancellation, bool was_waiting) {
        answer(unlink_answer, cancellation.id, was_waiting ? -ECONNRESET : 0, 0, {});
    }

private:
    bool read_all(void* data, std::size_t size) {
        return size == 0 || recv(socket_, data, size, MSG_WAITALL) == static_cast<ssize_t>(size);
    }

    // A host that has let go is noticed by the next receive().
    void answer(std::uint32_t command, std::uint32_t id, int status, std::size_t length,
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

    int socket_ = -1;
};

// ---- the camera ----

// Of the header in front of each frame (UVC 1.1, 2.4.3.3).
constexpr std::uint8_t end_of_header = 0x80, end_of_frame = 0x02, frame_parity = 0x01;

// From a frame's last byte to the next exposure.
constexpr std::chrono::milliseconds blanking(2);
// A sensor is read out when its exposure ends. Where this machine is too busy to be in time, the
// frame is lost, as if there had been none: clients rely on what the moment of arrival tells them.
constexpr std::chrono::milliseconds latest_start(4);

timespec as_timespec(Duration duration) {
    const auto whole = std::chrono::duration_cast<std::chrono::seconds>(duration);
    return {whole.count(), std::chrono::nanoseconds(duration - whole).count()};
}

}  // namespace

// The states of the sensor: resting until the next exposure is due; exposing; sending the frame.
struct UsbCamera::Session {
    Session(UsbCamera& owner, const std::filesystem::path& controller)
        : camera(owner), plug(controller), device(owner.options_) {}

    UsbCamera& camera;
    UsbPlug plug;
    UsbVideoDevice device;
    SteadyClock clock;

    std::deque<UsbTransfer> readers;  // the host's transfers that wait for pieces of a frame
    Instant next_exposure{};
    Instant exposed{};                // when the frame in work is
    Instant interval_end{};           // of the frame in work
    std::vector<std::uint8_t> frame;  // in work, behind its header; empty: none
    std::size_t sent = 0;
    bool parity = false;

    // When something is to be done, if the host does not ask for anything before.
    std::optional<Instant> due() const {
        if (!device.stream() || readers.empty() || camera.frozen_)
            return std::nullopt;
        return frame.empty() ? next_exposure : exposed;
    }

    void handle(const UsbMessage& message) {
        if (const auto* cancellation = std::get_if<UsbCancellation>(&message))
            cancel(*cancellation);
        else if (const auto& transfer = std::get<UsbTransfer>(message); transfer.endpoint != 0)
            readers.push_back(transfer);
        else
            control(transfer);
    }

    void cancel(const UsbCancellation& cancellation) {
        const auto waiting = std::find_if(readers.begin(), readers.end(), [&](const auto& reader) {
            return reader.id == cancellation.transfer;
        });
        plug.confirm(cancellation, waiting != readers.end());
        if (waiting != readers.end())
            readers.erase(waiting);
    }

    void control(const UsbTransfer& transfer) {
        const int streams_before = device.streams_begun();
        if (transfer.to_host) {
            const auto answer = device.read(transfer.setup);
            answer ? plug.send(transfer, *answer) : plug.stall(transfer);
        } else {
            device.write(transfer.setup, transfer.data) ? plug.accept(transfer)
                                                        : plug.stall(transfer);
        }
        if (!device.stream() || device.streams_begun() != streams_before)
            frame.clear();  // of a stream that has ended
    }

    void work() {
        const Instant now = clock.now();
        if (const auto when = due(); !when || *when > now)
            return;
        if (frame.empty())
            expose(now);
        else if (sent == 0 && now > exposed + latest_start)
            frame.clear();
        else
            send_piece();
    }

    void expose(Instant now) {
        const UsbVideoControls& controls = device.controls();
        const UsbExposure exposure{.mode = *device.stream(),
                                   .frame = camera.frames_++,
                                   .start = now,
                                   .time = controls.exposure(),
                                   .gain_db = controls.gain_db(),
                                   .sharpness = controls.sharpness(),
                                   .automatic = controls.automatic_exposure()};
        const std::vector<std::uint8_t> pixels = camera.source_(exposure);
        frame = {2, static_cast<std::uint8_t>(end_of_header | end_of_frame |
                                              (parity ? frame_parity : 0))};
        frame.insert(frame.end(), pixels.begin(), pixels.end());
        parity = !parity;
        sent = 0;
        exposed = std::max(now + exposure.time, clock.now());
        interval_end = now + Duration(std::chrono::seconds(1)) / camera.options_.frames_per_second;
    }

    void send_piece() {
        if (sent == 0 && camera.truncate_next_.exchange(false))
            frame.resize(frame.size() / 2);
        const UsbTransfer& reader = readers.front();
        const std::size_t size = std::min(reader.length, frame.size() - sent);
        plug.send(reader, std::span(frame).subspan(sent, size));
        sent += size;
        // A piece that fills the host's buffer does not end the frame for it; one of 0 bytes does.
        if (sent == frame.size() && size < reader.length) {
            frame.clear();
            next_exposure = std::max(interval_end, clock.now() + blanking);
        }
        readers.pop_front();
    }
};

UsbCamera::UsbCamera(UsbCameraOptions options, Source source, std::filesystem::path controller)
    : options_(std::move(options)),
      source_(std::move(source)),
      controller_(std::move(controller)),
      wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    try {
        plug();
    } catch (const Error&) {
        close(wake_);
        throw;
    }
}

UsbCamera::~UsbCamera() {
    unplug();
    close(wake_);
}

void UsbCamera::plug() {
    unplug();
    pulled_ = false;
    session_ = std::make_unique<Session>(*this, controller_);
    thread_ = std::thread([this] { serve(*session_); });
}

void UsbCamera::unplug() {
    if (!thread_.joinable())
        return;
    pulled_ = true;
    wake();
    thread_.join();
    DeviceEvents events(DeviceEvents::From::kernel);
    const bool was_known = session_->device.configured();
    session_.reset();  // pulls the plug
    while (was_known && events.next("remove", "usb")["DEVTYPE"] != "usb_device") {
    }
}

void UsbCamera::truncate_next_frame() {
    truncate_next_ = true;
}

void UsbCamera::freeze(bool frozen) {
    frozen_ = frozen;
    wake();
}

void UsbCamera::wake() {
    (void)eventfd_write(wake_, 1);
}

void UsbCamera::serve(Session& session) {
    while (!pulled_) {
        const auto due = session.due();
        const timespec left = as_timespec(
            due ? std::max(*due - session.clock.now(), Duration::zero()) : Duration::zero());
        std::array<pollfd, 2> wanted{pollfd{session.plug.descriptor(), POLLIN, 0},
                                     pollfd{wake_, POLLIN, 0}};
        ppoll(wanted.data(), wanted.size(), due ? &left : nullptr, nullptr);
        eventfd_t count = 0;
        (void)eventfd_read(wake_, &count);
        if (wanted[0].revents != 0) {
            const auto message = session.plug.receive();
            if (!message)
                return;
            session.handle(*message);
        }
        session.work();
    }
}

}  // namespace etalon
