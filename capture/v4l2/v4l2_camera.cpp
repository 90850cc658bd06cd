#include "capture/v4l2/v4l2_camera.h"

#include <fmt/format.h>
#include <linux/videodev2.h>
#include <poll.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <limits>

#include "capture/frame/device_camera.h"
#include "capture/v4l2/v4l2_controls.h"
#include "capture/v4l2/v4l2_timing.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;
using std::chrono::duration_cast;
using std::chrono::milliseconds;

constexpr milliseconds look_around{10};  // a stop request is noticed within this
constexpr milliseconds look_again{100};  // for a device to come back

// The first node that is a camera and `matches`; empty if there is none.
template <class Matches>
std::string find_node(V4l2System& system, const Matches& matches) {
    for (const std::string& node : system.nodes()) {
        try {
            if (matches(V4l2Device(system, node, "camera v4l2:" + node).identity()))
                return node;
        } catch (const DeviceError&) {  // no camera, or not ours to open
        }
    }
    return "";
}

// What a bit depth is to be stored in: the same depth, else the codes of 16 bits that need not all
// be in use. A true monochrome format comes before the luma of a colour one.
const PixelFormat* monochrome_format(const std::vector<CameraFormat>& offered, int bits) {
    const auto rank = [=](const PixelFormat& format) {
        if (format.lossy() || format.mosaic != Mosaic::none)
            return 0;
        if (bits == 0 || format.bits == std::max(bits, 8))
            return format.luma_of_colours() ? 2 : 3;
        return bits > 8 && format.bits == 16 ? 1 : 0;
    };
    const PixelFormat* best = nullptr;
    for (const CameraFormat& format : offered) {
        const PixelFormat* candidate = find_v4l2_format(format.name);
        if (candidate && rank(*candidate) > (best ? rank(*best) : 0))
            best = candidate;
    }
    return best;
}

std::string names_of(const std::vector<CameraFormat>& formats) {
    std::string names;
    for (const CameraFormat& format : formats)
        if (format.bits > 0)
            names += (names.empty() ? "" : ", ") + format.name;
    return names.empty() ? "none that this program can unpack" : names;
}

// ---- a running stream ------------------------------------------------------------------------

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

// A running stream of one video node: its buffers, shared with the driver, and what the driver says
// of each. Source: the kernel's "Streaming I/O (Memory Mapping)" and "Buffers".
class V4l2Stream {
public:
    // Allocates, maps and queues the buffers and starts. Throws DeviceError when the driver
    // refuses. The device has its format set and outlives the stream.
    explicit V4l2Stream(V4l2Device& device) : device_(device) {
        try {
            allocate();
            int type = static_cast<int>(device_.buffer_type());
            device_.require(VIDIOC_STREAMON, &type, "start the stream");
        } catch (const Error&) {
            stop();
            throw;
        }
    }

    // Within 1.2 s even if the driver hangs; the device counts as lost then.
    ~V4l2Stream() { stop(); }

    V4l2Stream(const V4l2Stream&) = delete;
    V4l2Stream& operator=(const V4l2Stream&) = delete;

