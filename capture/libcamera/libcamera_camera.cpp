#include "capture/libcamera/libcamera_camera.h"

#include <cmath>

#include "capture/frame/device_camera.h"

namespace etalon {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

constexpr int settling_frames = 20;  // a pipeline delays settings by 2 to 10 frames
constexpr int warm_up_frames = UsbDelay::frames_on_their_way + 1;
constexpr int max_stale_frames = 40;  // in a row, of a camera whose frames all seem old
constexpr milliseconds stop_patience{2000};
constexpr milliseconds reopen_pause{250};

class LibcameraCamera final : public DeviceCamera {
public:
    LibcameraCamera(const std::string& id, const CameraLink& link, Clock& clock,
                    LibcameraOpener open)
        : DeviceCamera("libcamera:" + id, link, clock, reopen_pause),
          id_(id),
          open_(std::move(open)),
          device_(open_(id)) {
        identity_ = device_->identity();
    }

    ~LibcameraCamera() override { close(); }
    LibcameraCamera(const LibcameraCamera&) = delete;
    LibcameraCamera& operator=(const LibcameraCamera&) = delete;

    CameraAbilities abilities() const override {
        require_alive("read abilities");
        CameraAbilities abilities;
        for (const LibcameraFormat& offered : device_->formats()) {
            const PixelFormat* known = find_libcamera_format(offered.name);
            abilities.formats.push_back({offered.name, "", known ? known->bits : 0, offered.sizes});
        }
        for (const auto& [control, range] : device_->controls()) {
            const auto now = metadata_.find(control);
            abilities.controls.push_back(
                {.name = control,
                 .value = now == metadata_.end() ? "" : fmt::format("{}", now->second),
                 .unit = control == "ExposureTime" ? "us" : "",
                 .low = range.low,
                 .high = range.high,
                 .step = {},
                 .choices = {}});
        }
        return abilities;
    }

private:
    [[noreturn]] void lose(const std::string& request, const std::string& cause) {
        lost_ = true;
        fail(request, cause);
    }

    void require_alive(const std::string& request) const override {
        if (!device_ || lost_ || device_->disconnected())
            fail(request, "the camera is gone");
    }

    CaptureSettings apply(const CaptureSettings& wanted) override {
        // The stream that tells what is in force ends with this function.
        const std::shared_ptr<void> stopping(nullptr, [this](void*) { stop_stream(); });
        if (wanted.black_level)
            fail("set black level", "libcamera cannot set it");
        if (!wanted.trigger.empty() && wanted.trigger != "none")
            fail("set trigger " + wanted.trigger, "libcamera's cameras run freely: only none");
        apply_format(wanted);
        LibcameraPlanning planning = plan_libcamera_controls(wanted, device_->controls());
        refuse_if(planning.difference);
        plan_ = std::move(planning.plan);
        start_stream();
        require_mentioned(wanted);
        CaptureSettings actual = with_metadata(wanted, metadata_);
        actual.width = stream_.size.width;
        actual.height = stream_.size.height;
        actual.bits = wanted.bits ? wanted.bits : format_->bits;
        actual.format = stream_.format;
        actual.trigger = "none";
        refuse_if(first_difference(wanted, actual, exposure_step_us()));
        write_remarks();
        return actual;
    }

    void apply_format(const CaptureSettings& wanted) {
        const std::vector<LibcameraFormat> offered = device_->formats();
        format_ = choose_libcamera_format(wanted, offered);
        if (!format_) {
            std::string names;
            for (const LibcameraFormat& format : offered)
                names += (names.empty() ? "" : ", ") + format.name;
            fail(fmt::format("set pixel format {} of {} bits",
                             wanted.format.empty() ? "(monochrome)" : wanted.format, wanted.bits),
                 "the camera has " + names);
        }
        const cv::Size size(wanted.width, wanted.height);
        const std::string name(format_->libcamera);
        stream_ = device_->configure(name, size);
        refuse_if(stream_difference(name, size, stream_));
    }

