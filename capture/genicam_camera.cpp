#include "capture/genicam_camera.h"

#include <arv.h>
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <optional>
#include <system_error>
#include <thread>
#include <type_traits>
#include <utility>

#include "capture/frame_checks.h"
#include "capture/genicam_support.h"
#include "core/errors.h"

namespace etalon {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

// Without these a 1.3-megapixel camera at 50 Hz delivers nothing on loopback (measured).
constexpr int receive_buffer_bytes = 4 << 20;
constexpr microseconds packet_timeout = milliseconds(20);    // then a packet is asked for again
constexpr microseconds frame_retention = milliseconds(200);  // then a frame is given up
constexpr int buffers = 4;
constexpr int warm_up_triggers = 3;      // a trigger right after arming may be lost
constexpr milliseconds look_around{20};  // while waiting: how often a stop or a loss is noticed

struct Unref {
    void operator()(gpointer object) const { g_object_unref(object); }
};
using CameraHandle = std::unique_ptr<ArvCamera, Unref>;
using StreamHandle = std::unique_ptr<ArvStream, Unref>;
using BufferHandle = std::unique_ptr<ArvBuffer, Unref>;

class ErrorSlot {
public:
    ErrorSlot() = default;
    ~ErrorSlot() { g_clear_error(&error_); }
    ErrorSlot(const ErrorSlot&) = delete;
    ErrorSlot& operator=(const ErrorSlot&) = delete;

    GError** out() { return &error_; }
    explicit operator bool() const { return error_ != nullptr; }
    std::string message() const { return error_ ? error_->message : ""; }

private:
    GError* error_ = nullptr;
};

std::string text_or_empty(const char* text) {
    return text ? text : "";
}

// The control-lost signal comes on the library's heartbeat thread, where nothing but a flag may be
// touched. The flag is shared, since that thread may outlive the camera object.
using LostFlag = std::shared_ptr<std::atomic<bool>>;

void control_lost(ArvDevice*, const LostFlag* lost) {
    **lost = true;
}

void drop_flag(gpointer flag, GClosure*) {
    delete static_cast<LostFlag*>(flag);
}

void watch_control(ArvDevice* device, const LostFlag& lost) {
    g_signal_connect_data(device, "control-lost", G_CALLBACK(control_lost), new LostFlag(lost),
                          drop_flag, GConnectFlags(0));
}

// Lets go of a device that no longer answers. The library's clean-up asks it once more, for 2.5 s
// each time, which nobody should have to wait for.
template <typename Handle>
void release_in_background(Handle handle) noexcept {
    try {
        std::thread([object = std::move(handle)]() mutable { object.reset(); }).detach();
    } catch (const std::system_error&) {
        // No thread to be had: the handle's own destructor has waited instead.
    }
}

class GenicamCamera final : public Camera {
public:
    GenicamCamera(const std::string& id, const CameraLink& link, Clock& clock);
    ~GenicamCamera() override;
    GenicamCamera(const GenicamCamera&) = delete;
    GenicamCamera& operator=(const GenicamCamera&) = delete;

    const CameraIdentity& identity() const override { return identity_; }
    CaptureSettings configure(const CaptureSettings& wanted) override;
    void arm() override;
    Frame frame_after(Instant t, int retries, std::stop_token stop) override;
    void disarm() noexcept override;
    CaptureStatistics statistics() const override;
    std::vector<std::string> remarks() const override { return remarks_; }

private:
    // Carries out one call of the library; its GError becomes a DeviceError that names the request.
    template <typename Call>
    auto ask(const std::string& request, Call call) const;
    [[noreturn]] void fail(const std::string& request, const std::string& cause) const;
    void require_alive(const std::string& request) const;

    void open(const std::string& id);
    void read_identity();
    void set_up_transport();

    void switch_automatics_off();
    void apply_image_format(const CaptureSettings& wanted);
    void apply_exposure(microseconds exposure);
    void apply_gain(double gain_db);
    void apply_software_trigger();
    CaptureSettings read_back() const;
    double exposure_step_us() const;

    void start_stream();
    void set_stream_properties();
    void discard_warm_up_frame();
    void stop_stream() noexcept;

    Frame triggered_frame(Instant t, std::stop_token stop);
    void discard_stale_frames();
    void trigger();
    BufferHandle next_buffer(Instant deadline, std::stop_token stop);
    void give_back(BufferHandle buffer);
    bool is_newer(ArvBuffer* buffer);
    Frame judged(ArvBuffer* buffer) const;
    std::string size_fault(ArvBuffer* buffer) const;
    CodeImage image_of(ArvBuffer* buffer) const;
    long missing_packets_now() const;

