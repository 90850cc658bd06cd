// A video device at the seam of the V4L2 backend's system calls: answers ioctls as a driver does,
// on a virtual clock, with frames and faults as a test scripts them. It streams freely: frame k
// begins its exposure at k periods after the start, and is lost when no buffer is queued for it.
// For one thread, besides those that the backend ends streams with.
#pragma once

#include <linux/videodev2.h>
#include <poll.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <deque>

#include "capture/v4l2/v4l2_device.h"
#include "tests/test.h"

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

inline std::vector<FakeControl> uvc_controls() {
    const std::uint32_t number = V4L2_CTRL_TYPE_INTEGER, flag = V4L2_CTRL_TYPE_BOOLEAN,
                        menu = V4L2_CTRL_TYPE_MENU;
    const std::map<int, std::string> lamps{{0, "Disabled"}, {1, "50 Hz"}, {2, "60 Hz"}},
        exposures{{1, "Manual Mode"}, {3, "Aperture Priority Mode"}};
    return {{V4L2_CID_BRIGHTNESS, number, "Brightness", -64, 64, 1, 0, {}, 5},
            {V4L2_CID_CONTRAST, number, "Contrast", 0, 64, 1, 32, {}},
            {V4L2_CID_AUTO_WHITE_BALANCE, flag, "White Balance, Automatic", 0, 1, 1, 1, {}},
            {V4L2_CID_GAMMA, number, "Gamma", 72, 500, 1, 100, {}},
            {V4L2_CID_GAIN, number, "Gain", 3, 100, 1, 20, {}},
            {V4L2_CID_POWER_LINE_FREQUENCY, menu, "Power Line Frequency", 0, 2, 1, 1, lamps},
            {V4L2_CID_SHARPNESS, number, "Sharpness", 0, 6, 1, 3, {}},
            {V4L2_CID_EXPOSURE_AUTO, menu, "Auto Exposure", 0, 3, 1, 3, exposures},
            {V4L2_CID_EXPOSURE_ABSOLUTE, number, "Exposure Time, Absolute", 3, 2047, 1, 250, {}}};
}

inline std::uint32_t fourcc(const std::string& name) {
    std::uint32_t code = 0;
    std::memcpy(&code, name.data(), 4);
    return code;
}

template <std::size_t size, typename Character>
inline void put_text(Character (&field)[size], const std::string& text) {
    static_assert(sizeof(Character) == 1);
    std::memcpy(field, text.data(), std::min(size, text.size()));
}

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
    explicit FakeV4l2(VirtualClock& clock)
        : controls(uvc_controls()), clock_(clock), defaults_(controls) {
        picture = [this](Instant) { return std::vector<std::uint8_t>(image_size(), 77); };
    }

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
    void unplug() {
        dead_files_.insert(dead_files_.end(), files_.begin(), files_.end());
        stop();
        plugged_ = false;
    }
    void plug_in(const std::string& as_node) {
        plugged_ = true;
        memory_.clear();
        node = as_node;
        controls = defaults_;
        width = 640;
        height = 480;
        format = "YUYV";
        period = unset_period_.value_or(period);
        unset_period_.reset();
    }

    // ---- what was done
    int open_files() const { return static_cast<int>(files_.size()); }
    std::atomic<int> mapped{0};
    int width = 640, height = 480;
    std::string format = "YUYV";
    FakeControl& control(const std::string& name) {
        return *std::ranges::find(controls, name, &FakeControl::name);
    }

    // V4l2System
    std::vector<std::string> nodes() override {
        return plugged_ ? std::vector<std::string>{node} : std::vector<std::string>{};
    }
    std::string serial_number(const std::string&) override { return serial; }
    int open(const std::string& path) override {
        if (!plugged_ || path != node)
            return -ENOENT;
        if (open_error)
            return -open_error;
        files_.push_back(next_file_);
        return next_file_++;
    }
    int close(int file) override { return std::erase(files_, file) == 0 ? -EBADF : 0; }
    int ioctl(int file, unsigned long request, void* argument) override {
        if (on_ioctl)
            on_ioctl(request);
        if (std::count(dead_files_.begin(), dead_files_.end(), file))
            return -ENODEV;
        if (!std::count(files_.begin(), files_.end(), file))
            return -EBADF;
        if (errors.count(request))
            return -errors[request];
        return -answer(request, argument);
    }
    void* map(int, std::size_t length, off_t offset) override {
        const std::size_t index = static_cast<std::size_t>(offset) / 4096;
        if (refuses_to_map || index >= memory_.size() || length > memory_[index].size())
            return nullptr;
        ++mapped;
        return memory_[index].data();
    }
    void unmap(void*, std::size_t) override { --mapped; }
    int poll(int file, std::chrono::milliseconds timeout) override {
        if (std::count(dead_files_.begin(), dead_files_.end(), file))
            return POLLERR | POLLHUP;
        const Instant until = clock_.now() + timeout;
        deliver_until(clock_.now());
        while (filled_.empty() && streaming_ && next_frame().done <= until) {
            clock_.wait_until(next_frame().done, {});
            deliver_until(clock_.now());
        }
        if (!filled_.empty() || !dequeue_errors.empty())
            return POLLIN;
        clock_.wait_until(until, {});
        return 0;
    }

