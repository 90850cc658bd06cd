// A running stream of one video node: its buffers, shared with the driver, and what the driver says
// of each. Frames are judged elsewhere (v4l2_camera.cpp).
//
// Source: the kernel's "Streaming I/O (Memory Mapping)" and "Buffers".
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "capture/v4l2/v4l2_device.h"

namespace etalon {

// What a driver's time stamp means.
enum class StampMeaning {
    nothing,         // of an unknown clock, or copied from elsewhere
    exposure_start,  // of the monotonic clock
    frame_end,       // of the monotonic clock, when the frame had arrived
};

// A buffer that the driver has done with, until it is given back.
struct FilledBuffer {
    unsigned index = 0;
    std::span<const std::uint8_t> data;  // the luma's or the only plane
    std::string fault;                 // the driver's flag, or an impossible answer; usually empty
    std::uint32_t sequence = 0;        // wraps
    std::chrono::nanoseconds stamp{};  // as given
    StampMeaning meaning = StampMeaning::nothing;
};

class V4l2Stream {
public:
    // Allocates, maps and queues the buffers and starts. Throws DeviceError when the driver
    // refuses. The device has its format set and outlives the stream.
    explicit V4l2Stream(V4l2Device& device);
    ~V4l2Stream();  // within 1.2 s even if the driver hangs; the device counts as lost then
    V4l2Stream(const V4l2Stream&) = delete;
    V4l2Stream& operator=(const V4l2Stream&) = delete;

    // The next filled buffer; nothing when there is none yet. Throws DeviceError when the device
    // is gone or has ended the stream.
    std::optional<FilledBuffer> take();
    void give_back(const FilledBuffer& buffer);

    // Returns whether there is one, at the latest after the time-out. Throws as take().
    bool wait(std::chrono::milliseconds timeout);

private:
    struct Mapping {
        void* memory;
        std::size_t length;
    };

    void allocate();
    void map(unsigned index);
    void stop() noexcept;

    V4l2Device& device_;
    std::vector<Mapping> mappings_;
    unsigned planes_ = 1;
};

}  // namespace etalon