    // What was asked for must be read back; a gain of 0 dB, which is none, need not.
    void require_mentioned(const CaptureSettings& wanted) const {
        for (const auto& [control, value] : plan_.asked) {
            const bool needless = control == "AnalogueGain" && wanted.gain_db == 0.0;
            if (!needless && !metadata_.count(control))
                fail("set " + in_words(control, value),
                     fmt::format(
                         "the frames' metadata do not mention {}: nobody knows what the camera "
                         "does",
                         control));
        }
    }

    void write_remarks() {
        remarks_ = plan_.remarks;
        std::string unmentioned;
        for (const LibcameraValues& values : {plan_.automatics, plan_.asked})
            for (const auto& [control, value] : values) {
                const auto actual = metadata_.find(control);
                if (actual == metadata_.end())
                    unmentioned += (unmentioned.empty() ? "" : ", ") + control;
                else if (contradicted({{control, value}}, metadata_, exposure_step_us()))
                    remarks_.push_back(fmt::format("{} stays: it cannot be switched off",
                                                   in_words(control, actual->second)));
            }
        if (!unmentioned.empty())
            remark("set but not read back, since the frames' metadata do not mention it: " +
                   unmentioned);
        if (!metadata_.count("ExposureTime"))
            remarks_.push_back(
                "whatever libcamera has no control for stays as it is, such as the sharpening of a "
                "USB camera (v4l2: reaches it)");
        remark_on_format(*format_, stream_.format,
                         stream_.limited_range ? ", from 16 to 235 only" : "");
    }

    static CaptureSettings with_metadata(CaptureSettings settings,
                                         const LibcameraValues& metadata) {
        for (const auto& [control, value] : metadata) {
            if (const auto asked = settings.controls.find(control);
                asked != settings.controls.end())
                asked->second = value;
            if (control == "ExposureTime")
                settings.exposure = microseconds(std::llround(value));
            else if (control == "AnalogueGain")
                settings.gain_db = gain_db(value);
        }
        return settings;
    }

    // A rolling shutter exposes in steps of a line's readout, at least a frame's lines of them.
    double exposure_step_us() const override {
        const std::chrono::duration<double, std::micro> period =
            timing_.period().value_or(Duration(0));
        return std::max(0.5, period.count() / stream_.size.height);
    }

    // Returns when the settings are in force.
    void start_stream() override {
        timing_ = {};
        streaming_ = true;
        device_->start({plan_.automatics, plan_.asked});
        settle();
        refuse_if(contradicted(plan_.asked, metadata_, exposure_step_us()));
    }

    void settle() {
        for (int frames = 1; frames <= settling_frames; ++frames) {
            const LibcameraFrame raw = next_while_settling();
            placed(raw);
            metadata_ = raw.metadata;
            device_->give_back(raw.buffer);
            if (frames >= warm_up_frames &&
                !contradicted(plan_.asked, metadata_, exposure_step_us()) &&
                !contradicted(plan_.automatics, metadata_, exposure_step_us()))
                return;
        }
    }

    LibcameraFrame next_while_settling() {
        auto raw = device_->next(link_.frame_timeout, {});
        if (device_->disconnected())
            lose("start the stream", "the camera is gone");
        if (!raw)
            fail("start the stream",
                 fmt::format("no frame within {} ms", link_.frame_timeout.count()));
        if (raw->status == LibcameraFrame::Status::cancelled)
            fail("start the stream",
                 "libcamera cancels the requests: the driver refuses a control");
        return *raw;
    }

    void stop_stream() noexcept override {
        if (!std::exchange(streaming_, false))
            return;
        if (device_ && !run_bounded([device = device_] { device->stop(); }, stop_patience)) {
            lost_ = true;
            device_.reset();  // it is the background's now
        }
    }

    void close() noexcept override {
        armed_ = streaming_ = false;
        if (device_)
            run_bounded([device = std::move(device_)]() mutable { device.reset(); }, stop_patience);
    }

    void reopen() override {
        device_ = open_(id_);
        if (device_->identity().model != identity_.model)
            fail("reconnect", fmt::format("there is a {} now, it was a {}",
                                          device_->identity().model, identity_.model));
        lost_ = false;
    }

