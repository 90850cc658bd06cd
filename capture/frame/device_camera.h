// What the backends have in common of the contract in camera.h: the order of the calls, the
// settings in force, retries, and how a lost device comes back.
#pragma once

#include <fmt/format.h>

#include "capture/frame/frame_checks.h"

namespace etalon {

class DeviceCamera : public Camera {
public:
    const CameraIdentity& identity() const override { return identity_; }

    CaptureSettings configure(const CaptureSettings& wanted) override {
        require_alive("configure");
        if (armed_)
            fail("configure", "the camera is armed");
        settings_.reset();
        settings_ = apply(wanted);
        wanted_ = wanted;
        return *settings_;
    }

    void arm() override {
        require_alive("arm");
        if (!settings_)
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
        return first_complete_frame(retries, statistics_, [&] {
            require_alive("take a frame");
            return next_frame(t, stop);
        });
    }

    void disarm() noexcept override {
        armed_ = false;
        stop_stream();
    }

    void reconnect(Instant deadline, std::stop_token stop) override {
        if (pause_ == Duration(0))
            fail("reconnect", "it is none that can come back");
        const std::optional<CaptureSettings> before = settings_;
        const bool arm_again = armed_;
        for (;;) {
            try {
                close();
                reopen();
                if (before) {
                    configure(wanted_);
                    if (const auto changed =
                            first_difference(*before, *settings_, exposure_step_us()))
                        fail("reconnect: " + changed->request, changed->cause);
                }
                if (arm_again)
                    arm();
                ++statistics_.reconnects;
                return;
            } catch (const DeviceError&) {
                close();
                settings_ = before;  // to be tried again
                armed_ = arm_again;
                if (clock_.now() >= deadline)
                    throw;
            }
            if (!clock_.wait_until(std::min(deadline, clock_.now() + pause_), stop))
                throw Interrupted();
        }
    }

    CaptureStatistics statistics() const override { return statistics_; }
    std::vector<std::string> remarks() const override { return remarks_; }

protected:
    // `pause` is between two attempts to open a lost device; 0: it cannot come back.
    DeviceCamera(const std::string& uri, const CameraLink& link, Clock& clock, Duration pause = {})
        : name_("camera " + uri), link_(link), clock_(clock), pause_(pause) {
        identity_.uri = uri;
    }

    [[noreturn]] void fail(const std::string& request, const std::string& cause) const {
        throw DeviceError(name_, request, cause);
    }
    void refuse_if(const std::optional<SettingDifference>& difference) const {
        if (difference)
            fail(difference->request, difference->cause);
    }
    // Once each.
    void remark(const std::string& text) {
        if (std::ranges::find(remarks_, text) == remarks_.end())
            remarks_.push_back(text);
    }
    void remark_on_format(const PixelFormat& format, std::string_view name,
                          std::string_view range = "") {
        if (format.lossy())
            remark(fmt::format("{} is lossy: its pixels are not the sensor's codes", name));
        if (format.luma_of_colours())
            remark(fmt::format("of {} the luma is kept, which the camera made{}", name, range));
    }

    Frame nothing_came(const std::string& cause) const {
        Frame frame;
        frame.settings = *settings_;
        frame.status_detail = cause;
        return frame;
    }
    static void date(Frame& frame, const TimeWindow& exposure_start) {
        frame.exposure_start_uncertainty = exposure_start.half_width();
        frame.exposure_start = exposure_start.earliest + frame.exposure_start_uncertainty;
    }
    void require_codes(const Frame& frame, const PixelFormat& format) const {
        if (frame.status != FrameStatus::complete)
            return;
        if (const std::string fault = code_fault(frame.image, format); !fault.empty())
            fail("take a frame", fault);
    }

    // Throws DeviceError when the device is gone.
    virtual void require_alive(const std::string&) const {}
    // Returns what is in force. Throws DeviceError for what differs from the wish.
    virtual CaptureSettings apply(const CaptureSettings& wanted) = 0;
    virtual void start_stream() {}
    virtual void stop_stream() noexcept {}
    // The first frame, good or bad, whose exposure began after `t`; without a status where none
    // came.
    virtual Frame next_frame(Instant t, std::stop_token stop) = 0;

    // For backends whose device comes back. `close` disarms; `reopen` opens the same device or
    // throws DeviceError; `exposure_step_us` is how exactly its settings can be compared.
    virtual void close() noexcept { disarm(); }
    virtual void reopen() {}
    virtual double exposure_step_us() const { return 0.0; }

    std::string name_;  // for errors
    CameraLink link_;
    Clock& clock_;
    Duration pause_;
    CameraIdentity identity_;
    CaptureStatistics statistics_;
    std::vector<std::string> remarks_;
    CaptureSettings wanted_;
    std::optional<CaptureSettings> settings_;  // in force; nothing until configured
    bool armed_ = false;                       // stays when the device is lost
};

}  // namespace etalon