    CameraLink link_;
    Clock& clock_;
    CameraIdentity identity_;
    std::string name_;  // for errors
    std::vector<std::string> remarks_;

    CameraHandle camera_;
    StreamHandle stream_;
    LostFlag lost_ = std::make_shared<std::atomic<bool>>(false);

    bool configured_ = false;
    CaptureSettings settings_;
    std::size_t payload_ = 0;
    std::optional<std::uint64_t> last_id_;
    bool answer_outstanding_ = false;  // a trigger was sent whose frame never came
    CaptureStatistics statistics_;
};

// ---- calls ---------------------------------------------------------------------------------

template <typename Call>
auto GenicamCamera::ask(const std::string& request, Call call) const {
    ErrorSlot error;
    if constexpr (std::is_void_v<decltype(call(error.out()))>) {
        call(error.out());
        if (error)
            fail(request, error.message());
    } else {
        const auto result = call(error.out());
        if (error)
            fail(request, error.message());
        return result;
    }
}

void GenicamCamera::fail(const std::string& request, const std::string& cause) const {
    throw DeviceError(name_, request, cause);
}

void GenicamCamera::require_alive(const std::string& request) const {
    if (*lost_)
        fail(request, "the camera is lost: it no longer answers");
}

// ---- opening -------------------------------------------------------------------------------

GenicamCamera::GenicamCamera(const std::string& id, const CameraLink& link, Clock& clock)
    : link_(link), clock_(clock), name_("camera genicam:" + id) {
    identity_.uri = "genicam:" + id;
    open(id);
    read_identity();
    set_up_transport();
}

void GenicamCamera::open(const std::string& id) {
    camera_.reset(ask("open", [&](GError** e) { return arv_camera_new(id.c_str(), e); }));
    if (!camera_)
        fail("open", "no such device");
    ArvDevice* device = arv_camera_get_device(camera_.get());
    if (arv_camera_is_gv_device(camera_.get()) &&
        !arv_gv_device_is_controller(ARV_GV_DEVICE(device)))
        fail("open", "it is controlled by another program");
    watch_control(device, lost_);
}

void GenicamCamera::read_identity() {
    const auto text = [&](auto getter) {
        ErrorSlot ignored;  // not every device says all of these
        return text_or_empty(getter(camera_.get(), ignored.out()));
    };
    identity_.vendor = text(arv_camera_get_vendor_name);
    identity_.model = text(arv_camera_get_model_name);
    identity_.serial = text(arv_camera_get_device_serial_number);
    if (identity_.serial.empty())
        identity_.serial = text(arv_camera_get_device_id);
}

void GenicamCamera::set_up_transport() {
    ArvCamera* camera = camera_.get();
    arv_camera_set_range_check_policy(camera, ARV_RANGE_CHECK_POLICY_ENABLE);
    if (!arv_camera_is_gv_device(camera))
        return;
    arv_camera_gv_set_stream_options(camera, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
    arv_camera_gv_set_packet_size_adjustment(camera, ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
    const std::string request = fmt::format("set packet size {}", link_.packet_size);
    ask(request, [&](GError** e) { arv_camera_gv_set_packet_size(camera, link_.packet_size, e); });
    const guint size =
        ask(request, [&](GError** e) { return arv_camera_gv_get_packet_size(camera, e); });
    if (static_cast<int>(size) != link_.packet_size)
        fail(request, fmt::format("the device uses {}", size));
    const int granted = granted_receive_buffer(receive_buffer_bytes);
    if (granted < receive_buffer_bytes)
        remarks_.push_back(
            fmt::format("the kernel grants a receive buffer of {} bytes, {} were asked for "
                        "(net.core.rmem_max): large frames may lose packets",
                        granted, receive_buffer_bytes));
}

GenicamCamera::~GenicamCamera() {
    disarm();
    if (*lost_)
        release_in_background(std::move(camera_));
}

// ---- settings ------------------------------------------------------------------------------

CaptureSettings GenicamCamera::configure(const CaptureSettings& wanted) {
    require_alive("configure");
    if (stream_)
        fail("configure", "the camera is armed");
    if (wanted.bits < 1 || wanted.bits > 16)
        fail("configure", fmt::format("{} bits a pixel: only 1 to 16 are possible", wanted.bits));
    configured_ = false;
    switch_automatics_off();
    apply_image_format(wanted);
    apply_exposure(wanted.exposure);
    apply_gain(wanted.gain_db);
    apply_software_trigger();
    settings_ = read_back();
    settings_.bits = wanted.bits;  // the format's container was compared
    if (const auto difference = first_difference(wanted, settings_, exposure_step_us()))
        fail(difference->request, difference->cause);
    payload_ = ask("read payload size",
                   [&](GError** e) { return arv_camera_get_payload(camera_.get(), e); });
    configured_ = true;
    return settings_;
}

void GenicamCamera::switch_automatics_off() {
    ArvCamera* camera = camera_.get();
    const auto available = [&](auto query) {
        ErrorSlot ignored;  // a device without the feature answers with an error or FALSE
        return query(camera, ignored.out()) && !ignored;
    };
    if (available(arv_camera_is_exposure_auto_available))
        ask("switch automatic exposure off",
            [&](GError** e) { arv_camera_set_exposure_time_auto(camera, ARV_AUTO_OFF, e); });
    if (available(arv_camera_is_gain_auto_available))
        ask("switch automatic gain off",
            [&](GError** e) { arv_camera_set_gain_auto(camera, ARV_AUTO_OFF, e); });
    if (available(arv_camera_is_black_level_auto_available))
        ask("switch automatic black level off",
            [&](GError** e) { arv_camera_set_black_level_auto(camera, ARV_AUTO_OFF, e); });
    // Chunks would be appended to the image and change its size.
    if (available(arv_camera_are_chunks_available))
        ask("switch chunk data off",
            [&](GError** e) { arv_camera_set_chunk_mode(camera, FALSE, e); });
}

void GenicamCamera::apply_image_format(const CaptureSettings& wanted) {
    ArvCamera* camera = camera_.get();
    const bool one_byte = wanted.bits <= 8;
    const ArvPixelFormat format = one_byte ? ARV_PIXEL_FORMAT_MONO_8 : ARV_PIXEL_FORMAT_MONO_16;
    const std::string request = fmt::format("set pixel format {}", one_byte ? "Mono8" : "Mono16");
    ask(request, [&](GError** e) { arv_camera_set_pixel_format(camera, format, e); });
    if (ask(request, [&](GError** e) { return arv_camera_get_pixel_format(camera, e); }) != format)
        fail(request, "the device keeps another format");
    // A negative offset and a size of 0 leave what the device has: moving the region would move the
    // principal point that the calibration holds for.
    ask(fmt::format("set image size {}x{}", wanted.width, wanted.height),
        [&](GError** e) { arv_camera_set_region(camera, -1, -1, wanted.width, wanted.height, e); });
}

void GenicamCamera::apply_exposure(microseconds exposure) {
    if (exposure.count() == 0)
        return;
    ask(fmt::format("set exposure {} us", exposure.count()), [&](GError** e) {
        arv_camera_set_exposure_time(camera_.get(), static_cast<double>(exposure.count()), e);
    });
}

void GenicamCamera::apply_gain(double gain_db) {
    ErrorSlot ignored;
    if (!arv_camera_is_gain_available(camera_.get(), ignored.out()) || ignored)
        return;  // read_back() then says 0 dB, and any other wish is refused
    ask(fmt::format("set gain {} dB", gain_db),
        [&](GError** e) { arv_camera_set_gain(camera_.get(), gain_db, e); });
}

void GenicamCamera::apply_software_trigger() {
    ArvCamera* camera = camera_.get();
    ask("set acquisition mode", [&](GError** e) {
        arv_camera_set_acquisition_mode(camera, ARV_ACQUISITION_MODE_CONTINUOUS, e);
    });
    ask("set software trigger", [&](GError** e) { arv_camera_set_trigger(camera, "Software", e); });
    const char* source = ask("read trigger source",
                             [&](GError** e) { return arv_camera_get_trigger_source(camera, e); });
    if (text_or_empty(source) != "Software")
        fail("set software trigger", "the device keeps the source " + text_or_empty(source));
}

CaptureSettings GenicamCamera::read_back() const {
    ArvCamera* camera = camera_.get();
    CaptureSettings actual;
    int x = 0, y = 0;
    ask("read image size", [&](GError** e) {
        arv_camera_get_region(camera, &x, &y, &actual.width, &actual.height, e);
    });
    const double exposure_us =
        ask("read exposure", [&](GError** e) { return arv_camera_get_exposure_time(camera, e); });
    actual.exposure = microseconds(std::llround(exposure_us));
    ErrorSlot ignored;
    if (arv_camera_is_gain_available(camera, ignored.out()) && !ignored)
        actual.gain_db =
            ask("read gain", [&](GError** e) { return arv_camera_get_gain(camera, e); });
    return actual;
}

// The device's own step of the exposure time, and at least our own resolution.
double GenicamCamera::exposure_step_us() const {
    for (const char* feature : {"ExposureTime", "ExposureTimeAbs"}) {
        ErrorSlot missing;
        const double step = arv_camera_get_float_increment(camera_.get(), feature, missing.out());
        if (!missing && std::isfinite(step))
            return std::max(step, 0.5);
    }
    return 0.5;
}

// ---- stream --------------------------------------------------------------------------------

void GenicamCamera::arm() {
    require_alive("arm");
    if (!configured_)
        fail("arm", "the camera is not configured");
    if (stream_)
        return;
    try {
        start_stream();
        discard_warm_up_frame();
    } catch (const Error&) {
        stop_stream();
        throw;
    }
}

void GenicamCamera::start_stream() {
    stream_.reset(ask("create stream", [&](GError** e) {
        return arv_camera_create_stream(camera_.get(), nullptr, nullptr, e);
    }));
    if (!stream_)
        fail("create stream", "the library gave none");
    set_stream_properties();
    for (int i = 0; i < buffers; ++i)
        arv_stream_push_buffer(stream_.get(), arv_buffer_new_allocate(payload_));
    last_id_.reset();
    answer_outstanding_ = false;
    ask("start acquisition", [&](GError** e) { arv_camera_start_acquisition(camera_.get(), e); });
}

void GenicamCamera::set_stream_properties() {
    if (!ARV_IS_GV_STREAM(stream_.get()))
        return;
    g_object_set(stream_.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED,
                 "socket-buffer-size", static_cast<gint>(receive_buffer_bytes), "packet-timeout",
                 static_cast<guint>(packet_timeout.count()), "frame-retention",
                 static_cast<guint>(frame_retention.count()), nullptr);
}

void GenicamCamera::discard_warm_up_frame() {
    for (int attempt = 0; attempt < warm_up_triggers; ++attempt) {
        trigger();
        if (BufferHandle buffer = next_buffer(clock_.now() + link_.frame_timeout, {})) {
            last_id_ = arv_buffer_get_frame_id(buffer.get());
            give_back(std::move(buffer));
            answer_outstanding_ = attempt > 0;
            return;
        }
    }
    fail("take a first frame", fmt::format("none came after {} triggers of {} ms each",
                                           warm_up_triggers, link_.frame_timeout.count()));
}

void GenicamCamera::disarm() noexcept {
    stop_stream();
}

void GenicamCamera::stop_stream() noexcept {
    if (!stream_)
        return;
    statistics_.missing_packets += missing_packets_now();
    if (!*lost_) {
        ErrorSlot error;
        arv_camera_stop_acquisition(camera_.get(), error.out());
        *lost_ = static_cast<bool>(error);
    }
    if (*lost_)
        release_in_background(std::move(stream_));
    stream_.reset();
}

long GenicamCamera::missing_packets_now() const {
    if (!stream_ || !ARV_IS_GV_STREAM(stream_.get()))
        return 0;
    guint64 resent = 0, missing = 0;
    arv_gv_stream_get_statistics(ARV_GV_STREAM(stream_.get()), &resent, &missing);
    return static_cast<long>(missing);
}

CaptureStatistics GenicamCamera::statistics() const {
    CaptureStatistics now = statistics_;
    now.missing_packets += missing_packets_now();
    return now;
}

// ---- frames --------------------------------------------------------------------------------

Frame GenicamCamera::frame_after(Instant t, int retries, std::stop_token stop) {
    if (!stream_)
        fail("take a frame", "the camera is not armed");
    Frame frame;
    for (int attempt = 0; attempt <= retries; ++attempt) {
        frame = triggered_frame(t, stop);
        if (frame.status == FrameStatus::complete) {
            ++statistics_.delivered;
            return frame;
        }
        ++statistics_.rejected;
    }
    return frame;
}

Frame GenicamCamera::triggered_frame(Instant t, std::stop_token stop) {
    require_alive("take a frame");
    // The answer to an old trigger may still come and would pass for the new one's. Only a new
    // stream, on a port of its own, is sure to be without it.
    if (answer_outstanding_) {
        disarm();
        arm();
    }
    wait_until_after(clock_, t, stop);
    discard_stale_frames();
    const Instant sent = clock_.now();
    trigger();
    const Instant deadline = clock_.now() + link_.frame_timeout;
    while (BufferHandle buffer = next_buffer(deadline, stop)) {
        if (is_newer(buffer.get())) {
            Frame frame = judged(buffer.get());
            frame.exposure_start_uncertainty = (clock_.now() - sent) / 2;
            frame.exposure_start = sent + frame.exposure_start_uncertainty;
            give_back(std::move(buffer));
            return frame;
        }
        ++statistics_.rejected;
        give_back(std::move(buffer));
    }
    answer_outstanding_ = true;
    Frame frame;
    frame.status_detail = fmt::format("no frame within {} ms", link_.frame_timeout.count());
    return frame;
}

void GenicamCamera::discard_stale_frames() {
    while (BufferHandle buffer{arv_stream_try_pop_buffer(stream_.get())}) {
        is_newer(buffer.get());
        give_back(std::move(buffer));
        ++statistics_.rejected;
    }
}

void GenicamCamera::trigger() {
    ErrorSlot error;
    arv_camera_software_trigger(camera_.get(), error.out());
    if (!error)
        return;
    *lost_ = true;
    fail("trigger", error.message());
}

// The next buffer that the stream has done with; nothing at the deadline.
BufferHandle GenicamCamera::next_buffer(Instant deadline, std::stop_token stop) {
    const auto slice = static_cast<guint64>(microseconds(look_around).count());
    do {
        if (stop.stop_requested())
            throw Interrupted();
        require_alive("wait for a frame");
        if (BufferHandle buffer{arv_stream_timeout_pop_buffer(stream_.get(), slice)})
            return buffer;
    } while (clock_.now() < deadline);
    return nullptr;
}

void GenicamCamera::give_back(BufferHandle buffer) {
    arv_stream_push_buffer(stream_.get(), buffer.release());
}

// Whether the buffer's frame comes after all seen before; remembers it if so.
bool GenicamCamera::is_newer(ArvBuffer* buffer) {
    const std::uint64_t id = arv_buffer_get_frame_id(buffer);
    const bool newer = !last_id_ || frame_id_advanced(*last_id_, id);
    if (newer)
        last_id_ = id;
    return newer;
}

Frame GenicamCamera::judged(ArvBuffer* buffer) const {
    Frame frame;
    frame.id = arv_buffer_get_frame_id(buffer);
    frame.settings = settings_;
    const ArvBufferStatus status = arv_buffer_get_status(buffer);
    frame.status = genicam_frame_status(status);
    frame.status_detail = describe_buffer_status(status);
    if (frame.status != FrameStatus::complete)
        return frame;
    if (const std::string fault = size_fault(buffer); !fault.empty()) {
        frame.status = FrameStatus::short_frame;
        frame.status_detail = fault;
        return frame;
    }
    frame.image = image_of(buffer);
    if (exceeds_full_scale(frame.image))
        fail("take a frame", fmt::format("a code is above {}: the device does not send {} bits in "
                                         "the low bits of a pixel",
                                         frame.image.full_scale(), settings_.bits));
    return frame;
}

// What is wrong with the size of a frame that the library calls good; empty if nothing.
std::string GenicamCamera::size_fault(ArvBuffer* buffer) const {
    if (arv_buffer_get_payload_type(buffer) != ARV_BUFFER_PAYLOAD_TYPE_IMAGE)
        return "not an image payload";
    std::size_t received = 0;
    arv_buffer_get_data(buffer, &received);
    const int width = arv_buffer_get_image_width(buffer);
    const int height = arv_buffer_get_image_height(buffer);
    const ArvPixelFormat format = arv_buffer_get_image_pixel_format(buffer);
    const ArvPixelFormat expected =
        settings_.bits <= 8 ? ARV_PIXEL_FORMAT_MONO_8 : ARV_PIXEL_FORMAT_MONO_16;
    if (width != settings_.width || height != settings_.height || format != expected)
        return fmt::format("frame of {}x{} in format {:#x}, expected {}x{} in {:#x}", width, height,
                           format, settings_.width, settings_.height, expected);
    const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    const std::size_t needed = pixels * (settings_.bits <= 8 ? 1 : 2);
    if (received != payload_ || received < needed)
        return fmt::format("{} bytes received, payload {}, image {}", received, payload_, needed);
    return "";
}

// Mono16 is little-endian on the wire, as this machine is (GigE Vision 1.2, 2.12).
CodeImage GenicamCamera::image_of(ArvBuffer* buffer) const {
    std::size_t size = 0;
    const void* data = arv_buffer_get_data(buffer, &size);
    CodeImage image{
        cv::Mat(settings_.height, settings_.width, settings_.bits <= 8 ? CV_8UC1 : CV_16UC1),
        settings_.bits};
    std::memcpy(image.pixels.data, data, image.pixels.total() * image.pixels.elemSize());
    return image;
}

}  // namespace

std::unique_ptr<Camera> open_genicam_camera(const std::string& id, const CameraLink& link,
                                            Clock& clock) {
    return std::make_unique<GenicamCamera>(id, link, clock);
}

}  // namespace etalon
