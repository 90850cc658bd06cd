#include "capture/genicam/genicam_device.h"

#include <arv.h>
#include <fmt/format.h>
#include <sys/socket.h>

#include <cmath>

#include "capture/frame/frame_checks.h"
#include "capture/genicam/genicam_camera.h"
#include "core/file/file_descriptor.h"

namespace etalon {
namespace {

using LostFlag = std::shared_ptr<std::atomic<bool>>;

using Address = std::unique_ptr<GInetAddress, UnrefObject>;

// On the library's heartbeat thread, where nothing but a flag may be touched.
void control_lost(ArvDevice*, const LostFlag* lost) {
    **lost = true;
}

void drop_flag(gpointer flag, GClosure*) {
    delete static_cast<LostFlag*>(flag);
}

}  // namespace

std::string text_or_empty(const char* text) {
    return text ? printable(text) : "";
}

ErrorSlot::~ErrorSlot() {
    g_clear_error(&error_);
}

std::string ErrorSlot::message() const {
    return error_ ? error_->message : "";
}

bool ErrorSlot::is_silence() const {
    for (const int code : {ARV_DEVICE_ERROR_TIMEOUT, ARV_DEVICE_ERROR_NOT_CONNECTED,
                           ARV_DEVICE_ERROR_NOT_CONTROLLER, ARV_DEVICE_ERROR_TRANSFER_ERROR})
        if (error_ && g_error_matches(error_, ARV_DEVICE_ERROR, code))
            return true;
    return false;
}

void UnrefObject::operator()(void* object) const {
    g_object_unref(object);
}

void release_in_background(std::shared_ptr<void> object) noexcept {
    run_bounded([held = std::move(object)]() mutable { held.reset(); }, Duration(0));
}

GenicamDevice::GenicamDevice(const std::string& id, const CameraLink& link)
    : name_("camera genicam:" + id) {
    open(id, link);
    watch_control();
    end_stream_of_another();
    read_identity(id);
    set_up_transport(link);
}

GenicamDevice::~GenicamDevice() {
    if (lost())
        release_in_background(std::move(camera_));
}

void GenicamDevice::fail(const std::string& request, const std::string& cause) const {
    throw DeviceError(name_, request, cause);
}

void GenicamDevice::require_answer(const std::string& request, const ErrorSlot& error) const {
    if (!error)
        return;
    if (!error.is_silence())
        fail(request, error.message());
    *lost_ = true;
    fail(request, "the camera is lost: " + error.message());
}

bool GenicamDevice::has(const char* feature) const {
    return says_yes(
        [&](GError** e) { return arv_camera_is_feature_available(camera(), feature, e); });
}

void GenicamDevice::open(const std::string& id, const CameraLink& link) {
    const std::unique_ptr<ArvDevice, UnrefObject> device(ask("open", [&](GError** e) {
        if (link.interface.empty())
            return arv_open_device(id.c_str(), e);
        const Address card(g_inet_address_new_from_string(link.interface.c_str()));
        const Address address(g_inet_address_new_from_string(id.c_str()));
        if (!card || !address)
            fail("open", fmt::format("through the network card {} it can only be opened by its IP "
                                     "address",
                                     link.interface));
        return arv_gv_device_new(card.get(), address.get(), e);
    }));
    if (!device)
        fail("open", "no such device");
    check_description(device.get());
    camera_.reset(
        ask("open", [&](GError** e) { return arv_camera_new_with_device(device.get(), e); }));
    if (!camera_)
        fail("open", "no such device");
    if (arv_camera_is_gv_device(camera()) &&
        !arv_gv_device_is_controller(ARV_GV_DEVICE(arv_camera_get_device(camera()))))
        throw CameraBusy(name_, heartbeat_timeout());
}

// Before anything is asked by name.
void GenicamDevice::check_description(ArvDevice* device) const {
    std::size_t size = 0;
    const char* xml = arv_device_get_genicam_xml(device, &size);
    try {
        require_sound_description(xml ? std::string(xml, size) : "");
    } catch (const Error& error) {
        fail("read its description", error.what());
    }
}

// 3 s is the standard's default; anybody may read the register.
std::chrono::milliseconds GenicamDevice::heartbeat_timeout() const {
    constexpr guint64 heartbeat_register = 0x0938;
    ErrorSlot error;
    guint32 ms = 0;
    const bool known = arv_device_read_register(arv_camera_get_device(camera()), heartbeat_register,
                                                &ms, error.out());
    return std::chrono::milliseconds(known && ms > 0 ? ms : 3000);
}

// A killed program leaves its stream running, which would go on and send nothing to us.
void GenicamDevice::end_stream_of_another() {
    ErrorSlot ignored;  // a device that streams to nobody may refuse
    arv_camera_stop_acquisition(camera(), ignored.out());
}

// The heartbeat thread of a GigE device is asked, not listened to: while it emits a signal it holds
// the device, and if everyone else lets go meanwhile, it would have to wait for its own end.
void GenicamDevice::watch_control() {
    if (arv_camera_is_gv_device(camera()))
        return;
    g_signal_connect_data(arv_camera_get_device(camera()), "control-lost", G_CALLBACK(control_lost),
                          new LostFlag(lost_), drop_flag, GConnectFlags(0));
}

bool GenicamDevice::lost() const {
    return *lost_ || (arv_camera_is_gv_device(camera()) &&
                      !arv_gv_device_is_controller(ARV_GV_DEVICE(arv_camera_get_device(camera()))));
}

void GenicamDevice::read_identity(const std::string& id) {
    const auto text = [&](auto getter) {
        ErrorSlot unknown;  // not every device says all of these; what was not read has no end
        const char* said = getter(camera(), unknown.out());
        return unknown ? "" : text_or_empty(said);
    };
    identity_.uri = "genicam:" + id;
    identity_.vendor = text(arv_camera_get_vendor_name);
    identity_.model = text(arv_camera_get_model_name);
    identity_.serial = text(arv_camera_get_device_serial_number);
    if (identity_.serial.empty())
        identity_.serial = text(arv_camera_get_device_id);
}

void GenicamDevice::set_up_transport(const CameraLink& link) {
    arv_camera_set_range_check_policy(camera(), ARV_RANGE_CHECK_POLICY_ENABLE);
    if (!arv_camera_is_gv_device(camera()))
        return;
    arv_camera_gv_set_stream_options(camera(), ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
    arv_camera_gv_set_packet_size_adjustment(camera(), ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
    set_packets(link);
    const int granted = granted_receive_buffer(receive_buffer_bytes);
    if (granted < receive_buffer_bytes)
        remarks_.push_back(
            fmt::format("the kernel grants a receive buffer of {} bytes, {} were asked for "
                        "(net.core.rmem_max): large frames may lose packets",
                        granted, receive_buffer_bytes));
}

void GenicamDevice::set_packets(const CameraLink& link) {
    const std::string request = fmt::format("set packet size {}", link.packet_size);
    call(request, arv_camera_gv_set_packet_size, link.packet_size);
    const guint size = call(request, arv_camera_gv_get_packet_size);
    if (static_cast<int>(size) != link.packet_size)
        fail(request, fmt::format("the device uses {}", size));
    if (link.packet_delay.count() == 0)
        return;
    const std::string delay = fmt::format("set packet delay {} us", link.packet_delay.count());
    const gint64 asked_ns = std::chrono::nanoseconds(link.packet_delay).count();
    call(delay, arv_camera_gv_set_packet_delay, asked_ns);
    const gint64 actual_ns = call(delay, arv_camera_gv_get_packet_delay);
    if (std::abs(actual_ns - asked_ns) > 1000)  // clocks of cameras tick within a microsecond
        fail(delay, fmt::format("the device uses {} ns", actual_ns));
}

// The kernel counts its own bookkeeping in, so it reports twice what it was asked (socket(7)).
int granted_receive_buffer(int asked) {
    const FileDescriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    int size = asked;
    socklen_t length = sizeof size;
    const bool known = setsockopt(socket.get(), SOL_SOCKET, SO_RCVBUF, &size, length) == 0 &&
                       getsockopt(socket.get(), SOL_SOCKET, SO_RCVBUF, &size, &length) == 0;
    return known ? size / 2 : asked;
}

BufferVerdict verdict_of_buffer(int status) {
    constexpr std::pair<int, BufferVerdict> verdicts[] = {
        {ARV_BUFFER_STATUS_SUCCESS, {FrameStatus::complete, "success"}},
        {ARV_BUFFER_STATUS_CLEARED, {FrameStatus::lost, "buffer cleared"}},
        {ARV_BUFFER_STATUS_TIMEOUT, {FrameStatus::corrupt, "packets timed out"}},
        {ARV_BUFFER_STATUS_MISSING_PACKETS, {FrameStatus::corrupt, "missing packets"}},
        {ARV_BUFFER_STATUS_WRONG_PACKET_ID, {FrameStatus::corrupt, "wrong packet id"}},
        {ARV_BUFFER_STATUS_SIZE_MISMATCH, {FrameStatus::short_frame, "size mismatch"}},
        {ARV_BUFFER_STATUS_FILLING, {FrameStatus::lost, "still filling"}},
        {ARV_BUFFER_STATUS_ABORTED, {FrameStatus::lost, "aborted"}}};
    for (const auto& [known, verdict] : verdicts)
        if (status == known)
            return verdict;
    return {FrameStatus::lost, "unknown status"};
}

std::vector<CameraIdentity> list_genicam_cameras() {
    arv_update_device_list();
    std::vector<CameraIdentity> found;
    for (unsigned i = 0; i < arv_get_n_devices(); ++i)
        found.push_back({"genicam:" + text_or_empty(arv_get_device_id(i)),
                         text_or_empty(arv_get_device_vendor(i)),
                         text_or_empty(arv_get_device_model(i)),
                         text_or_empty(arv_get_device_serial_nbr(i))});
    return found;
}

// ---- clock -----------------------------------------------------------------------------------

namespace {

constexpr std::chrono::milliseconds latch_timeout{50};

struct LatchFeatures {
    const char* command;
    const char* value;
    bool in_ticks;  // of GevTimestampTickFrequency, instead of ns
};

// SFNC 2, then GigE Vision 1.
std::optional<LatchFeatures> latch_features(const GenicamDevice& device) {
    for (const LatchFeatures& features :
         {LatchFeatures{"TimestampLatch", "TimestampLatchValue", false},
          LatchFeatures{"GevTimestampControlLatch", "GevTimestampValue", true}})
        if (device.has(features.command) && device.has(features.value))
            return features;
    return std::nullopt;
}

std::uint64_t latched_value(const GenicamDevice& device, const LatchFeatures& features) {
    return static_cast<std::uint64_t>(
        device.call("read the latched time", arv_camera_get_integer, features.value));
}

std::uint64_t in_nanoseconds(const GenicamDevice& device, const LatchFeatures& features,
                             std::uint64_t value) {
    if (!features.in_ticks || !arv_camera_is_gv_device(device.camera()))
        return value;
    const std::uint64_t frequency = genicam_tick_frequency(device);
    if (frequency == 0)
        device.fail("read the tick frequency", "it is 0");
    return nanoseconds_of_ticks(value, frequency);
}

// SFNC 2, then what cameras had before it.
struct PtpFeatures {
    const char* enable;
    const char* latch;
    const char* status;
    const char* offset;
};
constexpr PtpFeatures ptp_features[] = {
    {"PtpEnable", "PtpDataSetLatch", "PtpStatus", "PtpOffsetFromMaster"},
    {"GevIEEE1588", "GevIEEE1588DataSetLatch", "GevIEEE1588Status", "GevIEEE1588OffsetFromMaster"}};

bool is_switched_off(const GenicamDevice& device, const PtpFeatures& features) {
    return device.has(features.enable) &&
           !device.call("read whether PTP is on", arv_camera_get_boolean, features.enable);
}

PtpState ptp_state(const GenicamDevice& device, const PtpFeatures& features) {
    if (device.has(features.latch))
        device.call("latch the PTP state", arv_camera_execute_command, features.latch);
    PtpState state;
    state.status =
        text_or_empty(device.call("read the PTP state", arv_camera_get_string, features.status));
    if (state.status == "Slave" && device.has(features.offset))
        state.offset_ns =
            device.call("read the PTP offset", arv_camera_get_integer, features.offset);
    return state;
}

}  // namespace

std::uint64_t genicam_tick_frequency(const GenicamDevice& device) {
    if (!arv_camera_is_gv_device(device.camera()))
        return 0;
    return device.ask("read the tick frequency", [&](GError** e) {
        return arv_gv_device_get_timestamp_tick_frequency(
            ARV_GV_DEVICE(arv_camera_get_device(device.camera())), e);
    });
}

std::uint64_t nanoseconds_of_ticks(std::uint64_t ticks, std::uint64_t frequency) {
    if (frequency == 0)
        return ticks;
    const std::uint64_t seconds = ticks / frequency, rest = ticks % frequency;
    return seconds * 1'000'000'000 + rest * 1'000'000'000 / frequency;
}

// A device may take time to latch: the clock counts as read when the value has changed.
std::optional<GenicamClockReading> read_genicam_clock(const GenicamDevice& device,
                                                      const Clock& clock) {
    const auto features = latch_features(device);
    if (!features)
        return std::nullopt;
    const std::uint64_t old_value = latched_value(device, *features);
    const Instant before = clock.now();
    device.call("latch the device's clock", arv_camera_execute_command, features->command);
    do {
        const std::uint64_t value = latched_value(device, *features);
        if (value != old_value)
            return GenicamClockReading{in_nanoseconds(device, *features, value),
                                       {before, clock.now()}};
    } while (clock.now() < before + latch_timeout);
    return std::nullopt;
}

std::optional<PtpState> read_ptp(const GenicamDevice& device) {
    for (const PtpFeatures& features : ptp_features) {
        if (!device.has(features.status) || is_switched_off(device, features))
            continue;
        PtpState state = ptp_state(device, features);
        if (state.status != "Disabled" && state.status != "Off")
            return state;
    }
    return std::nullopt;
}

}  // namespace etalon
