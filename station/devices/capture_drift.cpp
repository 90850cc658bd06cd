#include "station/devices/capture_drift.h"

#include "capture/camera_recovery.h"
#include "core/program/errors.h"
#include "station/record/run_record.h"

namespace etalon {
namespace {

// When frame `number` is due, never before the last one.
Instant due(Instant start, const DriftRequest& request, int number, Instant last) {
    return std::max(start + number * request.interval, last);
}

void watch(Camera& camera, const TargetFinder& find_target, const DriftRequest& request,
           Clock& clock, const std::stop_token& stop, DriftMonitor& monitor,
           const std::function<void(const DriftMonitor&)>& seen) {
    const Instant start = clock.now();
    Instant last = start;
    for (int number = 0; number < request.frames && !monitor.stable(); ++number) {
        const Instant next = due(start, request, number, last);
        if (!clock.wait_until(next, stop))
            throw Interrupted();
        const Frame frame = frame_after_reconnecting(camera, next, request.retries, clock, stop,
                                                     [](const auto&, const auto&) {});
        const bool complete = frame.status == FrameStatus::complete;
        last = complete ? frame.exposure_start : clock.now();
        monitor.add(last - start, complete ? find_target(frame.image) : TargetPoints{});
        seen(monitor);
    }
}

}  // namespace

DriftResult watch_drift(Camera& camera, const TargetFinder& find_target,
                        const DriftRequest& request, Clock& clock, const std::stop_token& stop,
                        const std::function<void(const DriftMonitor&)>& seen) {
    const std::string started = utc_now();
    const CaptureSettings settings = camera.configure(request.settings);
    const DriftPlan plan = drift_plan({settings.width, settings.height}, request.interval,
                                      request.frames * Minutes(request.interval));
    DriftResult result{.camera = camera.identity(),
                       .settings = settings,
                       .statistics = {},
                       .remarks = {},
                       .monitor = DriftMonitor(plan),
                       .started_utc = started};
    const Instant start = clock.now();
    camera.arm();
    try {
        watch(camera, find_target, request, clock, stop, result.monitor, seen);
    } catch (const Interrupted&) {
        result.reason = "interrupted";
    } catch (const Error& error) {
        result.reason = error.what();
    }
    camera.disarm();
    result.stable = result.monitor.stable();
    result.duration = clock.now() - start;
    result.statistics = camera.statistics();
    result.remarks = camera.remarks();
    return result;
}

}  // namespace etalon
