#include "tests/vm/raw_video_reader.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/videodev2.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr int patience_ms = 5000;

int open_device(const std::string& device) {
    const int file = open(device.c_str(), O_RDWR | O_CLOEXEC);
    if (file < 0)
        throw DeviceError(device, "open", std::strerror(errno));
    return file;
}

void ask_device(const std::string& device, int file, const char* name, unsigned long request,
                void* argument) {
    if (ioctl(file, request, argument) != 0)
        throw DeviceError(device, name, std::strerror(errno));
}

v4l2_buffer capture_buffer() {
    v4l2_buffer buffer{};
    buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    buffer.memory = V4L2_MEMORY_MMAP;
    return buffer;
}

std::uint32_t code_of(const std::string& format) {
    return v4l2_fourcc(format.at(0), format.at(1), format.at(2), format.at(3));
}

}  // namespace

RawVideoReader::RawVideoReader(const std::string& device, const std::string& format, int width,
                               int height)
    : device_(device), file_(open_device(device)) {
    try {
        set_format(format, width, height);
        map_buffers();
        int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
        ask("start", VIDIOC_STREAMON, &type);
    } catch (const Error&) {
        close(file_);
        throw;
    }
}

RawVideoReader::~RawVideoReader() {
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    ioctl(file_, VIDIOC_STREAMOFF, &type);
    for (const Buffer& buffer : buffers_)
        munmap(buffer.data, buffer.size);
    close(file_);
}

void RawVideoReader::ask(const char* request_name, unsigned long request, void* argument) const {
    ask_device(device_, file_, request_name, request, argument);
}

void RawVideoReader::set_format(const std::string& format, int width, int height) {
    v4l2_format wanted{};
    wanted.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    wanted.fmt.pix.width = static_cast<std::uint32_t>(width);
    wanted.fmt.pix.height = static_cast<std::uint32_t>(height);
    wanted.fmt.pix.pixelformat = code_of(format);
    wanted.fmt.pix.field = V4L2_FIELD_NONE;
    v4l2_format got = wanted;
    ask("set format", VIDIOC_S_FMT, &got);
    if (got.fmt.pix.width != wanted.fmt.pix.width || got.fmt.pix.height != wanted.fmt.pix.height ||
        got.fmt.pix.pixelformat != wanted.fmt.pix.pixelformat)
        throw DeviceError(device_, fmt::format("set format {} {}x{}", format, width, height),
                          fmt::format("the driver gives {}x{}, format {:08x}", got.fmt.pix.width,
                                      got.fmt.pix.height, got.fmt.pix.pixelformat));
}

void RawVideoReader::map_buffers() {
    v4l2_requestbuffers request{};
    request.count = 4;
    request.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    request.memory = V4L2_MEMORY_MMAP;
    ask("request buffers", VIDIOC_REQBUFS, &request);
    for (std::uint32_t i = 0; i < request.count; ++i) {
        v4l2_buffer buffer = capture_buffer();
        buffer.index = i;
        ask("query buffer", VIDIOC_QUERYBUF, &buffer);
        void* data = mmap(nullptr, buffer.length, PROT_READ | PROT_WRITE, MAP_SHARED, file_,
                          buffer.m.offset);
        if (data == MAP_FAILED)
            throw DeviceError(device_, "map buffer", std::strerror(errno));
        buffers_.push_back({data, buffer.length});
        queue(i);
    }
}

void RawVideoReader::queue(std::uint32_t index) const {
    v4l2_buffer buffer = capture_buffer();
    buffer.index = index;
    ask("queue buffer", VIDIOC_QBUF, &buffer);
}

std::optional<RawVideoFrame> RawVideoReader::next() {
    pollfd wanted{file_, POLLIN, 0};
    if (poll(&wanted, 1, patience_ms) <= 0)
        return std::nullopt;
    v4l2_buffer buffer = capture_buffer();
    ask("dequeue buffer", VIDIOC_DQBUF, &buffer);
    const auto* data = static_cast<const std::uint8_t*>(buffers_.at(buffer.index).data);
    RawVideoFrame frame;
    frame.bytes.assign(data, data + buffer.bytesused);
    frame.sequence = buffer.sequence;
    frame.error = (buffer.flags & V4L2_BUF_FLAG_ERROR) != 0;
    if ((buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC)
        frame.time = Instant(std::chrono::seconds(buffer.timestamp.tv_sec) +
                             std::chrono::microseconds(buffer.timestamp.tv_usec));
    queue(buffer.index);
    return frame;
}

void set_raw_control(const std::string& device, std::uint32_t id, int value) {
    const int file = open_device(device);
    v4l2_control control{id, value};
    const bool done = ioctl(file, VIDIOC_S_CTRL, &control) == 0;
    const std::string cause = done ? "" : std::strerror(errno);
    close(file);
    if (!done)
        throw DeviceError(device, fmt::format("set control {:#x} to {}", id, value), cause);
}

int raw_control(const std::string& device, std::uint32_t id) {
    const int file = open_device(device);
    v4l2_control control{id, 0};
    const bool done = ioctl(file, VIDIOC_G_CTRL, &control) == 0;
    const std::string cause = done ? "" : std::strerror(errno);
    close(file);
    if (!done)
        throw DeviceError(device, fmt::format("read control {:#x}", id), cause);
    return control.value;
}

}  // namespace etalon
