#include "mocks/gige_camera.h"

#include <arpa/inet.h>
#include <arv.h>
#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <condition_variable>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <thread>

#include "capture/pixel_formats.h"
#include "core/errors.h"
#include "mocks/gige_description.h"

namespace etalon {
namespace {

constexpr const char* address = "127.0.0.1";
constexpr int gige_vision_port = 3956;  // GVCP's, fixed by the standard
// The fake camera looks for a trigger this often. Its loop polls with whole milliseconds left and
// spins through the last one: 1000 Hz would burn a whole core.
constexpr double trigger_poll_hz = 200.0;

const std::string device_name = fmt::format("camera {}:{}", address, gige_vision_port);

// The fake camera does not notice that its port is taken: it stays deaf. So the port is bound for a
// moment first, exclusively. What remains is the race of two twins started in the same millisecond.
void require_free_port() {
    const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_in name{};
    name.sin_family = AF_INET;
    name.sin_port = htons(gige_vision_port);
    inet_pton(AF_INET, address, &name.sin_addr);
    const bool bound =
        socket >= 0 && bind(socket, reinterpret_cast<const sockaddr*>(&name), sizeof name) == 0;
    const std::string cause = bound ? "" : std::strerror(errno);
    if (socket >= 0)
        close(socket);
    if (!bound)
        throw DeviceError(device_name, "listen", cause);
}

void require_usable(const GigeCameraOptions& options) {
    const auto fail = [](const std::string& message) {
        throw ConfigError({"", 0, "camera"}, message);
    };
    if (options.width < 1 || options.height < 1 || options.width > 16384 || options.height > 16384)
        fail(fmt::format("a sensor of {}x{} is impossible", options.width, options.height));
    if (options.bits < 1 || options.bits > 16)
        fail(fmt::format("{} bits are impossible", options.bits));
    if (options.serial.empty() || options.serial.size() > 15)
        fail("the serial number must have 1 to 15 characters");
    for (const std::string& format : options.formats)
        if (find_pfnc_format(format) == nullptr)
            fail("there is no pixel format " + format);
    if (!(options.packet_loss >= 0.0 && options.packet_loss <= 1.0))
        fail("the packet loss must be between 0 and 1");
}

// Where the client's region lies on the sensor. The pattern callback's buffer does not know its own
// size yet, only the region.
cv::Rect region_of(ArvBuffer* buffer) {
    int x = 0, y = 0, width = 0, height = 0;
    arv_buffer_get_image_region(buffer, &x, &y, &width, &height);
    return {x, y, width, height};
}

void copy_region(const cv::Mat& sensor, const cv::Rect& region, cv::Mat& out) {
    out.setTo(0);
    const cv::Rect seen = region & cv::Rect(0, 0, sensor.cols, sensor.rows);
    if (seen.empty() || sensor.type() != out.type())
        return;
    sensor(seen).copyTo(out(seen - region.tl()));
}

// Codes one after the other, low bits first (PFNC "p").
void pack_stream(const cv::Mat& codes, int bits, std::uint8_t* out) {
    std::uint32_t waiting = 0;
    int count = 0;
    for (int y = 0; y < codes.rows; ++y)
        for (int x = 0; x < codes.cols; ++x) {
            waiting |= static_cast<std::uint32_t>(codes.at<std::uint16_t>(y, x)) << count;
            for (count += bits; count >= 8; count -= 8, waiting >>= 8)
                *out++ = static_cast<std::uint8_t>(waiting);
        }
}

// Two codes in three bytes: high bits, the low bits of both, high bits (GigE Vision 1.2).
void pack_pairs(const cv::Mat& codes, int bits, std::uint8_t* out) {
    const int low = bits - 8;
    const int mask = (1 << low) - 1;
    for (int i = 0; i + 1 < codes.rows * codes.cols; i += 2) {
        const int first = codes.at<std::uint16_t>(i / codes.cols, i % codes.cols);
        const int second = codes.at<std::uint16_t>((i + 1) / codes.cols, (i + 1) % codes.cols);
        *out++ = static_cast<std::uint8_t>(first >> low);
        *out++ = static_cast<std::uint8_t>((first & mask) | (second & mask) << 4);
        *out++ = static_cast<std::uint8_t>(second >> low);
    }
}

void pack(const cv::Mat& codes, const PixelFormat& format, std::uint8_t* out) {
    if (format.packing == PixelPacking::bit_stream)
        pack_stream(codes, format.bits, out);
    else if (format.packing == PixelPacking::gige_pairs)
        pack_pairs(codes, format.bits, out);
    else
        std::memcpy(out, codes.data, codes.total() * codes.elemSize());
}

guint64 nanoseconds_now() {
    return static_cast<guint64>(g_get_real_time()) * 1000;
}

// The library reads the description from a file, once, while the camera is made.
class DescriptionFile {
public:
    explicit DescriptionFile(const std::string& text) {
        path_ = (std::filesystem::temp_directory_path() / "etalon-gige-XXXXXX").string();
        const int file = mkstemp(path_.data());
        if (file < 0 || write(file, text.data(), text.size()) != ssize_t(text.size()))
            throw DeviceError(device_name, "write its description", std::strerror(errno));
        close(file);
    }
    ~DescriptionFile() { unlink(path_.c_str()); }
    DescriptionFile(const DescriptionFile&) = delete;
    DescriptionFile& operator=(const DescriptionFile&) = delete;

