// A camera without a device, for unit tests of whatever uses one: pictures come from a callback,
// and every failure happens when the test says so. Takes any settings unless alter_settings makes
// it another. For one thread.
#pragma once

#include <deque>

#include "capture/frame/device_camera.h"

namespace etalon {

class FakeCamera final : public DeviceCamera {
public:
    using Picture = std::function<CodeImage(const CaptureSettings&)>;

    // `picture` is asked for every complete frame, with the settings in force; its size becomes
    // the frame's. The clock must outlive the camera; it is advanced to after the moment asked for.
    FakeCamera(Picture picture, Clock& clock)
        : DeviceCamera("fake", {}, clock), picture_(std::move(picture)) {
        identity_ = {"fake:", "Etalon", "FakeCamera", "FAKE-7"};
    }

    void reconnect(Instant deadline, std::stop_token stop) override {
        if (unplugged || triggers_left == 0) {
            if (!clock_.wait_until(deadline, stop))
                throw Interrupted();
            fail("reconnect", "the camera is lost");
        }
        lost_ = false;
        ++statistics_.reconnects;
    }
    CaptureStatistics statistics() const override {
        CaptureStatistics now = statistics_;
        now.missing_packets = missing_packets;
        return now;
    }

    // What becomes of the next triggers, in order; afterwards all are complete.
    std::deque<FrameStatus> script;
    // Triggers until the camera is gone and every call throws DeviceError; negative: never.
    int triggers_left = -1;
    long missing_packets = 0;  // as counted
    bool unplugged = false;    // now: gone until this is false again and reconnect() was called
    void lose_once() { lost_ = true; }  // gone until reconnect()
    // How far a device's settings differ from what was asked, before they are read back and
    // compared.
    std::function<void(CaptureSettings&)> alter_settings;

    using DeviceCamera::identity_;  // a test may change it

    // What happened so far.
    bool is_armed() const { return armed_; }
    int triggers = 0;

private:
    void require_alive(const std::string& request) const override {
        lost_ = lost_ || unplugged || triggers_left == 0;
        if (lost_)
            fail(request, "the camera is lost");
    }
    CaptureSettings apply(const CaptureSettings& wanted) override {
        CaptureSettings settings = wanted;
        if (settings.format.empty())
            settings.format = wanted.bits <= 8 ? "Mono8" : "Mono16";
        if (alter_settings)
            alter_settings(settings);
        refuse_if(first_difference(wanted, settings, 0.5));
        return settings;
    }
    Frame next_frame(Instant t, std::stop_token stop) override {
        if (stop.stop_requested())
            throw Interrupted();
        if (clock_.now() <= t)
            clock_.wait_until(t + Duration(1), {});
        if (triggers_left > 0)
            --triggers_left;
        Frame frame;
        frame.id = static_cast<std::uint64_t>(++triggers);
        frame.exposure_start = clock_.now();
        frame.settings = *settings_;
        frame.status = FrameStatus::complete;
        if (!script.empty()) {
            frame.status = script.front();
            script.pop_front();
        }
        frame.status_detail = name(frame.status);
        if (frame.status == FrameStatus::complete)
            frame.image = picture_(*settings_);
        return frame;
    }

    Picture picture_;
    mutable bool lost_ = false;
};

}  // namespace etalon
