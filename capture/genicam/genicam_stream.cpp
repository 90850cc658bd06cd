#include "capture/genicam/genicam_stream.h"

#include <arv.h>
#include <fmt/format.h>

#include <utility>

#include "capture/frame/frame_checks.h"
#include "capture/genicam/genicam_device.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

constexpr microseconds packet_timeout = milliseconds(20);    // then a packet is asked for again
constexpr microseconds frame_retention = milliseconds(200);  // then a frame is given up
constexpr int buffers = 4;
constexpr milliseconds look_around{20};  // while waiting: how often a stop or a loss is noticed
constexpr std::uint64_t max_skipped = 1'000'000;  // exposures between two that were sent

std::span<const std::uint8_t> bytes_of(ArvBuffer* buffer) {
    std::size_t received = 0;
    const void* data = arv_buffer_get_data(buffer, &received);
    return {static_cast<const std::uint8_t*>(data), received};
}

}  // namespace

GenicamStream::GenicamStream(GenicamDevice& device, const GenicamCapture& capture)
    : device_(device), capture_(capture) {
    stream_.reset(device.ask("create stream", [&](GError** e) {
        return arv_camera_create_stream(device.camera(), nullptr, nullptr, e);
    }));
    if (!stream_)
        device.fail("create stream", "the library gave none");
    set_properties();
    for (int i = 0; i < buffers; ++i)
        arv_stream_push_buffer(stream_.get(), arv_buffer_new_allocate(capture.payload));
    device.ask("start acquisition",
               [&](GError** e) { arv_camera_start_acquisition(device.camera(), e); });
}

void GenicamStream::set_properties() {
    if (!ARV_IS_GV_STREAM(stream_.get()))
        return;
    g_object_set(stream_.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED,
                 "socket-buffer-size", static_cast<gint>(receive_buffer_bytes), "packet-timeout",
                 static_cast<guint>(packet_timeout.count()), "packet-resend",
                 ARV_GV_STREAM_PACKET_RESEND_ALWAYS, "frame-retention",
                 static_cast<guint>(frame_retention.count()), nullptr);
}

GenicamStream::~GenicamStream() {
    if (!device_.lost()) {
        ErrorSlot error;
        arv_camera_stop_acquisition(device_.camera(), error.out());
        if (error)
            device_.lose();
    }
    if (device_.lost())
        release_in_background(std::move(stream_));
}

GenicamStream::Buffer GenicamStream::waiting() {
    return Buffer(arv_stream_try_pop_buffer(stream_.get()));
}

GenicamStream::Buffer GenicamStream::next(const Clock& clock, Instant deadline,
                                          std::stop_token stop) {
    const auto slice = static_cast<guint64>(microseconds(look_around).count());
    do {
        if (stop.stop_requested())
            throw Interrupted();
        if (device_.lost())
            device_.fail("wait for a frame", "the camera is lost: it no longer answers");
        if (Buffer buffer{arv_stream_timeout_pop_buffer(stream_.get(), slice)})
            return buffer;
    } while (clock.now() < deadline);
    return nullptr;
}

void GenicamStream::give_back(Buffer buffer) {
    arv_stream_push_buffer(stream_.get(), buffer.release());
}

bool GenicamStream::is_newer(ArvBuffer* buffer) {
    const std::uint64_t id = arv_buffer_get_frame_id(buffer);
    if (last_id_ && !frame_id_advanced(*last_id_, id))
        return false;
    if (last_id_)
        skipped_ += static_cast<long>(frames_between(*last_id_, id));
    last_id_ = id;
    return true;
}

namespace {

void reject(Frame& frame, FrameStatus status, const std::string& why) {
    frame.status = status;
    frame.status_detail = why;
}

}  // namespace

Frame GenicamStream::judged(ArvBuffer* buffer) {
    Frame frame;
    frame.id = arv_buffer_get_frame_id(buffer);
    frame.settings = capture_.settings;
    frame.mosaic = capture_.format->mosaic;
    frame.device_time_ns = device_time_ns(buffer);
    const ArvBufferStatus status = arv_buffer_get_status(buffer);
    reject(frame, genicam_frame_status(status), describe_buffer_status(status));
    if (frame.status != FrameStatus::complete)
        return frame;
    PayloadParts parts;
    if (const std::string fault = leader_fault(buffer); !fault.empty())
        reject(frame, FrameStatus::short_frame, fault);
    else if (const std::string damage = split(buffer, parts); !damage.empty())
        reject(frame, FrameStatus::corrupt, damage);
    else if (const std::string doubt = chunk_fault(buffer, parts); !doubt.empty())
        reject(frame, FrameStatus::corrupt, doubt);
    else
        unpack_into(frame, parts.image);
    return frame;
}

void GenicamStream::unpack_into(Frame& frame, std::span<const std::uint8_t> image) const {
    const CaptureSettings& settings = capture_.settings;
    std::string fault =
        unpack(*capture_.format, {image, settings.width, settings.height}, frame.image);
    if (!fault.empty()) {
        reject(frame, FrameStatus::short_frame, fault);
        return;
    }
    frame.image.bits = settings.bits;
    fault = code_fault(frame.image, *capture_.format);
    if (!fault.empty())
        device_.fail("take a frame", fault);
}

