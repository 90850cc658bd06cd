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

    void reconnect(Instant deadline, std::stop_token stop) override;
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
    void require_alive(const std::string& request) const override;
    CaptureSettings apply(const CaptureSettings& wanted) override;
    Frame next_frame(Instant t, std::stop_token stop) override;

    Picture picture_;
    mutable bool lost_ = false;
};

}  // namespace etalon
