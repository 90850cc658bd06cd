// How the USB camera answers its control endpoint: the standard requests (USB 2.0, 9.4), its
// controls, and the negotiation of a stream (UVC 1.1, 4.3.1.1). No sockets, no threads, no
// pictures.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "tests/vm/usb_ip.h"
#include "tests/vm/usb_video_controls.h"
#include "tests/vm/usb_video_descriptors.h"

namespace etalon {

struct StreamMode {
    UsbPixels pixels = UsbPixels::grey;
    cv::Size size;

    std::size_t frame_bytes() const {
        return static_cast<std::size_t>(size.area() * bytes_per_pixel(pixels));
    }
};

class UsbVideoDevice {
public:
    explicit UsbVideoDevice(UsbCameraOptions options);

    // The answer to a request to the device or to the host; nothing: refused.
    std::optional<std::vector<std::uint8_t>> read(const UsbSetup& setup) const;
    // Whether a request from the host was carried out.
    bool write(const UsbSetup& setup, std::span<const std::uint8_t> data);

    const UsbVideoControls& controls() const { return controls_; }

    // Whether the host has accepted the device.
    bool configured() const { return configured_; }

    // The mode in which the host wants pictures now, if it does; and how many times it has begun.
    std::optional<StreamMode> stream() const;
    int streams_begun() const { return streams_begun_; }

private:
    std::optional<std::vector<std::uint8_t>> read_standard(const UsbSetup& setup) const;
    std::optional<std::vector<std::uint8_t>> read_negotiation(const UsbSetup& setup) const;
    bool write_negotiation(int selector, std::span<const std::uint8_t> data);
    StreamMode mode() const;

    UsbCameraOptions options_;
    UsbVideoControls controls_;
    std::size_t format_index_ = 1, size_index_ = 1;  // as negotiated, from 1
    bool configured_ = false;
    bool streaming_ = false;
    int streams_begun_ = 0;
};

}  // namespace etalon
