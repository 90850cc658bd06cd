#include "mocks/twin/twin_file.h"

#include <fmt/ranges.h>

#include "calib/files/camera_file.h"
#include "sim/marker/marker.h"

namespace etalon {
namespace {

constexpr int day_ms = 24 * 3600 * 1000;

std::chrono::milliseconds optional_ms(const Value& mapping, const std::string& key, int low,
                                      std::chrono::milliseconds otherwise) {
    const auto value = mapping.find(key);
    return value ? std::chrono::milliseconds(value->integer(low, day_ms)) : otherwise;
}

std::size_t index_of_axis(const Value& place, const std::string& name,
                          const std::vector<Axis>& axes) {
    const auto found = std::ranges::find(axes, name, &Axis::name);
    if (found == axes.end())
        place.fail(fmt::format("there is no axis '{}'", name));
    return static_cast<std::size_t>(found - axes.begin());
}

void read_periodic(const Value& value, const AxisUnits& units, AxisErrors& errors) {
    const auto amplitude = value.find(units.um_key("periodic"));
    if (!amplitude)
        return;
    errors.periodic = amplitude->number(units.small().either_sign()) * units.per_small();
    errors.period =
        value.at(units.mm_key("period")).number(units.large().positive()) * units.per_large();
    errors.phase = value.number_or_zero("phase_deg", units::deg.either_sign()) * rad_per_deg;
}

void read_lean(const Value& value, std::size_t axis, const std::vector<Axis>& axes,
               AxisErrors& errors) {
    const auto lean = value.find("lean_urad");
    if (!lean)
        return;
    errors.lean.assign(axes.size(), 0.0);
    for (const std::string& name : lean->keys()) {
        const Value angle = lean->with_names().at(name);
        const std::size_t towards = index_of_axis(angle, name, axes);
        if (towards == axis || axes[axis].kind != Axis::Kind::linear ||
            axes[towards].kind != Axis::Kind::linear)
            angle.fail("only a linear axis leans, towards another linear one");
        errors.lean[towards] = angle.number(units::urad.either_sign()) * 1e-6;
    }
}

AxisErrors read_axis_errors(const Value& value, std::size_t axis, const std::vector<Axis>& axes) {
    const AxisUnits units(axes[axis].kind);
    const auto size = [&](const char* name) {
        return value.number_or_zero(units.um_key(name), units.small().non_negative()) *
               units.per_small();
    };
    AxisErrors errors;
    errors.scale = value.number_or_zero("scale_ppm", units::ppm.either_sign()) * 1e-6;
    errors.repeatability = size("repeatability");
    errors.backlash = size("backlash");
    errors.encoder_noise = size("encoder_noise");
    errors.drift =
        value.number_or_zero(units.um_key("drift") + "_per_k", units.small().either_sign()) *
        units.per_small();
    errors.expansion = value.number_or_zero("expansion_ppm_per_k", units::ppm.either_sign()) * 1e-6;
    read_periodic(value, units, errors);
    read_lean(value, axis, axes, errors);
    return errors;
}

AxisServo read_servo(const Value& value, const AxisUnits& units) {
    AxisServo servo;
    servo.parameters.bandwidth_hz = value.at("bandwidth_hz").number(units::hz.positive());
    servo.parameters.damping = value.at("damping").number(units::one.positive());
    servo.parameters.drive_lag =
        value.number_or_zero("drive_lag_us", units::us.non_negative()) * 1e-6;
    if (const auto resonance = value.find("resonance_hz")) {
        servo.parameters.resonance_hz = resonance->number(units::hz.positive());
        servo.parameters.resonance_damping =
            value.at("resonance_damping").number(units::one.positive());
    }
    servo.window =
        value.at(units.um_key("window")).number(units.small().positive()) * units.per_small();
    return servo;
}

// Exactly one of the four.
FaultTrigger read_trigger(const Value& at) {
    using When = FaultTrigger::When;
    std::optional<FaultTrigger> trigger;
    const auto read = [&](const char* key, When when, int low, int high) {
        const auto value = at.find(key);
        if (!value)
            return;
        if (trigger)
            value->fail("one moment is enough");
        trigger = {when, value->integer(low, high)};
    };
    read("time_ms", When::time_ms, 0, day_ms);
    read("move", When::move, 1, 1'000'000'000);
    read("request", When::request, 1, 1'000'000'000);
    read("register", When::write_to, 0, 65535);
    if (!trigger)
        at.fail("needs one of time_ms, move, request, register");
    return *trigger;
}

StageFault read_stage_fault(const Value& value, StageFault::Kind kind,
                            const std::vector<Axis>& axes) {
    using Kind = StageFault::Kind;
    StageFault fault{.kind = kind, .at = read_trigger(value.at("at"))};
    if (kind != Kind::emergency_stop) {
        const Value axis = value.at("axis");
        fault.axis = index_of_axis(axis, axis.text(), axes);
    }
    if (kind == Kind::encoder_jump) {
        const AxisUnits units(axes[fault.axis].kind);
        fault.size =
            value.at(units.um_key("size")).number(units.small().either_sign()) * units.per_small();
    }
    if (kind == Kind::alarm)
        fault.code = value.at("code").integer(1, 65535);
    return fault;
}

ModbusFault read_link_fault(const Value& value, ModbusFault::Kind kind) {
    using Kind = ModbusFault::Kind;
    ModbusFault fault{.kind = kind, .at = read_trigger(value.at("at"))};
    if (const auto requests = value.find("requests"))
        fault.requests = requests->integer(1, 1'000'000'000);
    if (kind == Kind::late_reply || kind == Kind::slow_bytes)
        fault.delay = std::chrono::milliseconds(value.at("delay_ms").integer(1, day_ms));
    else if (kind == Kind::exception)
        fault.code = value.at("code").integer(1, 255);
    else if (const auto carried_out = value.find("carried_out"))
        fault.carried_out = carried_out->flag();
    return fault;
}

constexpr std::pair<const char*, std::variant<StageFault::Kind, ModbusFault::Kind>> fault_kinds[] =
    {{"alarm", StageFault::Kind::alarm},
     {"emergency_stop", StageFault::Kind::emergency_stop},
     {"encoder_jump", StageFault::Kind::encoder_jump},
     {"false_in_position", StageFault::Kind::false_in_position},
     {"limit_hit", StageFault::Kind::limit_hit},
     {"stuck_axis", StageFault::Kind::stuck_axis},
     {"exception", ModbusFault::Kind::exception},
     {"garbage", ModbusFault::Kind::garbage},
     {"half_open", ModbusFault::Kind::half_open},
     {"late_reply", ModbusFault::Kind::late_reply},
     {"reset", ModbusFault::Kind::reset},
     {"silence", ModbusFault::Kind::silence},
     {"slow_bytes", ModbusFault::Kind::slow_bytes},
     {"wrong_id", ModbusFault::Kind::wrong_id}};

void read_fault(const Value& value, TwinStage& stage) {
    const std::string name = value.at("fault").text();
    std::vector<const char*> names;
    for (const auto& [known, kind] : fault_kinds) {
        names.push_back(known);
        if (name != known)
            continue;
        if (const auto* of_stage = std::get_if<StageFault::Kind>(&kind))
            stage.options.faults.push_back(read_stage_fault(value, *of_stage, stage.axes));
        else
            stage.link_faults.push_back(read_link_fault(value, std::get<ModbusFault::Kind>(kind)));
        return;
    }
    value.at("fault").fail(fmt::format("'{}' is none of {}", name, fmt::join(names, ", ")));
}

void read_errors(const Value& section, TwinStage& stage) {
    stage.options.errors.resize(stage.axes.size());
    stage.options.servos.resize(stage.axes.size());
    const auto errors = section.find("errors"), servos = section.find("servo");
    for (std::size_t i = 0; i < stage.axes.size(); ++i) {
        Axis& axis = stage.axes[i];
        if (const auto value = errors ? errors->with_names().find(axis.name) : std::nullopt)
            stage.options.errors[i] = read_axis_errors(*value, i, stage.axes);
        if (const auto value = servos ? servos->with_names().find(axis.name) : std::nullopt)
            stage.options.servos[i] = read_servo(*value, AxisUnits(axis.kind));
        stage.options.errors[i].map = std::exchange(axis.errors, std::nullopt);
    }
}

// One of the two.
void read_wire(const StrictFile& file, const Value& section, TwinStage& stage) {
    const auto serial = section.find("serial");
    if (!serial)
        stage.port = section.at("port").integer(0, 65535);
    else if (section.find("port"))
        serial->fail("a stage has a port or a serial line, not both");
    else
        stage.serial = file.resolve(serial->text()).lexically_normal();
}

StageProfile read_profile(const StrictFile& file, const Value& value) {
    const std::string name = value.text();
    if (name.ends_with(".yaml"))
        return read_stage_profile(file.resolve(name));
    if (!std::ranges::count(builtin_stage_profile_names(), name))
        value.fail(fmt::format("'{}' is no profile that is built in", name));
    return builtin_stage_profile(name);
}

CameraErrors read_camera_errors(const Value& value) {
    CameraErrors errors;
    const Range above_minus_half{-50.0, 50.0};  // percent; more is another camera
    errors.focal_length_percent = value.number_or_zero("focal_length_percent", above_minus_half);
    errors.k1_percent = value.number_or_zero("k1_percent", units::percent.either_sign());
    if (const auto shift = value.find("principal_point_px")) {
        const std::vector<double> px = shift->numbers(2, units::px.either_sign());
        errors.principal_point_px = {px[0], px[1]};
    }
    return errors;
}

void read_twin_camera(const StrictFile& file, const Value& camera, TwinFile& twin) {
    twin.true_camera = read_any_camera(file.resolve(camera.at("calibration").text()));
    if (const auto errors = camera.find("errors")) {
        const CameraErrors given = read_camera_errors(*errors);
        if (given.k1_percent != 0.0 && twin.true_camera.distortion.k1 == 0.0)
            errors->at("k1_percent").fail("has no effect: the calibration's k1 is 0");
        twin.true_camera = with_errors(twin.true_camera, given);
    }
    twin.nominal_exposure =
        std::chrono::microseconds(camera.at("nominal_exposure_us").integer(1, 10'000'000));
    if (const auto method = camera.find("method"))
        twin.method = method->one_of({"auto", "reference"}) == "reference"
                          ? RenderMethod::reference
                          : RenderMethod::automatic;
    twin.packet_loss = camera.number_or_zero("packet_loss", {0.0, 1.0});
}

Rigid read_rigid(const Value& value) {
    const auto rotation = value.at("rotation_deg").numbers(3, units::deg.either_sign());
    const auto translation = value.at("translation_mm").numbers(3, units::mm.either_sign());
    return {rotation_from_vector(Eigen::Vector3d(rotation.data()) * rad_per_deg),
            Eigen::Vector3d(translation.data())};
}

TwinScene read_scene(const Value& value) {
    TwinScene scene;
    const Value marker = value.at("marker");
    const SourcePlace place = marker.place();
    scene.marker =
        parse_marker(marker.text(), fmt::format("{}:{}: {}", place.file, place.line, place.key))
            .grid;
    scene.background = value.at("background").number({0.0, 1.0});
    scene.camera_from_base = read_rigid(value.at("camera_from_base"));
    scene.carriage_from_marker = read_rigid(value.at("carriage_from_marker"));
    return scene;
}

TwinRoom read_room(const Value& value) {
    TwinRoom twin;
    twin.port = value.at("port").integer(0, 65535);
    twin.room.temperature_c = value.at("temperature_c").number({-40.0, 85.0});
    twin.room.swing_k = value.number_or_zero("swing_k", {0.0, 20.0});
    if (const auto period = value.find("period_s"))
        twin.room.period_s = period->number(units::s.positive());
    twin.room.humidity_percent = value.at("humidity_percent").number({0.0, 100.0});
    return twin;
}

}  // namespace

TwinStage read_twin_stage(const StrictFile& file, const Value& section) {
    TwinStage stage;
    read_wire(file, section, stage);
    if (const auto profile = section.find("profile"))
        stage.profile = read_profile(file, *profile);
    stage.axes = read_axes(section.at("axes"));
    SimulatedStageOptions& options = stage.options;
    options.ramp = optional_ms(section, "ramp_ms", 1, options.ramp);
    options.jerk = optional_ms(section, "jerk_ms", 0, options.jerk);
    options.homing = optional_ms(section, "homing_ms", 0, options.homing);
    if (const auto temperature = section.find("temperature"))
        options.temperature = {temperature->at("change_k").number({-300.0, 300.0}),
                               temperature->at("time_constant_s").number(units::s.positive())};
    read_errors(section, stage);
    if (const auto faults = section.find("faults"))
        for (const Value& fault : faults->items())
            read_fault(fault, stage);
    return stage;
}

TwinFile read_twin_file(const std::filesystem::path& path) {
    const StrictFile file(path, "twin/1");
    const Value root = file.root();
    TwinFile twin;
    twin.seed =
        static_cast<std::uint64_t>(root.at("seed").integer(0, std::numeric_limits<int>::max()));
    twin.stage = read_twin_stage(file, root.at("stage"));
    read_twin_camera(file, root.at("camera"), twin);
    twin.scene = read_scene(root.at("scene"));
    if (const auto room = root.find("room"))
        twin.room = read_room(*room);
    file.finish();
    return twin;
}

}  // namespace etalon
