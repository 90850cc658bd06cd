#include "tests/fakes/fake_camera.h"

#include "capture/frame/frame_checks.h"

namespace etalon {

void FakeCamera::fail(const std::string& request, const std::string& cause) const {
    throw DeviceError("camera fake", request, cause);
}

void FakeCamera::require_alive(const std::string& request) {
    lost_ = lost_ || unplugged || triggers_left == 0;
    if (lost_)
        fail(request, "the camera is lost");
}

CaptureSettings FakeCamera::configure(const CaptureSettings& wanted) {
    require_alive("configure");
    if (armed)
        fail("configure", "the camera is armed");
    configured = false;
    settings = wanted;
    if (settings.format.empty())
        settings.format = wanted.bits <= 8 ? "Mono8" : "Mono16";
    if (alter_settings)
        alter_settings(settings);
    if (const auto difference = first_difference(wanted, settings, 0.5))
        fail(difference->request, difference->cause);
    configured = true;
    return settings;
}

void FakeCamera::arm() {
    require_alive("arm");
    if (!configured)
        fail("arm", "the camera is not configured");
    armed = true;
}

Frame FakeCamera::frame_after(Instant t, int retries, std::stop_token stop) {
    if (!armed)
        fail("take a frame", "the camera is not armed");
    return first_complete_frame(retries, statistics_, [&] {
        if (stop.stop_requested())
            throw Interrupted();
        require_alive("take a frame");
        return triggered(t);
    });
}

void FakeCamera::reconnect(Instant deadline, std::stop_token stop) {
    if (unplugged || triggers_left == 0) {
        if (!clock_.wait_until(deadline, stop))
            throw Interrupted();
        fail("reconnect", "the camera is lost");
    }
    lost_ = false;
    ++statistics_.reconnects;
}

Frame FakeCamera::triggered(Instant t) {
    if (clock_.now() <= t)
        clock_.wait_until(t + Duration(1), {});
    if (triggers_left > 0)
        --triggers_left;
    Frame frame;
    frame.id = static_cast<std::uint64_t>(++triggers);
    frame.exposure_start = clock_.now();
    frame.settings = settings;
    frame.status = FrameStatus::complete;
    if (!script.empty()) {
        frame.status = script.front();
        script.pop_front();
    }
    frame.status_detail = name(frame.status);
    if (frame.status == FrameStatus::complete)
        frame.image = picture_(settings);
    return frame;
}

}  // namespace etalon
