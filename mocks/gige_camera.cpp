#include "mocks/gige_camera.h"

#include <arpa/inet.h>
#include <arv.h>
#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "core/errors.h"

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

// Called by Aravis for each frame.
void fill_frame(ArvBuffer* buffer, void* user_data, guint32 exposure_us, guint32 gain_db,
                ArvPixelFormat format) noexcept {
    const auto& source = *static_cast<GigeCamera::Source*>(user_data);
    const cv::Rect region = region_of(buffer);
    const int bytes = format == ARV_PIXEL_FORMAT_MONO_8    ? 1
                      : format == ARV_PIXEL_FORMAT_MONO_16 ? 2
                                                           : 0;
    std::size_t size = 0;
    void* data = const_cast<void*>(arv_buffer_get_data(buffer, &size));
    if (bytes == 0 || data == nullptr || region.empty())
        return;
    CaptureSettings settings;
    settings.width = region.width;
    settings.height = region.height;
    settings.bits = 8 * bytes;
    settings.exposure = std::chrono::microseconds(exposure_us);
    settings.gain_db = gain_db;
    cv::Mat out(region.height, region.width, bytes == 1 ? CV_8UC1 : CV_16UC1, data);
    copy_region(source(settings).pixels, region, out);
}

}  // namespace

struct GigeCamera::Device {
    Source source;
    ArvGvFakeCamera* camera = nullptr;

    explicit Device(Source given) : source(std::move(given)) {}
    ~Device() { g_clear_object(&camera); }  // joins its thread
    Device(const Device&) = delete;
    Device& operator=(const Device&) = delete;

    void set(guint32 which, int value) {
        arv_fake_camera_write_register(arv_gv_fake_camera_get_fake_camera(camera), which,
                                       static_cast<guint32>(value));
    }
};

GigeCamera::GigeCamera(const GigeCameraOptions& options, Source source)
    : device_(std::make_unique<Device>(std::move(source))) {
    require_usable(options);
    require_free_port();
    device_->camera = arv_gv_fake_camera_new_full(address, options.serial.c_str(), nullptr);
    if (!arv_gv_fake_camera_is_running(device_->camera))
        throw DeviceError(device_name, "listen", "the fake camera did not start");
    device_->set(ARV_FAKE_CAMERA_REGISTER_SENSOR_WIDTH, options.width);
    device_->set(ARV_FAKE_CAMERA_REGISTER_SENSOR_HEIGHT, options.height);
    device_->set(ARV_FAKE_CAMERA_REGISTER_WIDTH, options.width);
    device_->set(ARV_FAKE_CAMERA_REGISTER_HEIGHT, options.height);
    device_->set(ARV_FAKE_CAMERA_REGISTER_PIXEL_FORMAT,
                 options.bits <= 8 ? ARV_PIXEL_FORMAT_MONO_8 : ARV_PIXEL_FORMAT_MONO_16);
    ArvFakeCamera* camera = arv_gv_fake_camera_get_fake_camera(device_->camera);
    arv_fake_camera_set_trigger_frequency(camera, trigger_poll_hz);
    arv_fake_camera_set_fill_pattern(camera, fill_frame, &device_->source);
    g_object_set(device_->camera, "gvsp-lost-ratio", options.packet_loss, nullptr);
}

GigeCamera::~GigeCamera() = default;

void GigeCamera::change_size_unasked(int width, int height) {
    device_->set(ARV_FAKE_CAMERA_REGISTER_WIDTH, width);
    device_->set(ARV_FAKE_CAMERA_REGISTER_HEIGHT, height);
}

}  // namespace etalon
