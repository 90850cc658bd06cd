#include "capture/genicam/genicam_camera.h"

#include <arv.h>
#include <fmt/format.h>

#include <optional>
#include <set>
#include <utility>

#include "capture/frame/frame_checks.h"
#include "capture/genicam/genicam_clock.h"
#include "capture/genicam/genicam_device.h"
#include "capture/genicam/genicam_settings.h"
#include "capture/genicam/genicam_stream.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

using std::chrono::milliseconds;

constexpr int warm_up_triggers = 3;  // a trigger right after arming may be lost
constexpr milliseconds between_openings{200};

void add(const CaptureStatistics& of_stream, CaptureStatistics& sum) {
    sum.missing_packets += of_stream.missing_packets;
    sum.resent_packets += of_stream.resent_packets;
    sum.underruns += of_stream.underruns;
    sum.skipped += of_stream.skipped;
}

class GenicamCamera final : public Camera {
public:
    GenicamCamera(const std::string& id, const CameraLink& link, Clock& clock)
        : id_(id),
          link_(link),
          clock_(clock),
          device_(std::make_unique<GenicamDevice>(id, link)),
          identity_(device_->identity()) {}
    ~GenicamCamera() override { disarm(); }
    GenicamCamera(const GenicamCamera&) = delete;
    GenicamCamera& operator=(const GenicamCamera&) = delete;

    const CameraIdentity& identity() const override { return identity_; }

    CameraAbilities abilities() const override {
        require_alive("list abilities");
        return genicam_abilities(*device_);
    }

    CaptureSettings configure(const CaptureSettings& wanted) override {
        require_alive("configure");
        if (armed_)
            fail("configure", "the camera is armed");
        asked_.reset();
        capture_ = configure_genicam(*device_, wanted);
        asked_ = wanted;
        return capture_.settings;
    }

    void arm() override {
        require_alive("arm");
        if (!asked_)
            fail("arm", "the camera is not configured");
        if (armed_)
            return;
        try {
            start_stream();
        } catch (const Error&) {
            stop_stream();
            throw;
        }
        armed_ = true;
    }

    Frame frame_after(Instant t, int retries, std::stop_token stop) override {
        if (!armed_)
            fail("take a frame", "the camera is not armed");
        return first_complete_frame(retries, statistics_, [&] { return one_frame(t, stop); });
    }

    void disarm() noexcept override {
        armed_ = false;
        stop_stream();
    }

    // The library only finds a device again when everything of the old one is gone.
    void reconnect(Instant deadline, std::stop_token stop) override {
        const bool armed = armed_;
        stop_stream();
        device_.reset();
        open_again(deadline, stop);
        try {
            take_up_again(armed);
        } catch (const Error&) {
            device_->lose();
            stop_stream();
            throw;
        }
        ++statistics_.reconnects;
    }

    CaptureStatistics statistics() const override {
        CaptureStatistics now = statistics_;
        if (stream_)
            add(stream_->statistics(), now);
        return now;
    }

    std::vector<std::string> remarks() const override {
        std::vector<std::string> remarks;
        if (device_)
            remarks = device_->remarks();
        for (const auto* more : {&capture_.remarks, &ptp_remarks_})
            remarks.insert(remarks.end(), more->begin(), more->end());
        if (had_unreadable_chunks_ || (stream_ && stream_->had_unreadable_chunks()))
            remarks.emplace_back(
                "this version of Aravis cannot read the camera's chunks: the exposure "
                "and gain of each frame are not compared");
        return remarks;
    }

private:
    [[noreturn]] void fail(const std::string& request, const std::string& cause) const {
        throw DeviceError("camera " + identity_.uri, request, cause);
    }

    void require_alive(const std::string& request) const {
        if (!device_ || device_->lost())
            fail(request, "the camera is lost: it no longer answers");
    }

