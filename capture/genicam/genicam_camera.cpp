#include "capture/genicam/genicam_camera.h"

#include <arv.h>

#include <set>

#include "capture/frame/device_camera.h"
#include "capture/genicam/genicam_settings.h"

namespace etalon {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

constexpr int warm_up_triggers = 3;  // a trigger right after arming may be lost
constexpr milliseconds between_openings{200};

// ---- frames of one acquisition ---------------------------------------------------------------

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

void reject(Frame& frame, FrameStatus status, const std::string& why) {
    frame.status = status;
    frame.status_detail = why;
}

// The frames of an armed device: one acquisition with its buffers. A frame is judged by its size
// too, since the library calls truncated ones good, and by its chunks.
class GenicamStream {
public:
    using Buffer = std::unique_ptr<ArvBuffer, UnrefObject>;

    // Starts the acquisition. Throws DeviceError. Both must outlive the stream.
    GenicamStream(GenicamDevice& device, const GenicamCapture& capture)
        : device_(device), capture_(capture) {
        stream_.reset(device.call("create stream", arv_camera_create_stream, nullptr, nullptr));
        if (!stream_)
            device.fail("create stream", "the library gave none");
        set_properties();
        for (int i = 0; i < buffers; ++i)
            arv_stream_push_buffer(stream_.get(), arv_buffer_new_allocate(capture.payload));
        device.call("start acquisition", arv_camera_start_acquisition);
    }

    // Stops it within 3 s, lost or not.
    ~GenicamStream() {
        if (!device_.lost()) {
            ErrorSlot error;
            arv_camera_stop_acquisition(device_.camera(), error.out());
            if (error)
                device_.lose();
        }
        if (device_.lost())
            release_in_background(std::move(stream_));
    }

    // The next buffer that the library has done with; null where there is none.
    Buffer waiting() { return Buffer(arv_stream_try_pop_buffer(stream_.get())); }

    Buffer next(const Clock& clock, Instant deadline, std::stop_token stop) {
        const auto slice = static_cast<guint64>(microseconds(look_around).count());
        do {
            throw_if_stopped(stop);
            if (device_.lost())
                device_.fail("wait for a frame", "the camera is lost: it no longer answers");
            if (Buffer buffer{arv_stream_timeout_pop_buffer(stream_.get(), slice)})
                return buffer;
        } while (clock.now() < deadline);
        return nullptr;
    }

    void give_back(Buffer buffer) { arv_stream_push_buffer(stream_.get(), buffer.release()); }

    // Whether the buffer's frame comes after all seen before; remembers it if so.
    bool is_newer(ArvBuffer* buffer) {
        const std::uint64_t id = arv_buffer_get_frame_id(buffer);
        if (last_id_ && !frame_id_advanced(*last_id_, id))
            return false;
        if (last_id_)
            skipped_ += static_cast<long>(frames_between(*last_id_, id));
        last_id_ = id;
        return true;
    }

    // The frame in the buffer, which is given back, without its times.
    Frame judged(Buffer owned) {
        ArvBuffer* buffer = owned.get();
        const CaptureSettings& settings = capture_.settings;
        Frame frame;
        frame.id = arv_buffer_get_frame_id(buffer);
        frame.settings = settings;
        frame.mosaic = capture_.format->mosaic;
        frame.device_time_ns = arv_buffer_get_timestamp(buffer);
        const BufferVerdict verdict = verdict_of_buffer(arv_buffer_get_status(buffer));
        reject(frame, verdict.status, verdict.detail);
        PayloadParts parts;
        if (frame.status != FrameStatus::complete) {
            // as the library says
        } else if (const std::string fault = leader_fault(buffer); !fault.empty())
            reject(frame, FrameStatus::short_frame, fault);
        else if (const std::string damage = split(buffer, parts); !damage.empty())
            reject(frame, FrameStatus::corrupt, damage);
        else if (const std::string doubt = chunk_fault(buffer, parts); !doubt.empty())
            reject(frame, FrameStatus::corrupt, doubt);
        else
            unpack_into(frame, *capture_.format, {parts.image, settings.width, settings.height},
                        settings.bits);
        give_back(std::move(owned));
        return frame;
    }

