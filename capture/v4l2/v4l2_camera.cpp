#include "capture/v4l2/v4l2_camera.h"

#include <linux/videodev2.h>
#include <poll.h>

#include <array>
#include <atomic>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <limits>

#include "capture/frame/device_camera.h"
#include "capture/v4l2/v4l2_timing.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;
using std::chrono::duration_cast;
using std::chrono::microseconds;
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

// ---- controls --------------------------------------------------------------------------------

constexpr int exposure_unit_us = 100;  // of V4L2_CID_EXPOSURE_ABSOLUTE

// Where a control is to be when it does nothing.
struct Rest {
    enum class Place { value, lowest, normal };
    std::uint32_t id;
    Place place;
    std::int64_t value = 0;
};
using enum Rest::Place;

// Automatic functions first: while they run, the controls below them cannot be set.
constexpr Rest rests[] = {
    {V4L2_CID_EXPOSURE_AUTO, value, V4L2_EXPOSURE_MANUAL},
    {V4L2_CID_EXPOSURE_AUTO_PRIORITY, value},
    {V4L2_CID_AUTOGAIN, value},
    {V4L2_CID_AUTO_WHITE_BALANCE, value},
    {V4L2_CID_AUTO_N_PRESET_WHITE_BALANCE, value, V4L2_WHITE_BALANCE_MANUAL},
    {V4L2_CID_HUE_AUTO, value},
    {V4L2_CID_AUTOBRIGHTNESS, value},
    {V4L2_CID_CHROMA_AGC, value},
    {V4L2_CID_ISO_SENSITIVITY_AUTO, value, V4L2_ISO_SENSITIVITY_MANUAL},
    {V4L2_CID_FOCUS_AUTO, value},
    {V4L2_CID_SCENE_MODE, value, V4L2_SCENE_MODE_NONE},
    {V4L2_CID_POWER_LINE_FREQUENCY, value, V4L2_CID_POWER_LINE_FREQUENCY_DISABLED},
    {V4L2_CID_BAND_STOP_FILTER, value},
    {V4L2_CID_WIDE_DYNAMIC_RANGE, value},
    {V4L2_CID_IMAGE_STABILIZATION, value},
    {V4L2_CID_COLORFX, value, V4L2_COLORFX_NONE},
    {V4L2_CID_TEST_PATTERN, value},
    {V4L2_CID_HFLIP, value},
    {V4L2_CID_VFLIP, value},
    {V4L2_CID_ROTATE, value},
    {V4L2_CID_BACKLIGHT_COMPENSATION, lowest},
    {V4L2_CID_SHARPNESS, lowest},
    {V4L2_CID_GAIN, lowest},
    {V4L2_CID_BRIGHTNESS, normal},
    {V4L2_CID_CONTRAST, normal},
    {V4L2_CID_GAMMA, normal},
    {V4L2_CID_SATURATION, normal},
    {V4L2_CID_HUE, normal},
};

// Drivers' own enhancing functions have no number that all share, only names.
constexpr std::string_view enhancing_names[] = {"noise_reduction", "denoise", "hdr"};

std::string normalised(std::string_view name) {
    std::string result;
    for (const char c : name) {
        const auto letter = static_cast<unsigned char>(c);
        if (std::isalnum(letter))
            result += static_cast<char>(std::tolower(letter));
        else if (!result.empty() && result.back() != '_')
            result += '_';
    }
    while (!result.empty() && result.back() == '_')
        result.pop_back();
    return result;
}

bool is_menu(std::uint32_t type) {
    return type == V4L2_CTRL_TYPE_MENU || type == V4L2_CTRL_TYPE_INTEGER_MENU;
}

bool has_a_number(std::uint32_t type) {
    return type == V4L2_CTRL_TYPE_INTEGER || type == V4L2_CTRL_TYPE_INTEGER64 ||
           type == V4L2_CTRL_TYPE_BOOLEAN || type == V4L2_CTRL_TYPE_BITMASK || is_menu(type);
}

bool enhances(const std::string& name) {
    return std::any_of(std::begin(enhancing_names), std::end(enhancing_names),
                       [&](std::string_view part) { return name.find(part) != name.npos; });
}