    const char* path() const { return path_.c_str(); }

private:
    std::string path_;
};

}  // namespace

struct GigeCamera::Device {
    GigeCameraOptions options;
    Source source;
    ArvGvFakeCamera* camera = nullptr;

    std::mutex mutex;
    std::condition_variable changed;
    bool frozen = false;
    bool ending = false;
    int lossy_frames = 0, short_frames = 0;  // still to come
    std::chrono::nanoseconds clock_offset{0};
    std::thread latch;

    Device(const GigeCameraOptions& given, Source shown)
        : options(given), source(std::move(shown)) {}
    ~Device() {
        {
            const std::lock_guard lock(mutex);
            ending = true;
        }
        changed.notify_all();
        if (latch.joinable())
            latch.join();
        if (camera)
            g_object_unref(camera);  // joins its thread, which may still be filling a frame
    }
    Device(const Device&) = delete;
    Device& operator=(const Device&) = delete;

    ArvFakeCamera* registers() { return arv_gv_fake_camera_get_fake_camera(camera); }
    void set(guint32 which, int value) {
        arv_fake_camera_write_register(registers(), which, static_cast<guint32>(value));
    }
    void set_loss(double part) { g_object_set(camera, "gvsp-lost-ratio", part, nullptr); }
    guint64 time_ns() { return nanoseconds_now() + static_cast<guint64>(clock_offset.count()); }

