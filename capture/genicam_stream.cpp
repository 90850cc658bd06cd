#include "capture/genicam_stream.h"

#include <arv.h>
#include <fmt/format.h>

#include "capture/frame_checks.h"
#include "capture/genicam_support.h"
#include "core/errors.h"

namespace etalon {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

constexpr microseconds packet_timeout = milliseconds(20);    // then a packet is asked for again
constexpr microseconds frame_retention = milliseconds(200);  // then a frame is given up
constexpr int buffers = 4;
constexpr milliseconds look_around{20};  // while waiting: how often a stop or a loss is noticed

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
                 static_cast<guint>(packet_timeout.count()), "frame-retention",
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

Frame GenicamStream::judged(ArvBuffer* buffer) const {
    Frame frame;
    frame.id = arv_buffer_get_frame_id(buffer);
    frame.settings = capture_.settings;
    frame.mosaic = capture_.format->mosaic;
    frame.device_time_ns = device_time_ns(buffer);
    const ArvBufferStatus status = arv_buffer_get_status(buffer);
    frame.status = genicam_frame_status(status);
    frame.status_detail = describe_buffer_status(status);
    if (frame.status != FrameStatus::complete)
        return frame;
    std::string fault = size_fault(buffer);
    if (fault.empty()) {
        std::size_t size = 0;
        const auto* data = static_cast<const std::uint8_t*>(arv_buffer_get_data(buffer, &size));
        fault =
            unpack(*capture_.format,
                   {{data, size}, capture_.settings.width, capture_.settings.height}, frame.image);
    }
    if (!fault.empty()) {
        frame.status = FrameStatus::short_frame;
        frame.status_detail = fault;
        return frame;
    }
    frame.image.bits = capture_.settings.bits;
    fault = code_fault(frame.image, *capture_.format);
    if (!fault.empty())
        device_.fail("take a frame", fault);
    return frame;
}

// What is wrong with the size of a frame that the library calls good; empty if nothing.
std::string GenicamStream::size_fault(ArvBuffer* buffer) const {
    if (arv_buffer_get_payload_type(buffer) != ARV_BUFFER_PAYLOAD_TYPE_IMAGE)
        return "not an image payload";
    std::size_t received = 0;
    arv_buffer_get_data(buffer, &received);
    const int width = arv_buffer_get_image_width(buffer);
    const int height = arv_buffer_get_image_height(buffer);
    const ArvPixelFormat code = arv_buffer_get_image_pixel_format(buffer);
    const CaptureSettings& expected = capture_.settings;
    if (width != expected.width || height != expected.height ||
        static_cast<std::uint32_t>(code) != capture_.format->pfnc_code)
        return fmt::format("frame of {}x{} in format {:#x}, expected {}x{} in {:#x}", width, height,
                           code, expected.width, expected.height, capture_.format->pfnc_code);
    if (received != capture_.payload)
        return fmt::format("{} bytes received, payload {}", received, capture_.payload);
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
