// How the USB camera answers its control endpoint: the standard requests (USB 2.0, 9.4), its
// controls, and the negotiation of a stream (UVC 1.1, 4.3.1.1). No sockets, no threads, no
// pictures.
#pragma once

#include <chrono>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace etalon {

// What a USB Video Class camera says about itself: one camera, one processing unit, one stream of
// uncompressed pictures over a bulk endpoint.
// Sources: USB 2.0, chapter 9; USB Device Class Definition for Video Devices 1.1, chapter 3.

enum class UsbPixels { grey, y12, y16, yuyv };

constexpr int bytes_per_pixel(UsbPixels pixels) {
    return pixels == UsbPixels::grey ? 1 : 2;
}

struct UsbCameraOptions {
    std::vector<UsbPixels> formats{UsbPixels::yuyv, UsbPixels::grey, UsbPixels::y16,
                                   UsbPixels::y12};
    std::vector<cv::Size> sizes{{640, 480}, {320, 200}};  // px, each format has all of them
    int frames_per_second = 30;
    std::string serial = "USB7";
    int sharpness = 3;  // after power-up, 0..7; 0 is neutral
};

// Entities of the camera's control interface, and where things are.
constexpr int control_interface = 0, stream_interface = 1;
constexpr int camera_terminal = 1, processing_unit = 2, output_terminal = 3;
constexpr int stream_endpoint = 1;  // to the host
constexpr const char* usb_camera_vendor = "Etalon";
constexpr const char* usb_camera_model = "Test camera";

std::vector<std::uint8_t> configuration_descriptor(const UsbCameraOptions& options);

// The adjustable values of the USB camera (UVC 1.1, 4.2): exposure, gain, and what a measuring
// client has to switch off. They start as a consumer's camera has them: everything automatic and
// sharpened. Whoever wants to set the exposure has to end the automatic first, as with real ones.
class UsbVideoControls {
public:
    explicit UsbVideoControls(int sharpness);

    // The answer to GET_xxx `request` of the selector of an entity; nothing: unknown, refused.
    std::optional<std::vector<std::uint8_t>> get(int entity, int selector, int request) const;

    // SET_CUR; false: unknown, out of range or refused.
    bool set(int entity, int selector, std::span<const std::uint8_t> value);

    std::chrono::microseconds exposure() const;
    bool automatic_exposure() const;
    double gain_db() const;
    int sharpness() const;  // 0 is neutral

private:
    std::vector<std::int32_t> values_;  // in the order of the table
};

// The entity's bits of supported controls, as its descriptor has them.
std::uint32_t control_bits(int entity);

// The first 8 bytes of a control transfer (USB 2.0, 9.3).
struct UsbSetup {
    int type = 0, request = 0;
    int value = 0, index = 0, length = 0;
};

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