// The controls of a video node: exposure, and what makes a picture differ from what the sensor saw.
// Names are the driver's as v4l2-ctl writes them ("exposure_time_absolute"). Source: the kernel's
// "Extended Controls API" and "Camera Control Reference".
class V4l2Controls {
public:
    // Asks the device which it has. The device outlives this.
    explicit V4l2Controls(V4l2Device& device) : device_(device) {
        v4l2_query_ext_ctrl answer{};
        answer.id = V4L2_CTRL_FLAG_NEXT_CTRL;
        while (controls_.size() < 1000 && device_.ask(VIDIOC_QUERY_EXT_CTRL, &answer) == 0) {
            if (has_a_number(answer.type) && !(answer.flags & V4L2_CTRL_FLAG_DISABLED))
                controls_.push_back(
                    {answer.id, answer.type, answer.flags,
                     normalised({answer.name, strnlen(answer.name, sizeof answer.name)}),
                     answer.minimum, answer.maximum, static_cast<std::int64_t>(answer.step),
                     answer.default_value});
            answer.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
        }
        if (device_.lost())
            device_.fail("list the controls", ENODEV);
    }

    // With their values now.
    std::vector<CameraControl> list() {
        std::vector<CameraControl> all;
        for (const Control& control : controls_)
            all.push_back(described(control));
        return all;
    }

    // Automatic functions off; sharpness, gain and backlight compensation lowest, tone and colour
    // at the driver's default, no mirroring. Returns a line for each that could not be set so.
    std::vector<std::string> bring_to_rest() {
        std::vector<std::string> remarks;
        const auto bring = [&](const Control& control, std::int64_t rest) {
            if (const auto remark = bring_to(control, rest))
                remarks.push_back(*remark);
        };
        for (const Rest& rest : rests) {
            const Control* control = find(rest.id);
            if (control)
                bring(*control, rest.place == value    ? rest.value
                                : rest.place == lowest ? control->low
                                                       : control->normal);
        }
        for (const Control& control : controls_)
            if (enhances(control.name))
                bring(control, control.low);
        return remarks;
    }

    // Sets and reads back. Throws DeviceError: no such control, out of range, not whole, refused.
    void set(const std::string& name, double value) {
        const std::string what = fmt::format("set control {} = {}", name, value);
        const Control& control = named(name, what);
        if (value != std::floor(value) || std::abs(value) > 1e15)
            device_.fail(what, "controls are whole numbers");
        set_checked(control, static_cast<std::int64_t>(value), what);
    }

    double get(const std::string& name) {
        const std::string what = "read control " + name;
        std::int64_t value = 0;
        if (const int error = read(named(name, what), value))
            device_.fail(what, error);
        return static_cast<double>(value);
    }  // throws as above

    // Exposure time in the API's steps of 100 us; nothing where the device does not say it so.
    std::optional<microseconds> exposure() {
        const Control* control = find(V4L2_CID_EXPOSURE_ABSOLUTE);
        std::int64_t units = 0;
        if (!control || read(*control, units) != 0)
            return std::nullopt;
        return microseconds(units * exposure_unit_us);
    }
    microseconds exposure_step() const {
        const Control* control = find(V4L2_CID_EXPOSURE_ABSOLUTE);
        return microseconds(exposure_unit_us *
                            (control ? std::max<std::int64_t>(control->step, 1) : 1));
    }

    // To the nearest step. Throws DeviceError: no such control, refused, or automatic exposure.
    void set_exposure(microseconds exposure) {
        const std::string what = fmt::format("set exposure {} us", exposure.count());
        const Control* control = find(V4L2_CID_EXPOSURE_ABSOLUTE);
        if (!control)
            device_.fail(what, "the device has no exposure time in known units");
        if (const Control* automatic = find(V4L2_CID_EXPOSURE_AUTO)) {
            std::int64_t mode = 0;
            if (read(*automatic, mode) != 0 ||
                (mode != V4L2_EXPOSURE_MANUAL && mode != V4L2_EXPOSURE_SHUTTER_PRIORITY))
                device_.fail(what, "the automatic exposure cannot be switched off");
        }
        const std::int64_t step = exposure_step().count() / exposure_unit_us;
        const double steps = (static_cast<double>(exposure.count()) / exposure_unit_us -
                              static_cast<double>(control->low)) /
                             static_cast<double>(step);
        const std::int64_t units = control->low + std::llround(steps) * step;
        set_checked(*control, units, what);
    }

private:
    struct Control {
        std::uint32_t id, type, flags;
        std::string name;
        std::int64_t low, high, step, normal;
    };

