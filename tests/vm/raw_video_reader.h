// A second, independent way to the frames of a /dev/video: the fewest ioctls that stream, and no
// judgement. Tests hold the product's backend against it.
// Source: Linux Media Infrastructure userspace API, Video for Linux.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/time/clock.h"

namespace etalon {

struct RawVideoFrame {
    std::vector<std::uint8_t> bytes;
    std::uint32_t sequence = 0;
    bool error = false;  // the driver's flag
    Instant time;        // the driver's, if it is of the machine's monotonic clock
};

class RawVideoReader {
public:
    // `format` is the four-character code ("GREY"). Starts the stream. Throws DeviceError with the
    // request that failed, and when the driver would give another format or size.
    RawVideoReader(const std::string& device, const std::string& format, int width, int height);
    ~RawVideoReader();
    RawVideoReader(const RawVideoReader&) = delete;
    RawVideoReader& operator=(const RawVideoReader&) = delete;

    // The next frame; nothing if none comes within 5 s. Throws DeviceError when the device is gone.
    std::optional<RawVideoFrame> next();

private:
    struct Buffer {
        void* data = nullptr;
        std::size_t size = 0;
    };

    void ask(const char* request_name, unsigned long request, void* argument) const;
    void set_format(const std::string& format, int width, int height);
    void map_buffers();
    void queue(std::uint32_t index) const;

    std::string device_;
    int file_ = -1;
    std::vector<Buffer> buffers_;
};

// Sets and reads back one control of a device by its V4L2 id.
void set_raw_control(const std::string& device, std::uint32_t id, int value);
int raw_control(const std::string& device, std::uint32_t id);

}  // namespace etalon