    Frame next_frame(Instant t, std::stop_token stop) override {
        wait_until_after(clock_, t, stop);
        waiting_since_ = clock_.now();
        expected_.reset();
        for (int stale = 0; stale < max_stale_frames; ++stale) {
            const auto raw = device_->next(link_.frame_timeout, stop);
            if (!raw) {
                if (device_->disconnected() || device_->is_silently_gone())
                    lose("take a frame", "the camera is gone");
                return nothing_came(
                    fmt::format("no frame within {} ms", link_.frame_timeout.count()));
            }
            if (const auto frame = judged(*raw, t))
                return *frame;
            ++statistics_.rejected;
        }
        return nothing_came(fmt::format(
            "{} frames came, none of them begun after the moment asked for", max_stale_frames));
    }

    FrameTiming::Start placed(const LibcameraFrame& raw) {
        const KernelTime now = device_->time();
        return timing_.place(raw, now, clock_.now());
    }

    // Nothing if its exposure began too early. Gives the buffer back.
    std::optional<Frame> judged(const LibcameraFrame& raw, Instant t) {
        if (raw.status == LibcameraFrame::Status::cancelled)
            lose("take a frame", "libcamera cancelled the request: the camera is gone");
        const FrameTiming::Start start = placed(raw);
        count_skipped(raw, start);
        if (start.fault.empty() && start.earliest <= t) {
            device_->give_back(raw.buffer);
            return std::nullopt;
        }
        Frame frame = described(raw, start);
        if (!start.fault.empty())
            frame.status_detail = start.fault;
        else if (raw.status == LibcameraFrame::Status::error)
            frame.status_detail = "libcamera flags the frame as damaged";
        else
            unpack_into(frame, *format_,
                        {raw.data, settings_->width, settings_->height, stream_.bytes_per_line},
                        settings_->bits);
        device_->give_back(raw.buffer);
        require_as_asked(frame, raw.metadata);
        return frame;
    }

    // Frames that came while nobody waited found no buffer, which is no loss.
    void count_skipped(const LibcameraFrame& raw, const FrameTiming::Start& start) {
        if (expected_ && raw.sequence > *expected_)
            statistics_.skipped += static_cast<long>(raw.sequence - *expected_);
        if (start.latest > waiting_since_)
            expected_ = raw.sequence + 1;
    }

    // All but the image; `corrupt` so far.
    Frame described(const LibcameraFrame& raw, const FrameTiming::Start& start) const {
        Frame frame;
        frame.id = raw.sequence;
        frame.mosaic = format_->mosaic;
        frame.settings = with_metadata(*settings_, raw.metadata);
        frame.time_source = TimeSource::driver_start;
        frame.device_time_ns = static_cast<std::uint64_t>(raw.timestamp_ns.value_or(0));
        frame.status = FrameStatus::corrupt;
        if (start.fault.empty())
            date(frame, {start.earliest, start.latest});
        return frame;
    }

    void require_as_asked(const Frame& frame, const LibcameraValues& metadata) const {
        if (const auto changed = contradicted(plan_.asked, metadata, exposure_step_us()))
            fail("take a frame", "it was told to " + changed->request + ": " + changed->cause);
        require_codes(frame, *format_);
    }

    std::string id_;
    LibcameraOpener open_;
    std::shared_ptr<LibcameraDevice> device_;

    const PixelFormat* format_ = nullptr;
    LibcameraStream stream_;
    LibcameraPlan plan_;
    LibcameraValues metadata_;  // of the latest frame

    bool streaming_ = false;
    FrameTiming timing_;
    Instant waiting_since_{};
    std::optional<std::uint64_t> expected_;  // sequence number, while waiting

    // Nothing works any more until reconnect() has brought back what there was.
    bool lost_ = false;
};

}  // namespace

std::unique_ptr<Camera> open_libcamera_camera(const std::string& id, const CameraLink& link,
                                              Clock& clock, LibcameraOpener open) {
    return std::make_unique<LibcameraCamera>(id, link, clock, std::move(open));
}

}  // namespace etalon
