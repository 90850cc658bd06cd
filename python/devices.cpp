// etalon.CameraDevice, Stage, devices(): cameras and stages within a station's rules.
#include "python/devices.h"

#include "capture/camera_recovery.h"
#include "python/arrays.h"

namespace etalon {

SharedCamera::SharedCamera(const std::string& uri, const CameraLink& link) {
    device_ = interruptible([&](std::stop_token stop) {
        return open_when_free([&] { return open_camera(uri, link, clock_); }, clock_, stop,
                              [](const std::string&) {});
    });
}

Frame SharedCamera::frame(int retries) {
    if (retries < 0)
        throw ConfigError({"retries"}, "must not be negative");
    return interruptible([&](std::stop_token stop) {
        const std::lock_guard turn(mutex_);
        return open().frame_after(clock_.now(), retries, stop);
    });
}

SharedStage::SharedStage(const StationStage& stage, bool homed) : axes_(stage.axes) {
    device_ = without_gil([&]() -> std::unique_ptr<Stage> {
        auto device = std::make_unique<LimitedStage>(
            open_stage(stage.link, stage.profile, stage.axes, clock_), stage.rules);
        if (homed)
            device->take_for_homed();
        return device;
    });
}

void SharedStage::run(const std::function<void(Stage&, std::stop_token)>& work) {
    const std::stop_token halted = halt_token();  // now: a stop also ends what still waits
    run_interruptibly([&](std::stop_token interrupted) {
        const std::lock_guard turn(mutex_);
        std::stop_source either;
        const auto stop = [&] { either.request_stop(); };
        const std::stop_callback by_interrupt(interrupted, stop);
        const std::stop_callback by_halt(halted, stop);
        throw_if_stopped(either.get_token());
        work(open(), either.get_token());
    });
}

bool SharedStage::stop() {
    halt();
    return ask([](Stage& device) { return device.stop(); });
}

void SharedStage::close() {
    halt();
    SharedDevice<Stage>::close();
}

std::stop_token SharedStage::halt_token() {
    const std::lock_guard held(halt_mutex_);
    return halt_.get_token();
}

void SharedStage::halt() {
    const std::lock_guard held(halt_mutex_);
    halt_.request_stop();
    halt_ = std::stop_source();
}

CaptureSettings configured(SharedCamera& camera, const CaptureSettings& wanted) {
    return camera.ask([&](Camera& device) {
        device.disarm();
        const CaptureSettings settings = device.configure(wanted);
        device.arm();
        return settings;
    });
}

namespace {

py::list status(SharedStage& stage) {
    const auto all = stage.ask(std::mem_fn(&Stage::status));
    py::list list;
    for (std::size_t i = 0; i < all.size(); ++i)
        list.append(py::dict("name"_a = stage.axes()[i].name, "position"_a = all[i].position,
                             "enabled"_a = all[i].enabled, "homed"_a = all[i].homed,
                             "moving"_a = all[i].moving, "in_position"_a = all[i].in_position,
                             "alarm"_a = all[i].alarm, "limit"_a = all[i].limit,
                             "emergency_stop"_a = all[i].emergency_stop));
    return list;
}

void move(SharedStage& stage, const py::object& target) {
    const std::vector<double> positions = number_list(target, "target");
    stage.run([&](Stage& device, std::stop_token stop) { device.move(positions, stop); });
}

py::dict in_force(const CaptureSettings& settings) {
    return py::dict("width"_a = settings.width, "height"_a = settings.height,
                    "bits"_a = settings.bits, "format"_a = settings.format,
                    "exposure_us"_a = settings.exposure.count(), "gain_db"_a = settings.gain_db,
                    "black_level"_a = settings.black_level, "trigger"_a = settings.trigger,
                    "controls"_a = settings.controls);
}

py::dict configure(SharedCamera& camera, std::int64_t exposure_us, double gain_db, int width,
                   int height, int bits, const std::string& format,
                   const std::optional<double>& black_level, const std::string& trigger,
                   const std::map<std::string, double>& controls) {
    const CaptureSettings wanted{
        width,   height,      bits,    format,  std::chrono::microseconds(exposure_us),
        gain_db, black_level, trigger, controls};
    return in_force(configured(camera, wanted));
}

py::dict statistics(SharedCamera& camera) {
    const CaptureStatistics counted = camera.ask(std::mem_fn(&Camera::statistics));
    return py::dict("delivered"_a = counted.delivered, "rejected"_a = counted.rejected,
                    "missing_packets"_a = counted.missing_packets,
                    "resent_packets"_a = counted.resent_packets, "underruns"_a = counted.underruns,
                    "skipped"_a = counted.skipped, "reconnects"_a = counted.reconnects);
}

py::dict described(const CameraIdentity& camera) {
    return py::dict("uri"_a = camera.uri, "vendor"_a = camera.vendor, "model"_a = camera.model,
                    "serial"_a = camera.serial);
}

py::dict identity(SharedCamera& camera) {
    return described(camera.ask([](Camera& device) { return device.identity(); }));
}

py::list list_of_devices() {
    const std::vector<CameraBackend> found = without_gil([] { return list_cameras(); });
    py::list backends;
    for (const CameraBackend& backend : found) {
        py::list cameras;
        for (const CameraIdentity& camera : backend.cameras)
            cameras.append(described(camera));
        backends.append(py::dict("name"_a = backend.name, "built_in"_a = backend.built_in,
                                 "detail"_a = backend.detail, "cameras"_a = cameras));
    }
    return backends;
}

std::unique_ptr<SharedCamera> open_by_uri(const std::string& uri, double frame_timeout_s,
                                          int packet_size) {
    CameraLink link;
    link.frame_timeout =
        std::chrono::duration_cast<std::chrono::milliseconds>(duration_of(frame_timeout_s));
    link.packet_size = packet_size;
    return std::make_unique<SharedCamera>(uri, link);
}

void bind_cameras(Module& module) {
    Bound<Frame>(module, "Frame", "A photograph with what is known of it.")
        .get("image", "(height, width) uint8 or uint16; None unless the frame is complete.",
             [](const Frame& frame) -> py::object {
                 if (frame.status != FrameStatus::complete)
                     return py::none();
                 return shared_array(frame.image.pixels);
             })
        .get("status", "complete, short_frame, corrupt, lost or timed_out.",
             [](const Frame& frame) { return name(frame.status); })
        .get("status_detail", "The driver's own words.", &Frame::status_detail)
        .get("bits", "Full scale is 2^bits - 1.",
             [](const Frame& frame) { return frame.image.bits; })
        .get("id", "The device's frame counter.", &Frame::id)
        .get("settings", "In force during the exposure: a dict.",
             [](const Frame& frame) { return in_force(frame.settings); });

    Bound<SharedCamera>(module, "CameraDevice",
                        R"(A camera that takes photographs. Close it, or use it in a `with`.

Threads that share one take turns.)")
        .def("configure", &configure, py::kw_only(), "exposure_us"_a = 0, "gain_db"_a = 0.0,
             "width"_a = 0, "height"_a = 0, "bits"_a = 8, "format"_a = "",
             "black_level"_a = py::none(), "trigger"_a = "",
             "controls"_a = std::map<std::string, double>(),
             R"(Applies the settings, reads each one back, gets ready; what is in force, as a dict.

0, None and "" leave the device's own. Raises DeviceError when it refuses or changes one.)")
        .def("frame", &SharedCamera::frame, "retries"_a = 5,
             R"(A Frame whose exposure began after this call; bad ones are tried again.

Raises DeviceError when the device is gone. Ctrl-C ends it.)")
        .def("close", &SharedCamera::close, "Gives the device free.")
        .get("identity", "uri, vendor, model, serial: a dict.", &identity)
        .get("statistics", "Counters since opening: a dict.", &statistics)
        .get("remarks", "What limits this connection, one line each.",
             [](SharedCamera& camera) { return camera.ask(std::mem_fn(&Camera::remarks)); })
        .def("__enter__", [](const py::object& self) { return self; })
        .def("__exit__", [](SharedCamera& camera, const py::args&) { camera.close(); });
    module.def(
        "open_camera", &open_by_uri, "uri"_a, py::kw_only(), "frame_timeout_s"_a = 1.0,
        "packet_size"_a = 1400,
        R"(A CameraDevice by its URI: genicam:ID-or-IP, v4l2:/dev/video0, libcamera:ID, files:FOLDER.

Raises ConfigError for a URI that no backend knows, DeviceError when nobody answers.)");
    module.def(
        "devices", &list_of_devices,
        "Backends with the cameras that are there now: dicts, as `etalon devices` prints them.");
}

}  // namespace

py::list axes_list(const std::vector<Axis>& axes) {
    py::list list;
    for (const Axis& axis : axes) {
        const bool is_linear = axis.kind == Axis::Kind::linear;
        list.append(py::dict("name"_a = axis.name, "kind"_a = is_linear ? "linear" : "rotary",
                             "unit"_a = is_linear ? "mm" : "rad", "low"_a = axis.low,
                             "high"_a = axis.high, "speed"_a = axis.speed));
    }
    return list;
}

void bind_devices(Module& module) {
    bind_cameras(module);
    Bound<SharedStage>(module, "Stage",
                       R"(A station's stage, within its soft limits, forbidden boxes and slow zones.

Positions: one per axis, mm or rad. Closing it, leaving its `with` or losing it stops every axis.
Threads that share one take turns. Ctrl-C during a motion stops the axes.)")
        .get("axes", "Dicts of name, kind, unit, low, high, speed.",
             [](const SharedStage& stage) { return axes_list(stage.axes()); })
        .def(
            "enable", [](SharedStage& stage) { stage.run(std::mem_fn(&Stage::enable)); },
            "Switches the axes on. Raises DeviceError.")
        .def(
            "home", [](SharedStage& stage) { stage.run(std::mem_fn(&Stage::home)); },
            R"(Moves every axis until it has found its zero, by the controller's own way.

Soft limits, forbidden boxes and slow zones do not hold meanwhile. Raises DeviceError.)")
        .def(
            "resume", [](SharedStage& stage) { stage.ask(std::mem_fn(&Stage::resume)); },
            R"(In place of enable() and home(): goes on where an earlier program left the axes.

Raises DeviceError unless every axis is enabled, homed and at rest.)")
        .def("move", &move, "target"_a,
             R"(Moves all axes to target (A,), returns when they have settled.

Raises ConfigError before anything moves for a target that is not allowed, DeviceError for an alarm
or a lost link; the axes are stopped first.)")
        .def(
            "limit_speed",
            [](SharedStage& stage, double share) {
                stage.ask([&](Stage& device) { device.limit_speed(share); });
            },
            "share"_a, "Moves from now on run at this share of each axis' speed, 0 < share <= 1.")
        .def(
            "position",
            [](SharedStage& stage) { return array_of(stage.ask(std::mem_fn(&Stage::position))); },
            "(A,), read back from axes at rest. Raises DeviceError.")
        .def("status", &status,
             "Of each axis, a dict: position, enabled, homed, moving, alarm, ...")
        .def("stop", &SharedStage::stop,
             "Stops every axis, also during a motion of another thread. True when the controller "
             "confirmed that nothing moves.")
        .def(
            "trace", [](SharedStage& stage) { return stage.ask(std::mem_fn(&Stage::trace)); },
            "The last exchanges with the device, one line each.")
        .def("close", &SharedStage::close, "Stops every axis and ends the connection.")
        .def("__enter__", [](const py::object& self) { return self; })
        .def("__exit__", [](SharedStage& stage, const py::args&) { stage.close(); });
}

}  // namespace etalon
