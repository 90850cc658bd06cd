#include "tests/vm/usb_video_device.h"

#include <algorithm>

namespace etalon {
namespace {

// bmRequestType: direction, kind, recipient.
constexpr int to_host = 0x80, kind_mask = 0x60, standard = 0x00, of_class = 0x20;
constexpr int to_interface = 0x01, to_endpoint = 0x02, recipient_mask = 0x1F;
// Standard requests.
constexpr int get_status = 0, clear_feature = 1, set_feature = 3, get_descriptor = 6,
              set_configuration = 9, set_interface = 11;
// Class requests and the selectors of the stream's interface.
constexpr int set_current = 0x01, get_length = 0x85, get_info = 0x86;
constexpr int probe = 1, commit = 2;
constexpr std::size_t negotiation_bytes = 34;  // UVC 1.1

// A payload is one whole frame behind a header of 2 bytes.
constexpr std::uint32_t payload_header = 2;

std::size_t clamped_index(int index, std::size_t count) {
    return index >= 1 && static_cast<std::size_t>(index) <= count ? static_cast<std::size_t>(index)
                                                                  : 1;
}

}  // namespace

UsbVideoDevice::UsbVideoDevice(UsbCameraOptions options)
    : options_(std::move(options)), controls_(options_.sharpness) {}

StreamMode UsbVideoDevice::mode() const {
    return {options_.formats[format_index_ - 1], options_.sizes[size_index_ - 1]};
}

std::optional<StreamMode> UsbVideoDevice::stream() const {
    return streaming_ ? std::optional(mode()) : std::nullopt;
}

std::optional<std::vector<std::uint8_t>> UsbVideoDevice::read(const UsbSetup& setup) const {
    std::optional<std::vector<std::uint8_t>> answer;
    if ((setup.type & kind_mask) == standard)
        answer = read_standard(setup);
    else if (setup.type == (to_host | of_class | to_interface))
        answer = (setup.index & 0xFF) == stream_interface
                     ? read_negotiation(setup)
                     : controls_.get(setup.index >> 8, setup.value >> 8, setup.request);
    if (answer && answer->size() > static_cast<std::size_t>(setup.length))
        answer->resize(static_cast<std::size_t>(setup.length));
    return answer;
}

std::optional<std::vector<std::uint8_t>> UsbVideoDevice::read_standard(
    const UsbSetup& setup) const {
    if (setup.request == get_status)
        return std::vector<std::uint8_t>(2, 0);
    if (setup.request != get_descriptor)
        return std::nullopt;
    std::vector<std::uint8_t> descriptor;
    switch (setup.value >> 8) {
        case 1:
            descriptor = device_descriptor();
            break;
        case 2:
            descriptor = configuration_descriptor(options_);
            break;
        case 3:
            descriptor = string_descriptor(options_, setup.value & 0xFF);
            break;
        default:
            break;
    }
    return descriptor.empty() ? std::nullopt : std::optional(descriptor);
}

std::optional<std::vector<std::uint8_t>> UsbVideoDevice::read_negotiation(
    const UsbSetup& setup) const {
    const int selector = setup.value >> 8;
    if (selector != probe && selector != commit)
        return std::nullopt;
    std::vector<std::uint8_t> out;
    if (setup.request == get_length) {
        put(out, 2, negotiation_bytes);
        return out;
    }
    if (setup.request == get_info) {
        put(out, 1, 3);  // can be read and set
        return out;
    }
    const auto frame = static_cast<std::uint32_t>(mode().frame_bytes());
    put(out, 2, 0);
    put(out, 1, static_cast<std::uint32_t>(format_index_));
    put(out, 1, static_cast<std::uint32_t>(size_index_));
    put(out, 4, frame_interval(options_));
    out.resize(18, 0);
    put(out, 4, frame);
    put(out, 4, frame + payload_header);
    out.resize(negotiation_bytes, 0);
    return out;
}

bool UsbVideoDevice::write(const UsbSetup& setup, std::span<const std::uint8_t> data) {
    if ((setup.type & kind_mask) == standard) {
        // The host stops a bulk stream by clearing its endpoint.
        if (setup.request == clear_feature && (setup.type & recipient_mask) == to_endpoint)
            streaming_ = false;
        configured_ = configured_ || setup.request == set_configuration;
        return setup.request == clear_feature || setup.request == set_feature ||
               setup.request == set_configuration || setup.request == set_interface;
    }
    if (setup.type != (of_class | to_interface) || setup.request != set_current)
        return false;
    if ((setup.index & 0xFF) == stream_interface)
        return write_negotiation(setup.value >> 8, data);
    return controls_.set(setup.index >> 8, setup.value >> 8, data);
}

// A wish that cannot be fulfilled becomes one that can, which the host reads back.
bool UsbVideoDevice::write_negotiation(int selector, std::span<const std::uint8_t> data) {
    if ((selector != probe && selector != commit) || data.size() < 4)
        return false;
    format_index_ = clamped_index(data[2], options_.formats.size());
    size_index_ = clamped_index(data[3], options_.sizes.size());
    streaming_ = selector == commit;
    streams_begun_ += streaming_;
    return true;
}

}  // namespace etalon