// What is wrong with what a frame that the library calls good says of itself before its pixels, and
// with its size; empty if nothing. With chunks the size is judged by them. The leader of pure chunk
// data describes no image: the chunk's length must do.
std::string GenicamStream::leader_fault(ArvBuffer* buffer) const {
    const ArvBufferPayloadType type = arv_buffer_get_payload_type(buffer);
    if (capture_.chunks.active && type == ARV_BUFFER_PAYLOAD_TYPE_CHUNK_DATA)
        return "";
    if (type != ARV_BUFFER_PAYLOAD_TYPE_IMAGE &&
        !(capture_.chunks.active && type == ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA))
        return "not an image payload";
    const int width = arv_buffer_get_image_width(buffer);
    const int height = arv_buffer_get_image_height(buffer);
    const ArvPixelFormat code = arv_buffer_get_image_pixel_format(buffer);
    const CaptureSettings& expected = capture_.settings;
    if (width != expected.width || height != expected.height ||
        static_cast<std::uint32_t>(code) != capture_.format->pfnc_code)
        return fmt::format("frame of {}x{} in format {:#x}, expected {}x{} in {:#x}", width, height,
                           code, expected.width, expected.height, capture_.format->pfnc_code);
    const std::size_t received = bytes_of(buffer).size();
    if (!capture_.chunks.active && received != capture_.payload)
        return fmt::format("{} bytes received, payload {}", received, capture_.payload);
    return "";
}

// ---- chunks ----------------------------------------------------------------------------------

std::string GenicamStream::split(ArvBuffer* buffer, PayloadParts& parts) const {
    const auto payload = bytes_of(buffer);
    if (!capture_.chunks.active) {
        parts.image = payload;
        return "";
    }
    const CaptureSettings& settings = capture_.settings;
    return split_payload(payload, image_bytes(*capture_.format, settings.width, settings.height, 0),
                         ARV_IS_GV_STREAM(stream_.get()) ? std::endian::big : std::endian::little,
                         parts);
}

// What makes a frame doubtful by its own account; empty if nothing.
std::string GenicamStream::chunk_fault(ArvBuffer* buffer, const PayloadParts& parts) {
    if (!capture_.chunks.active || capture_.chunks.fields.empty())
        return "";
    if (!chunks_are_readable(buffer)) {
        had_unreadable_chunks_ = true;
        return "";
    }
    ChunkValues values;
    std::string fault = read_chunks(capture_.chunks, buffer, parts, values);
    if (fault.empty() && values.frame_id)
        fault = frame_id_fault(arv_buffer_get_frame_id(buffer), *values.frame_id);
    if (fault.empty())
        fault = stamp_fault(buffer, values);
    if (fault.empty())
        fault = contradiction(values, capture_.settings, capture_.exposure_step_us);
    return fault;
}

// Both stamps lie in the exposure, so they cannot be further apart than it is long.
std::string GenicamStream::stamp_fault(ArvBuffer* buffer, const ChunkValues& values) const {
    const std::uint64_t stamp = device_time_ns(buffer);
    if (!values.time_ns || stamp == 0)
        return "";
    const microseconds allowed = capture_.settings.exposure + milliseconds(1);
    const auto apart = std::chrono::nanoseconds(static_cast<std::int64_t>(*values.time_ns - stamp));
    if (std::chrono::abs(apart) <= allowed)
        return "";
    return fmt::format(
        "the time stamp in its chunks lies {} ns from the other: both cannot lie in "
        "its exposure",
        apart.count());
}

// The number in the chunk counts exposures, the other one what was sent: the former may run ahead,
// but a chunk that falls behind belongs to an earlier frame.
std::string GenicamStream::frame_id_fault(std::uint64_t id, std::uint64_t chunk_id) {
    const auto last = std::exchange(last_ids_, FrameIds{id, chunk_id});
    if (!last || !frame_id_advanced(last->id, id))
        return "";
    const std::uint64_t sent = frames_between(last->id, id);
    const bool advanced = frame_id_advanced(last->in_chunk, chunk_id);
    const std::uint64_t taken = advanced ? frames_between(last->in_chunk, chunk_id) : 0;
    if (!advanced || taken < sent || taken - sent > max_skipped)
        return fmt::format("its chunks are of another frame: {} after {}, with {} frames between",
                           chunk_id, last->in_chunk, sent);
    skipped_ += static_cast<long>(taken - sent);
    return "";
}

std::uint64_t GenicamStream::device_time_ns(ArvBuffer* buffer) {
    return arv_buffer_get_timestamp(buffer);
}

CaptureStatistics GenicamStream::statistics() const {
    CaptureStatistics statistics;
    guint64 completed = 0, failed = 0, underruns = 0;
    arv_stream_get_statistics(stream_.get(), &completed, &failed, &underruns);
    statistics.underruns = static_cast<long>(underruns);
    statistics.skipped = skipped_;
    if (ARV_IS_GV_STREAM(stream_.get())) {
        guint64 resent = 0, missing = 0;
        arv_gv_stream_get_statistics(ARV_GV_STREAM(stream_.get()), &resent, &missing);
        statistics.resent_packets = static_cast<long>(resent);
        statistics.missing_packets = static_cast<long>(missing);
    }
    return statistics;
}

}  // namespace etalon
