// A video device at the seam of the V4L2 backend's system calls: answers ioctls as a driver does,
// on a virtual clock, with frames and faults as a test scripts them. It streams freely: frame k
// begins its exposure at k periods after the start, and is lost when no buffer is queued for it.
// For one thread, besides those that the backend ends streams with.
#pragma once

#include <atomic>
#include <deque>
#include <functional>

#include "capture/v4l2/v4l2_device.h"

namespace etalon {

struct FakeControl {
    std::uint32_t id, type;  // V4L2_CID_..., V4L2_CTRL_TYPE_...
    std::string name;
    std::int64_t low, high, step, normal;
    std::map<int, std::string> menu;
    std::int64_t value = normal;
    bool stuck = false;                     // accepts every value and keeps its own
    std::optional<std::int64_t> most = {};  // accepts every value and clamps it to this
};

// A frame on its way, for a test to spoil.
struct FakeV4l2Frame {
    std::uint32_t sequence = 0;
    Instant exposure_start{};
    Instant stamp{};
    Instant done{};              // when the driver hands it out
    std::size_t bytes_used = 0;  // as the driver says
    bool error_flag = false;
};

class FakeV4l2 final : public V4l2System {
public:
    enum class Stamps { exposure_start, frame_end, unknown };

    // A UVC camera with the formats GREY, YUYV and Y16, 640x480 and 17x11 pixels. The clock
    // outlives it.
    explicit FakeV4l2(VirtualClock& clock);

    // ---- what the device is; change before it is opened
    std::string node = "/dev/video0";
    std::string driver = "uvcvideo", card = "Fake camera", bus = "usb-0000:00:14.0-3";
    std::string serial = "FAKE-7";
    bool multi_planar = false, streams = true, captures = true;
    std::vector<std::string> formats{"GREY", "YUYV", "Y16 "};
    std::vector<FakeControl> controls;
    Duration period = std::chrono::milliseconds(40);
    Duration readout = std::chrono::milliseconds(9);
    Duration exposure = std::chrono::milliseconds(7);  // where there is no control for it
    Stamps stamps = Stamps::frame_end;
    unsigned padding = 0;  // bytes behind each line
    bool says_period = true, sets_period = true;
    std::vector<int> frame_rates{25, 50};  // Hz; the nearest is taken

    // ---- what it does
    // The bytes of the frame whose exposure begins then, lines padded.
    std::function<std::vector<std::uint8_t>(Instant)> picture;
    // For every frame, and more than once: the same is to come of it.
    std::function<void(FakeV4l2Frame&)> spoil;
    std::deque<int> dequeue_errors;       // of the next attempts to take a frame
    std::map<unsigned long, int> errors;  // by ioctl, until taken out
    int open_error = 0;
    int width_limit = 10000;  // setting a larger image is "corrected" to this
    bool interlaced = false;
    unsigned most_buffers = 32;
    bool refuses_to_map = false;
    std::function<void(unsigned long)> on_ioctl;  // before each

    // Gone, as if pulled: every call on what is open fails. Comes back with its default settings.
    void unplug();
    void plug_in(const std::string& as_node);

    // ---- what was done
    int open_files() const { return static_cast<int>(files_.size()); }
    std::atomic<int> mapped{0};
    int width = 640, height = 480;
    std::string format = "YUYV";
    FakeControl& control(const std::string& name);

    // V4l2System
    std::vector<std::string> nodes() override;
    std::string serial_number(const std::string&) override { return serial; }
    int open(const std::string& path) override;
    int close(int file) override;
    int ioctl(int file, unsigned long request, void* argument) override;
    void* map(int file, std::size_t length, off_t offset) override;
    void unmap(void* memory, std::size_t length) override;
    int poll(int file, std::chrono::milliseconds timeout) override;

private:
    struct Filled {
        unsigned buffer;
        FakeV4l2Frame frame;
    };

    int answer(unsigned long request, void* argument);
    int query_capability(void* argument);
    int enumerate_format(void* argument);
    int enumerate_size(void* argument);
    int get_format(void* argument);
    int set_format(void* argument);
    int get_rate(void* argument);
    int set_rate(void* argument);
    int enumerate_rate(void* argument);
    int query_control(void* argument);
    int query_menu(void* argument);
    int access_control(void* argument, bool set);
    int request_buffers(void* argument);
    int query_buffer(void* argument);
    int queue_buffer(void* argument);
    int dequeue_buffer(void* argument);
    int start(void* = nullptr);
    int stop(void* = nullptr);

    std::size_t bytes_per_line() const;
    std::size_t image_size() const;
    Duration exposure_now() const;
    FakeV4l2Frame next_frame() const;
    void deliver_until(Instant now);

    VirtualClock& clock_;
    std::vector<int> files_, dead_files_;
    int next_file_ = 3;
    bool plugged_ = true, streaming_ = false;
    std::vector<FakeControl> defaults_;
    std::optional<Duration> unset_period_;  // before one was set
    std::vector<std::vector<std::uint8_t>> memory_;
    std::deque<unsigned> queued_;
    std::deque<Filled> filled_;
    Instant started_{};
    std::uint32_t made_ = 0;  // frames of this stream
};

}  // namespace etalon