    void start_stream() {
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

    void stop_stream() noexcept {
        if (stream_) {
            add(stream_->statistics(), statistics_);
            had_unreadable_chunks_ |= stream_->had_unreadable_chunks();
        }
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

    void trigger() {
        device_->ask("trigger",
                     [&](GError** e) { arv_camera_software_trigger(device_->camera(), e); });
    }

    bool by_software() const { return capture_.settings.trigger == "Software"; }

    Frame one_frame(Instant t, std::stop_token stop) {
        require_alive("take a frame");
        // The answer to an old trigger may still come and would pass for the new one's. Only a new
        // stream, on a port of its own, is sure to be without it.
        if (answer_outstanding_ || !stream_) {
            stop_stream();
            start_stream();
        }
        wait_until_after(clock_, t, stop);
        if (by_software())
            return triggered_frame(stop);
        return streamed_frame(t, stop);
    }

    Frame triggered_frame(std::stop_token stop) {
        discard_stale_frames();
        const Instant sent = clock_.now();
        trigger();
        const Instant deadline = clock_.now() + link_.frame_timeout;
        while (auto buffer = stream_->next(clock_, deadline, stop)) {
            if (stream_->is_newer(buffer.get())) {
                const Instant arrival = clock_.now();
                Frame frame = stream_->judged(buffer.get());
                stream_->give_back(std::move(buffer));
                date(frame, {sent, arrival});
                return frame;
            }
            ++statistics_.rejected;
            stream_->give_back(std::move(buffer));
        }
        answer_outstanding_ = true;
        return nothing_came();
    }

    // Without a clock the camera begins anew, so that whatever comes began after now.
    Frame streamed_frame(Instant t, std::stop_token stop) {
        read_clock();
        Instant earliest = Instant::min();  // known from the frame's stamp
        if (!device_clock_.known()) {
            earliest = clock_.now();
            stop_stream();
            start_stream();
        }
        discard_stale_frames();
        const Instant deadline = clock_.now() + link_.frame_timeout;
        while (auto buffer = stream_->next(clock_, deadline, stop)) {
            const Instant arrival = clock_.now();
            const bool newer = stream_->is_newer(buffer.get());
            Frame frame = stream_->judged(buffer.get());
            stream_->give_back(std::move(buffer));
            date(frame, {earliest, arrival});
            if (newer && (frame.status != FrameStatus::complete ||
                          frame.exposure_start - frame.exposure_start_uncertainty > t))
                return frame;
            ++statistics_.rejected;  // too old
        }
        return nothing_came();
    }

    Frame nothing_came() const {
        Frame frame;
        frame.settings = capture_.settings;
        frame.status_detail = fmt::format("no frame within {} ms", link_.frame_timeout.count());
        return frame;
    }

    void discard_stale_frames() {
        while (auto buffer = stream_->waiting()) {
            stream_->is_newer(buffer.get());
            last_device_ns_ = GenicamStream::device_time_ns(buffer.get());
            stream_->give_back(std::move(buffer));
            ++statistics_.rejected;
        }
    }

    // A clock that PTP is about to set is as good as none. One that it keeps in step is read like
    // any other: whether the station's own clock follows the same master, nobody here can know.
    void read_clock() {
        device_clock_.forget();
        const auto ptp = read_ptp(*device_);
        if (ptp)
            remark(*ptp);
        if (ptp && !ptp->steady())
            return;
        if (const auto reading = read_genicam_clock(*device_, clock_))
            device_clock_.read(reading->device_ns, reading->window);
    }

    void remark(const PtpState& ptp) {
        if (!ptp_states_.insert(ptp.status).second)
            return;
        std::string text = "PTP: the camera's clock is " + ptp.status;
        if (ptp.offset_ns)
            text += fmt::format(", {} ns from its master's", *ptp.offset_ns);
        if (!ptp.steady())
            text += ": no frame is dated by it, since it may be set at any moment";
        ptp_remarks_.push_back(text);
    }

    // A stamp may lie anywhere from the beginning to the end of the exposure: devices differ.
    // Nothing where there is no stamp or it is none of a clock that goes on steadily.
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
        frame.exposure_start_uncertainty = window.half_width();
        frame.exposure_start = window.earliest + frame.exposure_start_uncertainty;
    }

    void open_again(Instant deadline, std::stop_token stop) {
        for (;;) {
            if (stop.stop_requested())
                throw Interrupted();
            try {
                arv_update_device_list();
                device_ = std::make_unique<GenicamDevice>(id_, link_);
                return;
            } catch (const DeviceError&) {
                if (clock_.now() >= deadline)
                    throw;
            }
            clock_.wait_for(between_openings, stop);
        }
    }

    void take_up_again(bool armed) {
        if (device_->identity().serial != identity_.serial)
            fail("reconnect", fmt::format("camera {} came back in place of {}",
                                          device_->identity().serial, identity_.serial));
        if (asked_) {
            const CaptureSettings before = capture_.settings;
            capture_ = configure_genicam(*device_, *asked_);
            if (const auto difference = first_difference(before, capture_.settings, 0.0))
                fail(difference->request + " again", difference->cause);
        }
        if (armed)
            start_stream();
    }

    std::string id_;
    CameraLink link_;
    Clock& clock_;
    std::unique_ptr<GenicamDevice> device_;  // null while it is being opened again
    CameraIdentity identity_;

    std::optional<CaptureSettings> asked_;  // nothing: not configured
    GenicamCapture capture_;
    bool armed_ = false;
    std::unique_ptr<GenicamStream> stream_;
    DeviceClock device_clock_;
    std::set<std::string> ptp_states_;  // that were seen
    std::vector<std::string> ptp_remarks_;
    std::uint64_t last_device_ns_ = 0;
    bool answer_outstanding_ = false;  // a trigger was sent whose frame never came
    bool had_unreadable_chunks_ = false;
    CaptureStatistics statistics_;  // without those of stream_
};

}  // namespace

std::unique_ptr<Camera> open_genicam_camera(const std::string& id, const CameraLink& link,
                                            Clock& clock) {
    return std::make_unique<GenicamCamera>(id, link, clock);
}

}  // namespace etalon
