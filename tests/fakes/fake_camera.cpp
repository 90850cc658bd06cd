#include "tests/fakes/fake_camera.h"

namespace etalon {

void FakeCamera::require_alive(const std::string& request) const {
    lost_ = lost_ || unplugged || triggers_left == 0;
    if (lost_)
        fail(request, "the camera is lost");
}

CaptureSettings FakeCamera::apply(const CaptureSettings& wanted) {
    CaptureSettings settings = wanted;
    if (settings.format.empty())
        settings.format = wanted.bits <= 8 ? "Mono8" : "Mono16";
    if (alter_settings)
        alter_settings(settings);
    refuse_if(first_difference(wanted, settings, 0.5));
    return settings;
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

Frame FakeCamera::next_frame(Instant t, std::stop_token stop) {
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

}  // namespace etalon