    // Adds the packets, underruns and skipped frames of this acquisition.
    void add_to(CaptureStatistics& sum) const {
        guint64 completed = 0, failed = 0, underruns = 0, resent = 0, missing = 0;
        arv_stream_get_statistics(stream_.get(), &completed, &failed, &underruns);
        if (ARV_IS_GV_STREAM(stream_.get()))
            arv_gv_stream_get_statistics(ARV_GV_STREAM(stream_.get()), &resent, &missing);
        sum.underruns += static_cast<long>(underruns);
        sum.skipped += skipped_;
        sum.resent_packets += static_cast<long>(resent);
        sum.missing_packets += static_cast<long>(missing);
    }

    // Whether chunks came that the library cannot read.
    bool had_unreadable_chunks() const { return had_unreadable_chunks_; }

private:
    void set_properties() {
        if (!ARV_IS_GV_STREAM(stream_.get()))
            return;
        g_object_set(stream_.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED,
                     "socket-buffer-size", static_cast<gint>(receive_buffer_bytes),
                     "packet-timeout", static_cast<guint>(packet_timeout.count()), "packet-resend",
                     ARV_GV_STREAM_PACKET_RESEND_ALWAYS, "frame-retention",
                     static_cast<guint>(frame_retention.count()), nullptr);
    }

    // What is wrong with the header and size of a frame that the library calls good; empty if
    // nothing. With chunks the size is judged by them: the leader of pure chunk data has no image.
    std::string leader_fault(ArvBuffer* buffer) const {
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
            return fmt::format("frame of {}x{} in format {:#x}, expected {}x{} in {:#x}", width,
                               height, code, expected.width, expected.height,
                               capture_.format->pfnc_code);
        const std::size_t received = bytes_of(buffer).size();
        if (!capture_.chunks.active && received != capture_.payload)
            return fmt::format("{} bytes received, payload {}", received, capture_.payload);
        return "";
    }

    std::string split(ArvBuffer* buffer, PayloadParts& parts) const {
        const auto payload = bytes_of(buffer);
        if (!capture_.chunks.active) {
            parts.image = payload;
            return "";
        }
        const CaptureSettings& settings = capture_.settings;
        return split_payload(
            payload, image_bytes(*capture_.format, settings.width, settings.height, 0),
            ARV_IS_GV_STREAM(stream_.get()) ? std::endian::big : std::endian::little, parts);
    }

    // What makes a frame doubtful by its own account; empty if nothing.
    std::string chunk_fault(ArvBuffer* buffer, const PayloadParts& parts) {
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
    std::string stamp_fault(ArvBuffer* buffer, const ChunkValues& values) const {
        const std::uint64_t stamp = arv_buffer_get_timestamp(buffer);
        if (!values.time_ns || stamp == 0)
            return "";
        const microseconds allowed = capture_.settings.exposure + milliseconds(1);
        const auto apart =
            std::chrono::nanoseconds(static_cast<std::int64_t>(*values.time_ns - stamp));
        if (std::chrono::abs(apart) <= allowed)
            return "";
        return fmt::format(
            "the time stamp in its chunks lies {} ns from the other: both cannot lie in "
            "its exposure",
            apart.count());
    }

    // The chunk's number counts exposures and may run ahead; one that falls behind is another's.
    std::string frame_id_fault(std::uint64_t id, std::uint64_t chunk_id) {
        const auto last = std::exchange(last_ids_, FrameIds{id, chunk_id});
        if (!last || !frame_id_advanced(last->id, id))
            return "";
        const std::uint64_t sent = frames_between(last->id, id);
        const bool advanced = frame_id_advanced(last->in_chunk, chunk_id);
        const std::uint64_t taken = advanced ? frames_between(last->in_chunk, chunk_id) : 0;
        if (!advanced || taken < sent || taken - sent > max_skipped)
            return fmt::format(
                "its chunks are of another frame: {} after {}, with {} frames between", chunk_id,
                last->in_chunk, sent);
        skipped_ += static_cast<long>(taken - sent);
        return "";
    }

    GenicamDevice& device_;
    const GenicamCapture& capture_;
    std::unique_ptr<ArvStream, UnrefObject> stream_;
    std::optional<std::uint64_t> last_id_;
    struct FrameIds {
        std::uint64_t id, in_chunk;
    };
    std::optional<FrameIds> last_ids_;  // of the last frame whose chunks were read
    bool had_unreadable_chunks_ = false;
    long skipped_ = 0;
};

// ---- the camera ------------------------------------------------------------------------------

class GenicamCamera final : public DeviceCamera {
public:
    GenicamCamera(const std::string& id, const CameraLink& link, Clock& clock)
        : DeviceCamera("genicam:" + id, link, clock, between_openings),
          id_(id),
          device_(std::make_unique<GenicamDevice>(id, link)) {
        identity_ = device_->identity();
    }
    ~GenicamCamera() override { disarm(); }

