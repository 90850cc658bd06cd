// What a USB Video Class camera says about itself: one camera, one processing unit, one stream of
// uncompressed pictures over a bulk endpoint.
// Sources: USB 2.0, chapter 9; USB Device Class Definition for Video Devices 1.1, chapter 3.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace etalon {

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

std::vector<std::uint8_t> device_descriptor();
std::vector<std::uint8_t> configuration_descriptor(const UsbCameraOptions& options);

// 0 is the list of languages; nothing for an index that no descriptor names.
std::vector<std::uint8_t> string_descriptor(const UsbCameraOptions& options, int index);

// Appends the lowest `bytes` bytes of a number, little-endian.
void put(std::vector<std::uint8_t>& out, int bytes, std::uint32_t value);

// The time from one frame to the next in the class' unit of 100 ns.
std::uint32_t frame_interval(const UsbCameraOptions& options);

}  // namespace etalon