    // The next filled buffer; nothing when there is none yet. Throws DeviceError when the device
    // is gone or has ended the stream.
    std::optional<FilledBuffer> take() {
        BufferRequest request(device_, 0, planes_);
        const v4l2_buffer& buffer = request.buffer;
        const int error = device_.ask(VIDIOC_DQBUF, &request.buffer);
        if (error == EAGAIN)
            return std::nullopt;
        if (error)
            device_.fail("take a frame", error);
        if (buffer.index >= mappings_.size())
            device_.fail("take a frame",
                         fmt::format("the driver returns a buffer {} that it was not "
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

    void give_back(const FilledBuffer& buffer) {
        BufferRequest request(device_, buffer.index, planes_);
        device_.require(VIDIOC_QBUF, &request.buffer, "give a buffer to the driver");
    }

    // Returns whether there is one, at the latest after the time-out. Throws as take().
    bool wait(std::chrono::milliseconds timeout) {
        const int events = device_.system().poll(device_.file(), timeout);
        if (events < 0 && events != -EINTR && events != -EAGAIN)
            device_.fail("wait for a frame", -events);
        if (events > 0 && (events & (POLLERR | POLLHUP | POLLNVAL)) && !(events & POLLIN)) {
            device_.set_lost();
            device_.fail("wait for a frame", "the driver ended the stream: the device is gone");
        }
        return events > 0;
    }

private:
    struct Mapping {
        void* memory;
        std::size_t length;
    };

    void allocate() {
        v4l2_requestbuffers request{};
        request.count = wanted_buffers;
        request.type = device_.buffer_type();
        request.memory = V4L2_MEMORY_MMAP;
        device_.require(VIDIOC_REQBUFS, &request, "ask for buffers");
        if (request.count < min_buffers)
            device_.fail("ask for buffers",
                         fmt::format("the driver gives {}, at least {} are needed", request.count,
                                     min_buffers));
        for (unsigned i = 0; i < std::min(request.count, wanted_buffers); ++i) {
            map(i);
            give_back({.index = i});
        }
    }

    void map(unsigned index) {
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

    // In the background if the driver takes its time; the file may be another's by then, so only
    // the memory is given back.
    void stop() noexcept {
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
        if (!run_bounded(task, v4l2_patience)) {
            *abandoned = true;
            device_.set_lost();
        }
    }

    V4l2Device& device_;
    std::vector<Mapping> mappings_;
    unsigned planes_ = 1;
};

// ---- the camera ------------------------------------------------------------------------------

class V4l2Camera final : public DeviceCamera {
public:
    V4l2Camera(V4l2System& system, const std::string& id, const CameraLink& link, Clock& clock)
        : DeviceCamera("v4l2:" + id, link, clock), system_(system) {
        std::string node = id;
        if (id.rfind('/', 0) != 0)
            node = find_node(system_, [&](const V4l2Identity& found) { return found.bus == id; });
        if (node.empty())
            fail("open", "no camera is there");
        open(node);
        device_identity_ = device_->identity();
        identity_ = {"v4l2:" + id, "", device_identity_.card, device_identity_.serial};
    }

    CameraAbilities abilities() const override {
        require_alive("list abilities");
        CameraAbilities abilities{device_->formats(), controls_->list()};
        if (const auto frame_rate = device_->frame_rate_control())
            abilities.controls.push_back(*frame_rate);
        return abilities;
    }

    void reconnect(Instant deadline, std::stop_token stop) override {
        reconnect_every(look_again, deadline, stop);
    }

private:
    void open(const std::string& node) {
        device_ = std::make_unique<V4l2Device>(system_, node, name_);
        controls_ = std::make_unique<V4l2Controls>(*device_);
    }

    void close() noexcept override {
        disarm();
        controls_.reset();
        device_.reset();
    }

    void reopen() override {
        const std::string node = find_node(
            system_, [this](const V4l2Identity& found) { return found == device_identity_; });
        if (node.empty())
            fail("reconnect",
                 fmt::format("no {} is at {}", device_identity_.card, device_identity_.bus));
        open(node);
    }

    CaptureSettings apply(const CaptureSettings& wanted) override {
        remarks_.clear();
        image_format_ = device_->set_format(chosen_format(wanted), wanted.width, wanted.height);
        apply_controls(wanted);
        const CaptureSettings actual = read_back(wanted);
        const double step_us = static_cast<double>(controls_->exposure_step().count());
        refuse_if(first_difference(wanted, actual, step_us));
        require_alive("configure");
        remark_on_format(*image_format_.pixels, image_format_.pixels->v4l2);
        return actual;
    }

    void start_stream() override {
        const V4l2Timing::Camera timing = timing_of(*settings_);
        stream_ = std::make_unique<V4l2Stream>(*device_);
        timing_.emplace(timing, clock_.now());
        last_sequence_.reset();
    }

    void stop_stream() noexcept override { stream_.reset(); }

    void require_alive(const std::string& request) const override {
        if (!device_ || device_->lost())
            fail(request, "the device is gone");
    }

    const PixelFormat& chosen_format(const CaptureSettings& wanted) {
        const std::vector<CameraFormat> offered = device_->formats();
        const std::string request = wanted.format.empty()
                                        ? fmt::format("set {} bits a pixel", wanted.bits)
                                        : "set pixel format " + wanted.format;
        const auto is_wanted = [&](const CameraFormat& f) { return f.name == wanted.format; };
        if (!wanted.format.empty() && std::none_of(offered.begin(), offered.end(), is_wanted))
            fail(request, "the device offers " + names_of(offered));
        const PixelFormat* format = wanted.format.empty() ? monochrome_format(offered, wanted.bits)
                                                          : find_v4l2_format(wanted.format);
        if (!format)
            fail(request,
                 wanted.format.empty()
                     ? "no monochrome format of the device has them; it offers " + names_of(offered)
                     : "this program cannot unpack it");
        const int depth = format->bits <= 8 ? CV_8U : CV_16U;
        if (wanted.bits && (!bits_fit_depth(wanted.bits, depth) || wanted.bits > format->bits))
            fail(fmt::format("set {} bits a pixel", wanted.bits),
                 fmt::format("{} has {}", format->v4l2, format->bits));
        return *format;
    }

    // The frame rate comes first, since it limits the exposure. Those asked for by name come last:
    // who asks for sharpness gets it.
    void apply_controls(const CaptureSettings& wanted) {
        if (const auto rate = wanted.controls.find(frame_rate_name); rate != wanted.controls.end())
            device_->set_frame_rate(rate->second);
        remarks_ = controls_->bring_to_rest();
        if (wanted.exposure.count())
            controls_->set_exposure(wanted.exposure);
        if (wanted.gain_db != 0.0)
            fail(fmt::format("set gain {} dB", wanted.gain_db),
                 "gains of V4L2 devices have no unit: set the control \"gain\"");
        if (wanted.black_level)
            controls_->set("black_level", *wanted.black_level);
        for (const auto& [name, value] : wanted.controls)
            if (name != frame_rate_name)
                controls_->set(name, value);
    }

    CaptureSettings read_back(const CaptureSettings& wanted) {
        CaptureSettings actual;
        actual.width = image_format_.width;
        actual.height = image_format_.height;
        actual.bits = wanted.bits ? wanted.bits : image_format_.pixels->bits;
        actual.format = image_format_.pixels->v4l2;
        actual.exposure = controls_->exposure().value_or(0us);
        actual.trigger = "none";
        if (wanted.black_level)
            actual.black_level = controls_->get("black_level");
        for (const auto& [name, value] : wanted.controls)
            actual.controls[name] = name == frame_rate_name ? device_->frame_rate().value_or(0.0)
                                                            : controls_->get(name);
        return actual;
    }

    V4l2Timing::Camera timing_of(const CaptureSettings& settings) {
        const bool usb = device_identity_.driver == "uvcvideo";
        const Duration period = frame_period();
        V4l2Timing::Camera timing;
        timing.longest_hold = usb ? UsbDelay::expected(period) : period;
        timing.shortest_exposure = settings.exposure;
        timing.longest_exposure = settings.exposure.count() ? settings.exposure : period;
        timing.over_usb = usb;
        return timing;
    }

    // A frame takes at least its exposure, whatever rate the driver says.
    Duration frame_period() {
        Duration period = device_->frame_period();
        if (period <= Duration(0)) {
            period = link_.frame_timeout;
            remark(
                fmt::format("the driver does not say its frame rate: {} ms between frames are "
                            "assumed",
                            link_.frame_timeout.count()));
        }
        return std::max<Duration>(period, settings_->exposure);
    }

    // The first frame, good or bad, that is not older.
    Frame next_frame(Instant t, std::stop_token stop) override {
        wait_until_after(clock_, t, stop);
        const Duration limit = link_.frame_timeout + timing_->longest_wait();
        const Instant deadline = clock_.now() + limit;
        int too_old = 0;
        bool announced = false;
        do {
            if (stop.stop_requested())
                throw Interrupted();
            if (const auto buffer = stream_->take()) {
                std::optional<Frame> frame = judged(*buffer, t);
                stream_->give_back(*buffer);
                if (frame) {
                    require_codes(*frame, *image_format_.pixels);
                    return std::move(*frame);
                }
                ++too_old;
                ++statistics_.rejected;
                announced = false;
                continue;
            }
            timing_->saw_empty_queue(clock_.now());
            if (announced)  // falsely: not again and again without a pause
                clock_.wait_for(1ms, stop);
            announced = stream_->wait(look_around);
        } while (clock_.now() < deadline);
        return nothing_came(
            fmt::format("no frame within {} ms{}", duration_cast<milliseconds>(limit).count(),
                        too_old ? fmt::format(", but {} that were too old", too_old) : ""));
    }

    // Nothing for a frame that is too old.
    std::optional<Frame> judged(const FilledBuffer& buffer, Instant t) {
        const Instant now = clock_.now();
        count(buffer.sequence);
        const std::string stamp_fault = timing_->check(buffer, frame_id_, now);
        Frame frame = described(buffer, now);
        if (stamp_fault.empty() && frame.exposure_start - frame.exposure_start_uncertainty <= t)
            return std::nullopt;
        frame.status = FrameStatus::corrupt;
        frame.status_detail = !buffer.fault.empty() ? buffer.fault : stamp_fault;
        if (frame.status_detail.empty())
            unpack_into(frame, *image_format_.pixels,
                        {buffer.data, image_format_.width, image_format_.height,
                         image_format_.bytes_per_line},
                        settings_->bits);
        return frame;
    }

    Frame described(const FilledBuffer& buffer, Instant now) {
        const ExposureStart start = timing_->exposure_start(buffer, now);
        if (start.source == TimeSource::request)
            remark(
                "the driver's time stamps are of an unknown clock or lie ahead of the frames: "
                "their arrival is used");
        Frame frame;
        frame.mosaic = image_format_.pixels->mosaic;
        frame.id = frame_id_;
        date(frame, {start.earliest, start.latest});
        frame.time_source = start.source;
        frame.device_time_ns = static_cast<std::uint64_t>(buffer.stamp.count());
        frame.settings = *settings_;
        return frame;
    }

    // The driver's counter has 32 bits, and some stand still or begin anew; a frame's id only
    // grows.
    void count(std::uint32_t sequence) {
        const std::uint32_t ahead = last_sequence_ ? sequence - *last_sequence_ : 0;
        if (!last_sequence_)
            frame_id_ = std::max<std::uint64_t>(sequence, frame_id_ + 1);
        else if (ahead == 0 || ahead > std::numeric_limits<std::uint32_t>::max() / 2)
            ++frame_id_;
        else {
            frame_id_ += ahead;
            statistics_.skipped += ahead - 1;
        }
        last_sequence_ = sequence;
    }

    V4l2System& system_;
    V4l2Identity device_identity_;

    // In this order, so that the stream ends before its device closes.
    std::unique_ptr<V4l2Device> device_;
    std::unique_ptr<V4l2Controls> controls_;
    std::unique_ptr<V4l2Stream> stream_;

    V4l2ImageFormat image_format_;

    // Of the running stream.
    std::optional<V4l2Timing> timing_;
    std::optional<std::uint32_t> last_sequence_;
    std::uint64_t frame_id_ = 0;
};

}  // namespace

std::unique_ptr<Camera> open_v4l2_camera(const std::string& id, const CameraLink& link,
                                         Clock& clock, V4l2System& system) {
    return std::make_unique<V4l2Camera>(system, id, link, clock);
}

std::vector<CameraIdentity> list_v4l2_cameras(V4l2System& system) {
    std::vector<CameraIdentity> found;
    for (const std::string& node : system.nodes()) {
        try {
            const V4l2Identity device = V4l2Device(system, node, "camera v4l2:" + node).identity();
            found.push_back({"v4l2:" + node, "", device.card + " at " + device.bus, device.serial});
        } catch (const DeviceError& error) {
            if (error.request().rfind("open", 0) == 0)
                found.push_back({"v4l2:" + node, "", "cannot be opened: " + error.cause(), ""});
        }
    }
    return found;
}

}  // namespace etalon