    void start();
    void answer_latches();
    void go_through_faults();
    CaptureSettings settings(const cv::Rect& region, const PixelFormat& format, guint32 exposure_us,
                             guint32 gain_db);
    void fill(ArvBuffer* buffer, guint32 exposure_us, guint32 gain_db, ArvPixelFormat format);
};

// On the camera's thread, once for each frame.
void GigeCamera::Device::go_through_faults() {
    std::unique_lock lock(mutex);
    changed.wait(lock, [this] { return !frozen || ending; });
    if (lossy_frames > 0 && --lossy_frames == 0)
        set_loss(options.packet_loss);
    if (short_frames > 0 && --short_frames == 0)
        set(ARV_FAKE_CAMERA_REGISTER_HEIGHT, options.height);
}

CaptureSettings GigeCamera::Device::settings(const cv::Rect& region, const PixelFormat& format,
                                             guint32 exposure_us, guint32 gain_db) {
    guint32 black_level = 0;
    arv_fake_camera_read_register(registers(), black_level_register, &black_level);
    CaptureSettings settings;
    settings.width = region.width;
    settings.height = region.height;
    settings.bits = format.bits;
    settings.format = format.pfnc;
    settings.exposure = std::chrono::microseconds(exposure_us);
    settings.gain_db = gain_db;
    settings.black_level = black_level;
    return settings;
}

void GigeCamera::Device::fill(ArvBuffer* buffer, guint32 exposure_us, guint32 gain_db,
                              ArvPixelFormat code) {
    go_through_faults();
    {
        const std::lock_guard lock(mutex);
        arv_buffer_set_timestamp(buffer, time_ns());
    }
    const cv::Rect region = region_of(buffer);
    const PixelFormat* format = find_pfnc_format(code);
    std::size_t unknown_size = 0;  // reads 0 here; the payload is what the region needs
    void* data = const_cast<void*>(arv_buffer_get_data(buffer, &unknown_size));
    if (format == nullptr || data == nullptr || region.empty())
        return;
    cv::Mat codes(region.height, region.width, format->bits <= 8 ? CV_8UC1 : CV_16UC1);
    copy_region(source(settings(region, *format, exposure_us, gain_db)).pixels, region, codes);
    pack(codes, *format, static_cast<std::uint8_t*>(data));
}

// The fake camera has no hook for commands, so the latch is looked at often. A client that waits
// for the answer sees a clock that was read some milliseconds after it asked.
void GigeCamera::Device::answer_latches() {
    std::unique_lock lock(mutex);
    while (!changed.wait_for(lock, std::chrono::milliseconds(2), [this] { return ending; })) {
        guint32 asked = 0;
        arv_fake_camera_read_register(registers(), latch_register, &asked);
        if (asked == 0)
            continue;
        const guint64 big_endian = GUINT64_TO_BE(time_ns());
        set(latch_register, 0);
        arv_fake_camera_write_memory(registers(), latched_time_register, sizeof big_endian,
                                     &big_endian);
    }
}

void GigeCamera::Device::start() {
    const DescriptionFile description(gige_description(options.formats, options.latches));
    camera = arv_gv_fake_camera_new_full(address, options.serial.c_str(), description.path());
    if (!arv_gv_fake_camera_is_running(camera))
        throw DeviceError(device_name, "listen", "the fake camera did not start");
    set(ARV_FAKE_CAMERA_REGISTER_SENSOR_WIDTH, options.width);
    set(ARV_FAKE_CAMERA_REGISTER_SENSOR_HEIGHT, options.height);
    set(ARV_FAKE_CAMERA_REGISTER_WIDTH, options.width);
    set(ARV_FAKE_CAMERA_REGISTER_HEIGHT, options.height);
    set(ARV_FAKE_CAMERA_REGISTER_PIXEL_FORMAT,
        options.bits <= 8 ? ARV_PIXEL_FORMAT_MONO_8 : ARV_PIXEL_FORMAT_MONO_16);
    // Ours is elsewhere; the fake camera's own stays at "by software", also for Line1.
    set(ARV_FAKE_CAMERA_REGISTER_TRIGGER_SOURCE, 1);
    arv_fake_camera_set_trigger_frequency(registers(), trigger_poll_hz);
    arv_fake_camera_set_fill_pattern(
        registers(),
        [](ArvBuffer* buffer, void* device, guint32 exposure_us, guint32 gain_db,
           ArvPixelFormat format) {
            static_cast<Device*>(device)->fill(buffer, exposure_us, gain_db, format);
        },
        this);
    set_loss(options.packet_loss);
    if (options.latches)
        latch = std::thread([this] { answer_latches(); });
}

GigeCamera::GigeCamera(const GigeCameraOptions& options, Source source)
    : device_(std::make_unique<Device>(options, std::move(source))) {
    require_usable(options);
    require_free_port();
    device_->start();
}

GigeCamera::~GigeCamera() = default;

void GigeCamera::pulse_line() {
    device_->set(ARV_FAKE_CAMERA_REGISTER_TRIGGER_SOFTWARE, 1);
}

void GigeCamera::change_size_unasked(int width, int height) {
    device_->set(ARV_FAKE_CAMERA_REGISTER_WIDTH, width);
    device_->set(ARV_FAKE_CAMERA_REGISTER_HEIGHT, height);
}

void GigeCamera::lose_packets(double part, int frames) {
    const std::lock_guard lock(device_->mutex);
    device_->set_loss(part);
    device_->lossy_frames = frames + 1;  // counted down before each frame
}

void GigeCamera::cut_short(int frames) {
    const std::lock_guard lock(device_->mutex);
    device_->set(ARV_FAKE_CAMERA_REGISTER_HEIGHT, device_->options.height - 1);
    device_->short_frames = frames;
}

void GigeCamera::freeze() {
    const std::lock_guard lock(device_->mutex);
    device_->frozen = true;
}

void GigeCamera::thaw() {
    {
        const std::lock_guard lock(device_->mutex);
        device_->frozen = false;
    }
    device_->changed.notify_all();
}

void GigeCamera::jump_clock(std::chrono::nanoseconds by) {
    const std::lock_guard lock(device_->mutex);
    device_->clock_offset += by;
}

}  // namespace etalon
