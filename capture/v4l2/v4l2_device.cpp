#include "capture/v4l2/v4l2_device.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/videodev2.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>

#include "capture/frame/frame_checks.h"

namespace etalon {
namespace {

namespace fs = std::filesystem;

int result_of(int result) {
    return result < 0 ? -errno : result;
}

// N of "/dev/videoN"; -1 for any other path.
int node_number(const fs::path& path) {
    const std::string name = path.filename().string();
    int number = -1;
    if (name.rfind("video", 0) == 0)
        std::from_chars(name.data() + 5, name.data() + name.size(), number);
    return number;
}

class KernelSystem final : public V4l2System {
public:
    std::vector<std::string> nodes() override {
        std::vector<fs::path> found;
        std::error_code error;
        for (fs::directory_iterator entry("/dev", error), end; !error && entry != end;
             entry.increment(error))
            if (node_number(entry->path()) >= 0)
                found.push_back(entry->path());
        std::sort(found.begin(), found.end(), [](const fs::path& a, const fs::path& b) {
            return node_number(a) < node_number(b);
        });
        return {found.begin(), found.end()};
    }

    // The node's "device" is the USB interface; the number is an attribute of the device above it.
    std::string serial_number(const std::string& node) override {
        std::error_code error;
        const fs::path real = fs::canonical(node, error);  // may be a link below /dev/v4l
        const fs::path interface =
            fs::canonical("/sys/class/video4linux" / real.filename() / "device", error);
        std::string serial;
        if (!error)
            std::getline(std::ifstream(interface.parent_path() / "serial"), serial);
        return serial;
    }

