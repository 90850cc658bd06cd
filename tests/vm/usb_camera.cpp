#include "tests/vm/usb_camera.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <span>

#include "core/program/errors.h"
#include "tests/vm/device_events.h"

namespace etalon {
namespace {

// Of the header in front of each frame (UVC 1.1, 2.4.3.3).
constexpr std::uint8_t end_of_header = 0x80, end_of_frame = 0x02, frame_parity = 0x01;

// From a frame's last byte to the next exposure.
constexpr std::chrono::milliseconds blanking(2);
// A sensor is read out when its exposure ends. Where this machine is too busy to be in time, the
// frame is lost, as if there had been none: clients rely on what the moment of arrival tells them.
constexpr std::chrono::milliseconds latest_start(4);

std::optional<timespec> as_timespec(std::optional<Duration> duration) {
    if (!duration)
        return std::nullopt;
    const auto whole = std::chrono::duration_cast<std::chrono::seconds>(*duration);
    return timespec{whole.count(), std::chrono::nanoseconds(*duration - whole).count()};
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
        UsbExposure exposure{.mode = *device.stream(), .frame = camera.frames_++, .start = now};
        exposure.time = controls.exposure();
        exposure.gain_db = controls.gain_db();
        exposure.sharpness = controls.sharpness();
        exposure.automatic = controls.automatic_exposure();
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
        const Duration left =
            due ? std::max(*due - session.clock.now(), Duration::zero()) : Duration::zero();
        const auto patience = as_timespec(due ? std::optional(left) : std::nullopt);
        std::array<pollfd, 2> wanted{pollfd{session.plug.descriptor(), POLLIN, 0},
                                     pollfd{wake_, POLLIN, 0}};
        ppoll(wanted.data(), wanted.size(), patience ? &*patience : nullptr, nullptr);
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