    CameraAbilities abilities() const override {
        require_alive("list abilities");
        return genicam_abilities(*device_);
    }

    CaptureStatistics statistics() const override {
        CaptureStatistics now = statistics_;
        if (stream_)
            stream_->add_to(now);
        return now;
    }

    std::vector<std::string> remarks() const override {
        std::vector<std::string> remarks;
        if (device_)
            remarks = device_->remarks();
        for (const auto* more : {&capture_.remarks, &remarks_})
            remarks.insert(remarks.end(), more->begin(), more->end());
        return remarks;
    }

private:
    void require_alive(const std::string& request) const override {
        if (!device_ || device_->lost())
            fail(request, "the camera is lost: it no longer answers");
    }

    CaptureSettings apply(const CaptureSettings& wanted) override {
        capture_ = configure_genicam(*device_, wanted);
        return capture_.settings;
    }

    void start_stream() override {
        require_alive("start the stream");
        stream_ = std::make_unique<GenicamStream>(*device_, capture_);
        answer_outstanding_ = false;
        last_device_ns_ = 0;
        read_clock();
        if (by_software())
            discard_triggered_warm_up_frame();
        else if (capture_.settings.trigger == "none")
            discard_next_frame();
    }

    void stop_stream() noexcept override {
        if (stream_)
            stream_->add_to(statistics_);
        stream_.reset();
    }

    void discard_triggered_warm_up_frame() {
        for (int attempt = 0; attempt < warm_up_triggers; ++attempt) {
            trigger();
            if (discard_next_frame()) {
                answer_outstanding_ = attempt > 0;
                return;
            }
        }
        fail("take a first frame", fmt::format("none came after {} triggers of {} ms each",
                                               warm_up_triggers, link_.frame_timeout.count()));
    }

    // Whether there was one.
    bool discard_next_frame() {
        auto buffer = stream_->next(clock_, clock_.now() + link_.frame_timeout, {});
        if (!buffer)
            return false;
        stream_->is_newer(buffer.get());
        stream_->give_back(std::move(buffer));
        return true;
    }

    void trigger() { device_->call("trigger", arv_camera_software_trigger); }

    bool by_software() const { return capture_.settings.trigger == "Software"; }

    Frame next_frame(Instant t, std::stop_token stop) override {
        // The answer to an old trigger would pass for the new one's: only a new stream excludes it.
        if (answer_outstanding_ || !stream_)
            restart_stream();
        wait_until_after(clock_, t, stop);
        const Instant earliest = begin_exposure();
        const Instant deadline = clock_.now() + link_.frame_timeout;
        while (auto buffer = stream_->next(clock_, deadline, stop)) {
            const Instant arrival = clock_.now();
            if (!stream_->is_newer(buffer.get())) {
                ++statistics_.rejected;
                stream_->give_back(std::move(buffer));
                continue;
            }
            Frame frame = stream_->judged(std::move(buffer));
            require_codes(frame, *capture_.format);
            if (stream_->had_unreadable_chunks())
                remark(
                    "this version of Aravis cannot read the camera's chunks: the exposure and gain "
                    "of each frame are not compared");
            date(frame, {earliest, arrival});
            if (by_software() || frame.status != FrameStatus::complete ||
                frame.exposure_start - frame.exposure_start_uncertainty > t)
                return frame;
            ++statistics_.rejected;  // too old
        }
        answer_outstanding_ = by_software();
        return nothing_came(fmt::format("no frame within {} ms", link_.frame_timeout.count()));
    }