    int open(const std::string& node) override {
        return result_of(::open(node.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC));
    }
    int close(int file) override { return result_of(::close(file)); }
    int ioctl(int file, unsigned long request, void* argument) override {
        return result_of(::ioctl(file, request, argument));
    }
    void* map(int file, std::size_t length, off_t offset) override {
        void* memory = ::mmap(nullptr, length, PROT_READ, MAP_SHARED, file, offset);
        return memory == MAP_FAILED ? nullptr : memory;
    }
    void unmap(void* memory, std::size_t length) override { ::munmap(memory, length); }
    int poll(int file, std::chrono::milliseconds timeout) override {
        pollfd waited{file, POLLIN, 0};
        const int ready = result_of(::poll(&waited, 1, static_cast<int>(timeout.count())));
        return ready > 0 ? waited.revents : ready;
    }
};

constexpr std::uint32_t big_endian_bit = 1u << 31;
constexpr double max_period_s = 3600.0;  // between frames; more is no answer
constexpr double max_rate_hz = 1e5;

// A field of fixed size that the driver need not end with a zero.
template <std::size_t size>
std::string text(const __u8 (&field)[size]) {
    const auto* begin = reinterpret_cast<const char*>(field);
    return printable({begin, strnlen(begin, size)});
}

std::uint32_t fourcc_of(const PixelFormat& format) {
    std::uint32_t fourcc = format.v4l2.size() > 4 ? big_endian_bit : 0;
    const std::string characters = fmt::format("{:<4}", format.v4l2);
    for (unsigned i = 0; i < 4; ++i)
        fourcc |= std::uint32_t{static_cast<unsigned char>(characters[i])} << 8 * i;
    return fourcc;
}

// The members that single- and multi-planar formats share.
struct Layout {
    std::uint32_t width, height, fourcc, field, bytes_per_line;
};

Layout layout_of(const v4l2_format& format, bool multi_planar) {
    const v4l2_pix_format& one = format.fmt.pix;
    const v4l2_pix_format_mplane& many = format.fmt.pix_mp;
    if (multi_planar)
        return {many.width, many.height, many.pixelformat, many.field,
                many.plane_fmt[0].bytesperline};
    return {one.width, one.height, one.pixelformat, one.field, one.bytesperline};
}

void ask_for(v4l2_format& format, bool multi_planar, std::uint32_t fourcc, int width, int height) {
    const v4l2_format kept = format;
    const Layout now = layout_of(kept, multi_planar);
    std::memset(&format.fmt, 0, sizeof format.fmt);
    const auto set = [&](auto& pixels) {
        pixels.width = width ? static_cast<std::uint32_t>(width) : now.width;
        pixels.height = height ? static_cast<std::uint32_t>(height) : now.height;
        pixels.pixelformat = fourcc;
        pixels.field = V4L2_FIELD_NONE;
    };
    if (multi_planar)
        set(format.fmt.pix_mp);
    else
        set(format.fmt.pix);
}

double seconds(const v4l2_fract& period) {
    return period.denominator ? double(period.numerator) / period.denominator : 0.0;
}

// Drivers count periods in whole microseconds or 100 ns.
double rate_hz(double period_s) {
    return std::round(100.0 / period_s) / 100.0;
}

FrameSizes frame_sizes(const v4l2_frmsizeenum& answer) {
    const auto size = [](std::uint32_t width, std::uint32_t height) {
        return cv::Size(static_cast<int>(width), static_cast<int>(height));
    };
    if (answer.type == V4L2_FRMSIZE_TYPE_DISCRETE) {
        const cv::Size one = size(answer.discrete.width, answer.discrete.height);
        return {one, one};
    }
    const v4l2_frmsize_stepwise& range = answer.stepwise;
    return {size(range.min_width, range.min_height), size(range.max_width, range.max_height),
            size(range.step_width, range.step_height)};
}

}  // namespace

V4l2System& v4l2_system() {
    static KernelSystem system;
    return system;
}

std::string v4l2_format_name(std::uint32_t fourcc) {
    std::string name;
    for (unsigned i = 0; i < 4; ++i)
        name += static_cast<char>((fourcc & ~big_endian_bit) >> 8 * i & 0xFF);
    name += fourcc & big_endian_bit ? "-BE" : "";
    return name.substr(0, name.find_last_not_of(' ') + 1);
}

std::string describe_error(int error) {
    const char* name = strerrorname_np(error);
    return fmt::format("{} ({})", std::generic_category().message(error),
                       name ? name : std::to_string(error));
}

V4l2Device::V4l2Device(V4l2System& system, const std::string& node, std::string name)
    : system_(system), name_(std::move(name)) {
    file_ = system_.open(node);
    if (file_ < 0)
        fail("open " + node, -file_);
    try {
        read_capability();
    } catch (const Error&) {
        system_.close(file_);
        throw;
    }
    identity_.serial = system_.serial_number(node);
}

V4l2Device::~V4l2Device() {
    run_bounded([&system = system_, file = file_] { system.close(file); }, v4l2_patience);
}

void V4l2Device::read_capability() {
    v4l2_capability answer{};
    require(VIDIOC_QUERYCAP, &answer, "ask what it is");
    const std::uint32_t abilities =
        answer.capabilities & V4L2_CAP_DEVICE_CAPS ? answer.device_caps : answer.capabilities;
    if (!(abilities & (V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_VIDEO_CAPTURE_MPLANE)))
        fail("ask what it is", "this node captures no video");
    if (!(abilities & V4L2_CAP_STREAMING))
        fail("ask what it is", "the driver cannot stream");
    multi_planar_ = !(abilities & V4L2_CAP_VIDEO_CAPTURE);
    identity_ = {text(answer.driver), text(answer.card), text(answer.bus_info), ""};
}

unsigned V4l2Device::buffer_type() const {
    return multi_planar_ ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE : V4L2_BUF_TYPE_VIDEO_CAPTURE;
}

int V4l2Device::ask(unsigned long request, void* argument) {
    int result = 0;
    do {
        result = system_.ioctl(file_, request, argument);
    } while (result == -EINTR);
    if (result == -ENODEV)
        lost_ = true;
    return result < 0 ? -result : 0;
}

void V4l2Device::require(unsigned long request, void* argument, const std::string& what) {
    if (const int error = ask(request, argument))
        fail(what, error);
}

void V4l2Device::fail(const std::string& what, const std::string& cause) const {
    throw DeviceError(name_, what, cause);
}

void V4l2Device::fail(const std::string& what, int error) const {
    switch (error) {
        case ENODEV:
        case ENOENT:
            fail(what, "the device is not there: " + describe_error(error));
        case EBUSY:
            fail(what, "another program uses the device: " + describe_error(error));
        case EACCES:
        case EPERM:
            fail(what, describe_error(error) + "; is this user in the group \"video\"?");
        default:
            fail(what, describe_error(error));
    }
}

// ---- formats ---------------------------------------------------------------------------------

std::vector<CameraFormat> V4l2Device::formats() {
    std::vector<CameraFormat> found;
    v4l2_fmtdesc answer{};
    answer.type = buffer_type();
    for (; answer.index < 256 && ask(VIDIOC_ENUM_FMT, &answer) == 0; ++answer.index) {
        CameraFormat format;
        format.name = v4l2_format_name(answer.pixelformat);
        format.description = text(answer.description);
        if (const PixelFormat* known = find_v4l2_format(format.name))
            format.bits = known->bits;
        format.sizes = sizes(answer.pixelformat);
        found.push_back(std::move(format));
    }
    if (lost_)
        fail("list the formats", ENODEV);
    return found;
}

std::vector<FrameSizes> V4l2Device::sizes(std::uint32_t fourcc) {
    std::vector<FrameSizes> found;
    v4l2_frmsizeenum answer{};
    answer.pixel_format = fourcc;
    for (; answer.index < 256 && ask(VIDIOC_ENUM_FRAMESIZES, &answer) == 0; ++answer.index) {
        found.push_back(frame_sizes(answer));
        if (answer.type != V4L2_FRMSIZE_TYPE_DISCRETE)
            break;
    }
    return found;
}

V4l2ImageFormat V4l2Device::set_format(const PixelFormat& pixels, int width, int height) {
    v4l2_format format{};
    format.type = buffer_type();
    require(VIDIOC_G_FMT, &format, "read the image format");
    ask_for(format, multi_planar_, fourcc_of(pixels), width, height);
    const Layout wanted = layout_of(format, multi_planar_);
    const std::string what =
        fmt::format("set image format {} with {}x{}", v4l2_format_name(wanted.fourcc), wanted.width,
                    wanted.height);
    require(VIDIOC_S_FMT, &format, what);
    require(VIDIOC_G_FMT, &format, what);
    const Layout actual = layout_of(format, multi_planar_);
    if (actual.fourcc != wanted.fourcc || actual.width != wanted.width ||
        actual.height != wanted.height)
        fail(what, fmt::format("the device uses {} with {}x{}", v4l2_format_name(actual.fourcc),
                               actual.width, actual.height));
    if (actual.field != V4L2_FIELD_NONE && actual.field != V4L2_FIELD_ANY)
        fail(what, "the device sends interlaced fields");
    V4l2ImageFormat image{&pixels, static_cast<int>(actual.width), static_cast<int>(actual.height),
                          actual.bytes_per_line};
    const std::size_t line = line_bytes(pixels, image.width);
    if (image.bytes_per_line == 0)
        image.bytes_per_line = line;
    if (image.width <= 0 || image.height <= 0 || image.bytes_per_line < line)
        fail(what, fmt::format("the driver's lines of {} bytes cannot hold {} pixels",
                               actual.bytes_per_line, actual.width));
    return image;
}

Duration V4l2Device::frame_period() {
    v4l2_streamparm answer{};
    answer.type = buffer_type();
    if (ask(VIDIOC_G_PARM, &answer) != 0)
        return {};
    const double period_s = seconds(answer.parm.capture.timeperframe);
    if (period_s > max_period_s)
        return {};
    return std::chrono::duration_cast<Duration>(std::chrono::duration<double>(period_s));
}

std::optional<double> V4l2Device::frame_rate() {
    const std::chrono::duration<double> period = frame_period();
    return period.count() > 0.0 ? std::optional(rate_hz(period.count())) : std::nullopt;
}

void V4l2Device::set_frame_rate(double hz) {
    const std::string what = fmt::format("set {} to {}", frame_rate_name, hz);
    if (!(hz >= 1.0 / max_period_s && hz <= max_rate_hz))
        fail(what, "that is no frame rate");
    v4l2_streamparm wanted{};
    wanted.type = buffer_type();
    require(VIDIOC_G_PARM, &wanted, what);
    if (!(wanted.parm.capture.capability & V4L2_CAP_TIMEPERFRAME))
        fail(what, "the driver cannot set it");
    constexpr unsigned ten_thousand = 10000;
    wanted.parm.capture.timeperframe = {ten_thousand,
                                        static_cast<std::uint32_t>(std::lround(hz * ten_thousand))};
    require(VIDIOC_S_PARM, &wanted, what);
}

std::optional<CameraControl> V4l2Device::frame_rate_control() {
    const std::optional<double> now = frame_rate();
    if (!now)
        return std::nullopt;
    CameraControl control;
    control.name = frame_rate_name;
    control.value = fmt::format("{}", *now);
    control.unit = "Hz";
    list_frame_rates(control);
    return control;
}

// Those of the image format that is set.
void V4l2Device::list_frame_rates(CameraControl& control) {
    v4l2_format format{};
    format.type = buffer_type();
    if (ask(VIDIOC_G_FMT, &format) != 0)
        return;
    const Layout image = layout_of(format, multi_planar_);
    v4l2_frmivalenum answer{};
    answer.pixel_format = image.fourcc;
    answer.width = image.width;
    answer.height = image.height;
    for (; answer.index < 256 && ask(VIDIOC_ENUM_FRAMEINTERVALS, &answer) == 0; ++answer.index) {
        if (answer.type != V4L2_FRMIVAL_TYPE_DISCRETE) {
            control.low = rate_hz(seconds(answer.stepwise.max));
            control.high = rate_hz(seconds(answer.stepwise.min));
            return;
        }
        control.choices.push_back(fmt::format("{}", rate_hz(seconds(answer.discrete))));
    }
}

}  // namespace etalon