    const Control* find(std::uint32_t id) const {
        const auto found = std::find_if(controls_.begin(), controls_.end(),
                                        [=](const Control& control) { return control.id == id; });
        return found == controls_.end() ? nullptr : &*found;
    }
    const Control& named(const std::string& name, const std::string& what) const {
        const auto found =
            std::find_if(controls_.begin(), controls_.end(),
                         [&](const Control& control) { return control.name == normalised(name); });
        if (found == controls_.end())
            device_.fail(what, "the device has no such control");
        return *found;
    }
    int transfer(unsigned long direction, const Control& control, std::int64_t& value) {
        const bool is_wide = control.type == V4L2_CTRL_TYPE_INTEGER64;
        v4l2_ext_control one{};
        one.id = control.id;
        if (is_wide)
            one.value64 = value;
        else
            one.value = static_cast<std::int32_t>(value);
        v4l2_ext_controls request{};
        request.which = V4L2_CTRL_WHICH_CUR_VAL;
        request.count = 1;
        request.controls = &one;
        const int error = device_.ask(direction, &request);
        value = is_wide ? one.value64 : one.value;
        return error;
    }
    int read(const Control& control, std::int64_t& value) {
        return transfer(VIDIOC_G_EXT_CTRLS, control, value);
    }
    int write(const Control& control, std::int64_t value) {
        return transfer(VIDIOC_S_EXT_CTRLS, control, value);
    }
    void set_checked(const Control& control, std::int64_t value, const std::string& what) {
        if (value < control.low || value > control.high)
            device_.fail(what,
                         fmt::format("{} takes {} to {}", control.name, control.low, control.high));
        if (const int error = write(control, value))
            device_.fail(what, error);
        std::int64_t actual = 0;
        if (const int error = read(control, actual))
            device_.fail(what, error);
        if (actual != value)
            device_.fail(what, fmt::format("the device uses {} = {}", control.name, actual));
    }
    std::optional<std::string> bring_to(const Control& control, std::int64_t rest) {
        // Nothing if it is there.
        std::int64_t actual = 0;
        if (read(control, actual) == 0 && actual == rest)
            return std::nullopt;
        const int refused = write(control, rest);
        if (device_.lost())
            device_.fail("set " + control.name, ENODEV);
        if (const int error = read(control, actual))
            return fmt::format("{} cannot be read: {}", control.name, describe_error(error));
        if (actual == rest)
            return std::nullopt;
        return fmt::format("{} stays at {}: it cannot be set to {}{}", control.name, actual, rest,
                           refused ? ", " + describe_error(refused) : "");
    }
    std::vector<std::string> choices(const Control& control) {
        // "1: Manual Mode": the number is what set() takes; drivers leave numbers out.
        std::vector<std::string> found;
        v4l2_querymenu item{};
        item.id = control.id;
        for (std::int64_t i = std::max<std::int64_t>(control.low, 0);
             i <= std::min<std::int64_t>(control.high, 255); ++i) {
            item.index = static_cast<std::uint32_t>(i);
            if (device_.ask(VIDIOC_QUERYMENU, &item) != 0)
                continue;
            const char* name = reinterpret_cast<const char*>(item.name);
            const std::int64_t number = item.value;  // the other member of a packed union
            found.push_back(fmt::format("{}: {}", i,
                                        control.type == V4L2_CTRL_TYPE_INTEGER_MENU
                                            ? std::to_string(number)
                                            : printable({name, strnlen(name, 32)})));
        }
        return found;
    }
    CameraControl described(const Control& control) {
        CameraControl result;
        result.name = control.name;
        result.read_only = control.flags & V4L2_CTRL_FLAG_READ_ONLY;
        std::int64_t number = 0;
        const bool known = read(control, number) == 0;
        result.value = known ? std::to_string(number) : "";
        result.low = static_cast<double>(control.low);
        result.high = static_cast<double>(control.high);
        result.step = static_cast<double>(control.step);
        if (control.id == V4L2_CID_EXPOSURE_ABSOLUTE)
            result.unit = "100 us";
        if (!is_menu(control.type))
            return result;
        result.choices = choices(control);
        for (const std::string& choice : result.choices)
            if (known && choice.rfind(std::to_string(number) + ":", 0) == 0)
                result.value = choice;
        return result;
    }

    V4l2Device& device_;
    std::vector<Control> controls_;
};

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
            device_.fail(
                "take a frame",
                fmt::format("the driver returns a buffer {} that it was not given", buffer.index));
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

    // In the background if the driver hangs; then only the memory is given back.
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
        : DeviceCamera("v4l2:" + id, link, clock, look_again), system_(system) {
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

    // The frame rate first: it limits the exposure. Those by name last: they have the last word.
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
            throw_if_stopped(stop);
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

    // The driver's counter has 32 bits, may stand still or begin again; a frame's id only grows.
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
