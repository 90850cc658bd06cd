#include "capture/v4l2/v4l2_stream.h"

#include <fmt/format.h>
#include <linux/videodev2.h>
#include <poll.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <memory>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr unsigned wanted_buffers = 4;
constexpr std::int64_t latest_second = 5'000'000'000;  // of a stamp, 158 years from any epoch
constexpr unsigned min_buffers = 2;                    // one for the driver, one for us

// A v4l2_buffer that carries its planes where the device is multi-planar.
struct BufferRequest {
    v4l2_buffer buffer{};
    std::array<v4l2_plane, VIDEO_MAX_PLANES> planes{};

    BufferRequest(const V4l2Device& device, unsigned index, unsigned plane_count) {
        buffer.type = device.buffer_type();
        buffer.memory = V4L2_MEMORY_MMAP;
        buffer.index = index;
        if (device.multi_planar()) {
            buffer.m.planes = planes.data();
            buffer.length = plane_count;
        }
    }
    BufferRequest(const BufferRequest&) = delete;
    BufferRequest& operator=(const BufferRequest&) = delete;
};

StampMeaning meaning_of(std::uint32_t flags) {
    if ((flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) != V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC)
        return StampMeaning::nothing;
    switch (flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) {
        case V4L2_BUF_FLAG_TSTAMP_SRC_SOE:
            return StampMeaning::exposure_start;
        case V4L2_BUF_FLAG_TSTAMP_SRC_EOF:
            return StampMeaning::frame_end;
        default:
            return StampMeaning::nothing;
    }
}

}  // namespace

V4l2Stream::V4l2Stream(V4l2Device& device) : device_(device) {
    try {
        allocate();
        int type = static_cast<int>(device_.buffer_type());
        device_.require(VIDIOC_STREAMON, &type, "start the stream");
    } catch (const Error&) {
        stop();
        throw;
    }
}

V4l2Stream::~V4l2Stream() {
    stop();
}

void V4l2Stream::allocate() {
    v4l2_requestbuffers request{};
    request.count = wanted_buffers;
    request.type = device_.buffer_type();
    request.memory = V4L2_MEMORY_MMAP;
    device_.require(VIDIOC_REQBUFS, &request, "ask for buffers");
    if (request.count < min_buffers)
        device_.fail("ask for buffers", fmt::format("the driver gives {}, at least {} are needed",
                                                    request.count, min_buffers));
    for (unsigned i = 0; i < std::min(request.count, wanted_buffers); ++i) {
        map(i);
        give_back({.index = i});
    }
}

void V4l2Stream::map(unsigned index) {
    BufferRequest request(device_, index, VIDEO_MAX_PLANES);
    device_.require(VIDIOC_QUERYBUF, &request.buffer, "ask where a buffer is");
    std::size_t length = request.buffer.length;
    off_t offset = request.buffer.m.offset;
    if (device_.multi_planar()) {
        planes_ = std::clamp<unsigned>(request.buffer.length, 1, VIDEO_MAX_PLANES);
        length = request.planes[0].length;
        offset = request.planes[0].m.mem_offset;
    }
    void* memory = device_.system().map(device_.file(), length, offset);
    if (!memory)
        device_.fail("map a buffer", fmt::format("the kernel refuses {} bytes", length));
    mappings_.push_back({memory, length});
}

// In the background if the driver takes its time; the file may be another's by then, so only the
// memory is given back.
void V4l2Stream::stop() noexcept {
    const auto abandoned = std::make_shared<std::atomic<bool>>(false);
    const auto task = [abandoned, &system = device_.system(), file = device_.file(),
                       type = device_.buffer_type(), mappings = std::move(mappings_)] {
        int stopped_type = static_cast<int>(type);
        system.ioctl(file, VIDIOC_STREAMOFF, &stopped_type);
        for (const Mapping& mapping : mappings)
            system.unmap(mapping.memory, mapping.length);
        v4l2_requestbuffers none{};
        none.type = type;
        none.memory = V4L2_MEMORY_MMAP;
        if (!*abandoned)
            system.ioctl(file, VIDIOC_REQBUFS, &none);
    };
    if (!run_bounded(task)) {
        *abandoned = true;
        device_.set_lost();
    }
}

std::optional<FilledBuffer> V4l2Stream::take() {
    BufferRequest request(device_, 0, planes_);
    const v4l2_buffer& buffer = request.buffer;
    const int error = device_.ask(VIDIOC_DQBUF, &request.buffer);
    if (error == EAGAIN)
        return std::nullopt;
    if (error)
        device_.fail("take a frame", error);
    if (buffer.index >= mappings_.size())
        device_.fail("take a frame", fmt::format("the driver returns a buffer {} that it was not "
                                                 "given",
                                                 buffer.index));
    FilledBuffer filled;
    filled.index = buffer.index;
    filled.sequence = buffer.sequence;
    filled.meaning = meaning_of(buffer.flags);
    if (buffer.timestamp.tv_sec >= 0 && buffer.timestamp.tv_sec <= latest_second)
        filled.stamp = std::chrono::seconds(buffer.timestamp.tv_sec) +
                       std::chrono::microseconds(buffer.timestamp.tv_usec);
    else
        filled.fault = fmt::format("its time stamp is {} s", buffer.timestamp.tv_sec);
    const std::size_t used =
        device_.multi_planar() ? request.planes[0].bytesused : buffer.bytesused;
    const std::size_t skipped = device_.multi_planar() ? request.planes[0].data_offset : 0;
    const Mapping& mapping = mappings_[buffer.index];
    if (buffer.flags & V4L2_BUF_FLAG_ERROR)
        filled.fault = "the driver flags the frame as damaged";
    else if (used > mapping.length || skipped > used)
        filled.fault =
            fmt::format("{} bytes from {} on in a buffer of {}", used, skipped, mapping.length);
    else
        filled.data =
            std::span(static_cast<const std::uint8_t*>(mapping.memory), used).subspan(skipped);
    return filled;
}

void V4l2Stream::give_back(const FilledBuffer& buffer) {
    BufferRequest request(device_, buffer.index, planes_);
    device_.require(VIDIOC_QBUF, &request.buffer, "give a buffer to the driver");
}

bool V4l2Stream::wait(std::chrono::milliseconds timeout) {
    const int events = device_.system().poll(device_.file(), timeout);
    if (events < 0 && events != -EINTR && events != -EAGAIN)
        device_.fail("wait for a frame", -events);
    if (events > 0 && (events & (POLLERR | POLLHUP | POLLNVAL)) && !(events & POLLIN)) {
        device_.set_lost();
        device_.fail("wait for a frame", "the driver ended the stream: the device is gone");
    }
    return events > 0;
}

}  // namespace etalon