private:
    struct Filled {
        unsigned buffer;
        FakeV4l2Frame frame;
    };

    // 0 or the error number.
    int answer(unsigned long request, void* argument) {
        static const std::map<unsigned long, int (FakeV4l2::*)(void*)> answers{
            {VIDIOC_QUERYCAP, &FakeV4l2::query_capability},
            {VIDIOC_ENUM_FMT, &FakeV4l2::enumerate_format},
            {VIDIOC_ENUM_FRAMESIZES, &FakeV4l2::enumerate_size},
            {VIDIOC_G_FMT, &FakeV4l2::get_format},
            {VIDIOC_S_FMT, &FakeV4l2::set_format},
            {VIDIOC_G_PARM, &FakeV4l2::get_rate},
            {VIDIOC_S_PARM, &FakeV4l2::set_rate},
            {VIDIOC_ENUM_FRAMEINTERVALS, &FakeV4l2::enumerate_rate},
            {VIDIOC_QUERY_EXT_CTRL, &FakeV4l2::query_control},
            {VIDIOC_QUERYMENU, &FakeV4l2::query_menu},
            {VIDIOC_REQBUFS, &FakeV4l2::request_buffers},
            {VIDIOC_QUERYBUF, &FakeV4l2::query_buffer},
            {VIDIOC_QBUF, &FakeV4l2::queue_buffer},
            {VIDIOC_DQBUF, &FakeV4l2::dequeue_buffer},
            {VIDIOC_STREAMON, &FakeV4l2::start},
            {VIDIOC_STREAMOFF, &FakeV4l2::stop}};
        if (request == VIDIOC_G_EXT_CTRLS || request == VIDIOC_S_EXT_CTRLS)
            return access_control(argument, request == VIDIOC_S_EXT_CTRLS);
        const auto found = answers.find(request);
        return found == answers.end() ? ENOTTY : (this->*found->second)(argument);
    }
    int query_capability(void* argument) {
        auto& answer = *static_cast<v4l2_capability*>(argument);
        put_text(answer.driver, driver);
        put_text(answer.card, card);
        put_text(answer.bus_info, bus);
        const std::uint32_t capture =
            multi_planar ? V4L2_CAP_VIDEO_CAPTURE_MPLANE : V4L2_CAP_VIDEO_CAPTURE;
        answer.device_caps = (captures ? capture : V4L2_CAP_META_CAPTURE) |
                             (streams ? V4L2_CAP_STREAMING : V4L2_CAP_READWRITE);
        // The whole device captures, whatever this node does.
        answer.capabilities = capture | V4L2_CAP_STREAMING | V4L2_CAP_DEVICE_CAPS;
        return 0;
    }
    int enumerate_format(void* argument) {
        auto& answer = *static_cast<v4l2_fmtdesc*>(argument);
        if (answer.index >= formats.size())
            return EINVAL;
        answer.pixelformat = fourcc(formats[answer.index]);
        put_text(answer.description, "format " + formats[answer.index]);
        return 0;
    }
    int enumerate_size(void* argument) {
        auto& answer = *static_cast<v4l2_frmsizeenum*>(argument);
        if (answer.index > 1)
            return EINVAL;
        answer.type = V4L2_FRMSIZE_TYPE_DISCRETE;
        answer.discrete.width = answer.index == 0 ? 640 : 17;
        answer.discrete.height = answer.index == 0 ? 480 : 11;
        return 0;
    }
    std::size_t bytes_per_line() const {
        return line_bytes(*find_v4l2_format(format.substr(0, format.find(' '))), width) + padding;
    }
    std::size_t image_size() const {
        const bool compressed = format == "MJPG";
        return compressed ? 100000 : bytes_per_line() * static_cast<std::size_t>(height);
    }
    int get_format(void* argument) {
        auto& answer = *static_cast<v4l2_format*>(argument);
        const auto fill = [&](auto& pixels) {
            pixels.width = static_cast<std::uint32_t>(width);
            pixels.height = static_cast<std::uint32_t>(height);
            pixels.pixelformat = fourcc(format);
            pixels.field = interlaced ? V4L2_FIELD_INTERLACED : V4L2_FIELD_NONE;
        };
        if (multi_planar) {
            fill(answer.fmt.pix_mp);
            answer.fmt.pix_mp.num_planes = 1;
            answer.fmt.pix_mp.plane_fmt[0].bytesperline =
                static_cast<std::uint32_t>(bytes_per_line());
        } else {
            fill(answer.fmt.pix);
            answer.fmt.pix.bytesperline = static_cast<std::uint32_t>(bytes_per_line());
            answer.fmt.pix.sizeimage = static_cast<std::uint32_t>(image_size());
        }
        return 0;
    }
    int set_format(void* argument) {
        if (!memory_.empty())
            return EBUSY;
        const auto& wanted = *static_cast<const v4l2_format*>(argument);
        const auto take = [&](const auto& pixels) {
            width = std::min(static_cast<int>(pixels.width), width_limit);
            height = static_cast<int>(pixels.height);
            const std::uint32_t code = pixels.pixelformat;
            const auto known = std::ranges::find(formats, code, fourcc);
            format = known == formats.end() ? formats.front() : *known;
        };
        if (multi_planar)
            take(wanted.fmt.pix_mp);
        else
            take(wanted.fmt.pix);
        return get_format(argument);
    }
    int get_rate(void* argument) {
        if (!says_period)
            return ENOTTY;
        auto& capture = static_cast<v4l2_streamparm*>(argument)->parm.capture;
        capture.capability = sets_period ? V4L2_CAP_TIMEPERFRAME : 0;
        capture.timeperframe = {static_cast<std::uint32_t>(period / 1us), 1000000};
        return 0;
    }
    int set_rate(void* argument) {
        const auto& wanted = static_cast<v4l2_streamparm*>(argument)->parm.capture.timeperframe;
        const double hz = double(wanted.denominator) / wanted.numerator;
        const int nearest = *std::ranges::min_element(
            frame_rates, {}, [=](int rate) { return std::abs(rate - hz); });
        unset_period_ = unset_period_.value_or(period);
        period = Duration(1s) / nearest;
        return get_rate(argument);
    }
    int enumerate_rate(void* argument) {
        auto& answer = *static_cast<v4l2_frmivalenum*>(argument);
        if (answer.index >= frame_rates.size() || answer.pixel_format != fourcc(format) ||
            answer.width != static_cast<std::uint32_t>(width))
            return EINVAL;
        answer.type = V4L2_FRMIVAL_TYPE_DISCRETE;
        answer.discrete = {1, static_cast<std::uint32_t>(frame_rates[answer.index])};
        return 0;
    }
    int query_control(void* argument) {
        auto& answer = *static_cast<v4l2_query_ext_ctrl*>(argument);
        const bool next = answer.id & V4L2_CTRL_FLAG_NEXT_CTRL;
        const std::uint32_t id = answer.id & ~std::uint32_t{V4L2_CTRL_FLAG_NEXT_CTRL};
        const FakeControl* found = nullptr;
        for (const FakeControl& control : controls)
            if ((next ? control.id > id : control.id == id) && (!found || control.id < found->id))
                found = &control;
        if (!found)
            return EINVAL;
        answer = {};
        answer.id = found->id;
        answer.type = found->type;
        put_text(answer.name, found->name);
        answer.minimum = found->low;
        answer.maximum = found->high;
        answer.step = static_cast<std::uint64_t>(found->step);
        answer.default_value = found->normal;
        return 0;
    }
    int query_menu(void* argument) {
        auto& item = *static_cast<v4l2_querymenu*>(argument);
        for (const FakeControl& control : controls)
            if (control.id == item.id && control.menu.count(static_cast<int>(item.index))) {
                const std::string name = control.menu.at(static_cast<int>(item.index));
                std::memcpy(item.name, name.c_str(), name.size() + 1);
                return 0;
            }
        return EINVAL;
    }
    int access_control(void* argument, bool set) {
        v4l2_ext_control& asked = static_cast<v4l2_ext_controls*>(argument)->controls[0];
        const std::uint32_t id = asked.id;
        const auto found = std::ranges::find(controls, id, &FakeControl::id);
        if (found == controls.end())
            return EINVAL;
        const std::uint32_t exposure_auto = V4L2_CID_EXPOSURE_AUTO;
        const auto automatic = std::ranges::find(controls, exposure_auto, &FakeControl::id);
        if (set && id == V4L2_CID_EXPOSURE_ABSOLUTE && automatic != controls.end() &&
            automatic->value != V4L2_EXPOSURE_MANUAL)
            return EACCES;
        if (set && !found->stuck)
            found->value = std::min<std::int64_t>(asked.value, found->most.value_or(found->high));
        asked.value = static_cast<std::int32_t>(found->value);
        return 0;
    }
    int request_buffers(void* argument) {
        auto& request = *static_cast<v4l2_requestbuffers*>(argument);
        if (streaming_)
            return EBUSY;
        request.count = std::min(request.count, most_buffers);
        memory_.assign(request.count, std::vector<std::uint8_t>(image_size()));
        queued_.clear();
        filled_.clear();
        return 0;
    }
    int query_buffer(void* argument) {
        auto& buffer = *static_cast<v4l2_buffer*>(argument);
        if (buffer.index >= memory_.size())
            return EINVAL;
        const auto length = static_cast<std::uint32_t>(memory_[buffer.index].size());
        if (multi_planar) {
            buffer.length = 1;
            buffer.m.planes[0].length = length;
            buffer.m.planes[0].m.mem_offset = buffer.index * 4096;
        } else {
            buffer.length = length;
            buffer.m.offset = buffer.index * 4096;
        }
        return 0;
    }
    int queue_buffer(void* argument) {
        const auto& buffer = *static_cast<const v4l2_buffer*>(argument);
        if (buffer.index >= memory_.size() ||
            std::count(queued_.begin(), queued_.end(), buffer.index))
            return EINVAL;
        deliver_until(clock_.now());
        queued_.push_back(buffer.index);
        return 0;
    }
    int dequeue_buffer(void* argument) {
        if (!dequeue_errors.empty()) {
            const int error = dequeue_errors.front();
            dequeue_errors.pop_front();
            return error;
        }
        deliver_until(clock_.now());
        if (filled_.empty())
            return EAGAIN;
        const Filled filled = filled_.front();
        filled_.pop_front();
        auto& buffer = *static_cast<v4l2_buffer*>(argument);
        buffer.index = filled.buffer;
        buffer.sequence = filled.frame.sequence;
        buffer.flags = filled.frame.error_flag ? V4L2_BUF_FLAG_ERROR : 0;
        if (stamps != Stamps::unknown)
            buffer.flags |= V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
        if (stamps == Stamps::exposure_start)
            buffer.flags |= V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
        const auto stamp = filled.frame.stamp.time_since_epoch() / 1us;
        buffer.timestamp = {stamp / 1000000, stamp % 1000000};
        const auto used = static_cast<std::uint32_t>(filled.frame.bytes_used);
        (multi_planar ? buffer.m.planes[0].bytesused : buffer.bytesused) = used;
        return 0;
    }
    int start(void* = nullptr) {
        streaming_ = true;
        started_ = clock_.now();
        made_ = 0;
        return 0;
    }
    int stop(void* = nullptr) {
        streaming_ = false;
        queued_.clear();
        filled_.clear();
        return 0;
    }
    Duration exposure_now() const {
        for (const FakeControl& control : controls)
            if (control.id == V4L2_CID_EXPOSURE_ABSOLUTE)
                return control.value * 100us;
        return exposure;
    }
    FakeV4l2Frame next_frame() const {
        FakeV4l2Frame frame;
        frame.sequence = made_;
        frame.exposure_start = started_ + made_ * std::max(period, exposure_now());
        frame.done = frame.exposure_start + exposure_now() + readout;
        frame.stamp = stamps == Stamps::exposure_start ? frame.exposure_start : frame.done;
        frame.bytes_used = image_size();
        if (spoil)
            spoil(frame);
        return frame;
    }
    void deliver_until(Instant now) {
        while (streaming_) {
            const FakeV4l2Frame frame = next_frame();
            if (frame.done > now)
                return;
            ++made_;
            if (queued_.empty())
                continue;
            const unsigned buffer = queued_.front();
            queued_.pop_front();
            const std::vector<std::uint8_t> bytes = picture(frame.exposure_start);
            std::copy_n(bytes.begin(), std::min(bytes.size(), memory_[buffer].size()),
                        memory_[buffer].begin());
            filled_.push_back({buffer, frame});
        }
    }

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