    // Triggers, if by software. Returns before when no frame that comes can have begun, as far as
    // the station knows. Without a clock a camera that runs freely begins again.
    Instant begin_exposure() {
        Instant earliest = Instant::min();
        if (!by_software()) {
            read_clock();
            if (!device_clock_.known()) {
                earliest = clock_.now();
                restart_stream();
            }
        }
        discard_stale_frames();
        if (by_software()) {
            earliest = clock_.now();
            trigger();
        }
        return earliest;
    }

    void restart_stream() {
        stop_stream();
        start_stream();
    }

    void discard_stale_frames() {
        while (auto buffer = stream_->waiting()) {
            stream_->is_newer(buffer.get());
            last_device_ns_ = arv_buffer_get_timestamp(buffer.get());
            stream_->give_back(std::move(buffer));
            ++statistics_.rejected;
        }
    }

    // A clock that PTP is about to set is as good as none; one that it keeps is like any other.
    void read_clock() {
        device_clock_.forget();
        const auto ptp = read_ptp(*device_);
        if (ptp)
            remark_on_clock(*ptp);
        if (ptp && !ptp->steady())
            return;
        if (const auto reading = read_genicam_clock(*device_, clock_))
            device_clock_.read(reading->device_ns, reading->window);
    }

    void remark_on_clock(const PtpState& ptp) {
        if (!ptp_states_.insert(ptp.status).second)
            return;
        std::string text = "PTP: the camera's clock is " + ptp.status;
        if (ptp.offset_ns)
            text += fmt::format(", {} ns from its master's", *ptp.offset_ns);
        if (!ptp.steady())
            text += ": no frame is dated by it, since it may be set at any moment";
        remark(text);
    }

    // A stamp may lie anywhere in the exposure. Nothing without a stamp of a steady clock.
    std::optional<TimeWindow> exposure_start_by_stamp(std::uint64_t device_ns, Instant arrival) {
        if (!device_clock_.known() || device_ns == 0)
            return std::nullopt;
        const bool went_back = device_ns <= std::exchange(last_device_ns_, device_ns);
        const TimeWindow stamp = device_clock_.station_time(device_ns);
        if (went_back || stamp.earliest > arrival)
            return std::nullopt;
        return TimeWindow{stamp.earliest - capture_.settings.exposure, stamp.latest};
    }

    // `seen` is what the station itself knows of the beginning of the exposure.
    void date(Frame& frame, const TimeWindow& seen) {
        TimeWindow window = seen;
        const auto by_stamp = exposure_start_by_stamp(frame.device_time_ns, seen.latest);
        if (by_stamp && !intersection(seen, *by_stamp).empty()) {
            window = intersection(seen, *by_stamp);
            frame.time_source = TimeSource::device_clock;
        } else if (seen.earliest == Instant::min()) {
            window = {seen.latest, seen.latest};
            if (frame.status == FrameStatus::complete) {
                frame.status = FrameStatus::corrupt;
                frame.status_detail =
                    "its time stamp is impossible: the device's clock was changed";
                frame.image = {};
            }
        }
        DeviceCamera::date(frame, window);
    }

    // The library only finds a device again when everything of the old one is gone.
    void close() noexcept override {
        disarm();
        device_.reset();
    }

    void reopen() override {
        arv_update_device_list();
        device_ = std::make_unique<GenicamDevice>(id_, link_);
        if (device_->identity().serial != identity_.serial)
            fail("reconnect", fmt::format("camera {} came back in place of {}",
                                          device_->identity().serial, identity_.serial));
    }

    std::string id_;
    std::unique_ptr<GenicamDevice> device_;  // null while it is being opened again

    GenicamCapture capture_;
    std::unique_ptr<GenicamStream> stream_;
    DeviceClock device_clock_;
    std::set<std::string> ptp_states_;  // that were seen
    std::uint64_t last_device_ns_ = 0;
    bool answer_outstanding_ = false;  // a trigger was sent whose frame never came
};

}  // namespace

std::unique_ptr<Camera> open_genicam_camera(const std::string& id, const CameraLink& link,
                                            Clock& clock) {
    return std::make_unique<GenicamCamera>(id, link, clock);
}

}  // namespace etalon
