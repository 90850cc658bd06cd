#include "station/setup/station_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "calib/files/camera_file.h"
#include "compare/expect/expected_view.h"
#include "compare/make_detector.h"
#include "core/file/file_writing.h"
#include "core/file/sha256.h"
#include "core/file/text.h"
#include "stage/profile/profile.h"

namespace etalon {
namespace {

using Path = std::filesystem::path;

double number_or(const Value& parent, const char* key, double fallback, Range range) {
    const auto value = parent.find(key);
    return value ? value->number(range) : fallback;
}

int integer_or(const Value& parent, const char* key, int fallback, int low, int high) {
    const auto value = parent.find(key);
    return value ? value->integer(low, high) : fallback;
}

std::string text_or(const Value& parent, const char* key, const std::string& fallback) {
    const auto value = parent.find(key);
    return value ? value->text() : fallback;
}

std::string non_blank(const Value& value) {
    if (trimmed(value.text()).empty())
        value.fail("must not be empty");
    return value.text();
}

Path existing_file(const StrictFile& file, const Value& value) {
    const Path path = file.resolve(non_blank(value)).lexically_normal();
    if (const std::string cause = no_file_cause(path); !cause.empty())
        value.fail(fmt::format("{}: {}", cause, path.string()));
    return path;
}

CaptureSettings read_settings(const Value& camera, const CameraModel& model) {
    CaptureSettings settings;
    settings.width = model.width;
    settings.height = model.height;
    settings.bits = model.sensor ? model.sensor->bits : 8;
    const double exposure_us = number_or(camera, "exposure_us", 0.0, {1.0, 60e6});
    settings.exposure = std::chrono::microseconds(std::llround(exposure_us));
    settings.gain_db = number_or(camera, "gain_db", 0.0, {0.0, 100.0});
    if (const auto black_level = camera.find("black_level"))
        settings.black_level = black_level->number(units::one.either_sign());
    settings.format = text_or(camera, "format", "");
    settings.trigger = text_or(camera, "trigger", "");
    if (const auto controls = camera.find("controls"))
        for (const std::string& name : controls->keys())
            settings.controls[name] =
                controls->with_names().at(name).number(units::one.either_sign());
    return settings;
}

StationCamera read_camera_section(const Value& section, const Path& calibration) {
    StationCamera camera;
    camera.uri = non_blank(section.at("uri"));
    camera.model = read_any_camera(calibration);
    if (camera.model.projection.kind == Projection::telecentric)
        section.at("calibration")
            .fail("is of a telecentric camera: a distance is not in its images");
    camera.settings = read_settings(section, camera.model);
    camera.link.packet_size =
        integer_or(section, "packet_size", camera.link.packet_size, 576, 16384);
    camera.link.packet_delay =
        std::chrono::microseconds(integer_or(section, "packet_delay_us", 0, 0, 100000));
    camera.link.interface = text_or(section, "interface", "");
    camera.link.frame_timeout = std::chrono::milliseconds(
        integer_or(section, "frame_timeout_ms", static_cast<int>(camera.link.frame_timeout.count()),
                   1, 600000));
    camera.retries = integer_or(section, "retries", camera.retries, 0, 1000);
    return camera;
}

StationStage read_stage_section(const StrictFile& file, const Value& section) {
    StationStage stage;
    stage.profile = text_or(section, "profile", "generic");
    if (stage.profile.ends_with(".yaml"))
        stage.profile = existing_file(file, section.at("profile")).string();
    stage.link = read_stage_link(section.at("link"), named_stage_profile(stage.profile).link);
    stage.axes = read_axes(section.at("axes"));
    stage.rules = read_motion_rules(section, stage.axes);
    return stage;
}

Rigid read_mount(const Value& mount) {
    const auto rotation_deg = mount.at("rotation_deg").numbers(3, {-360.0, 360.0});
    const auto translation = mount.at("translation_mm").numbers(3, units::mm.either_sign());
    const Eigen::Vector3d rotation = Eigen::Map<const Eigen::Vector3d>(rotation_deg.data());
    return {rotation_from_vector(rotation * rad_per_deg),
            Eigen::Map<const Eigen::Vector3d>(translation.data())};
}

PlanRequest::Interval read_interval(const Value& value, const Axis& axis) {
    const AxisUnits units(axis.kind);
    const auto bounds = value.numbers(2, units.large().either_sign());
    if (bounds[0] > bounds[1])
        value.fail(fmt::format("must be [low, high], not [{}, {}]", bounds[0], bounds[1]));
    const double unit = units.per_large();
    const double low = bounds[0] * unit, high = bounds[1] * unit;
    if (low < axis.low || high > axis.high)
        value.fail(fmt::format("[{}, {}] leaves the soft limits [{}, {}] of axis {}", bounds[0],
                               bounds[1], axis.low / unit, axis.high / unit, axis.name));
    return {low, high};
}

PlanRequest read_plan(const Value& section, const std::vector<Axis>& axes) {
    PlanRequest plan;
    const Value volume = section.at("volume").with_names();
    for (const Axis& axis : axes)  // one that stays where it is says so with equal bounds
        plan.volume.push_back(read_interval(volume.at(axis.name), axis));
    plan.place = volume.place();
    plan.poses = section.at("poses").integer(2, 2000);
    plan.hold_out = section.at("hold_out").number({0.0, 0.9, true});
    if (const auto repeats = section.find("repeats"))
        plan.repeats = repeats->integer(0, 2000);
    plan.frames = section.at("frames").integer(1, 1000);
    plan.seed =
        static_cast<std::uint64_t>(section.at("seed").integer(0, std::numeric_limits<int>::max()));
    plan.settle = std::chrono::milliseconds(section.at("settle_ms").integer(0, 600000));
    return plan;
}

// Errors about the marker's name carry the place of the key that holds it.
std::string place_text(const Value& value) {
    const SourcePlace place = value.place();
    return fmt::format("{}:{}: {}", place.file, place.line, place.key);
}

DeclaredTemperature read_temperature(const Value& section) {
    constexpr double per_million = 1e-6;
    const Range expansion{-100.0, 1000.0};
    DeclaredTemperature temperature;
    temperature.standard_uncertainty_k = section.at("uncertainty_k").number({0.0, 100.0});
    temperature.marker_expansion_per_k =
        section.at("marker_expansion_ppm_per_k").number(expansion) * per_million;
    temperature.stage_expansion_per_k =
        section.at("stage_expansion_ppm_per_k").number(expansion) * per_million;
    temperature.reference_c =
        number_or(section, "reference_c", temperature.reference_c, {-40.0, 85.0});
    return temperature;
}

std::string read_day(const Value& value) {
    if (!days_of_date(value.text()))
        value.fail(fmt::format("'{}' is no day as 2026-03-07", value.text()));
    return value.text();
}

// It must not leave more uncertainty than `declared_key` declares, in the certificate's unit.
struct ReferenceKind {
    std::string name;
    Unit unit;
    const char* unit_in_keys;
    const char* declared_key;
    std::optional<double> declared;
};

// Nothing without its section.
void add_reference(std::vector<TracedReference>& references, const std::optional<Value>& section,
                   const ReferenceKind& kind) {
    constexpr double rounding = 1e-9;
    if (!section)
        return;
    const auto key = [&](const char* start) { return std::string(start) + kind.unit_in_keys; };
    TracedReference one;
    one.name = kind.name;
    one.unit = kind.unit.name;
    one.value = section->at(key("value_")).number(kind.unit.either_sign());
    one.expanded_uncertainty = section->at(key("U_")).number(kind.unit.positive());
    one.certificate = non_blank(section->at("certificate"));
    one.laboratory = non_blank(section->at("laboratory"));
    one.date = read_day(section->at("date"));
    one.due = read_day(section->at("due"));
    if (one.due <= one.date)
        section->at("due").fail(fmt::format("must be after its date {}", one.date));
    if (!kind.declared)
        section->fail(
            fmt::format("is a certificate of what '{}' does not declare", kind.declared_key));
    if (one.standard_uncertainty() > *kind.declared * (1.0 + rounding))
        section->fail(
            fmt::format("leaves a standard uncertainty of {:.4g} {} (of value and U/2), and '{}' "
                        "declares {:.4g}",
                        one.standard_uncertainty(), one.unit, kind.declared_key, *kind.declared));
    references.push_back(one);
}

std::optional<double> times(const std::optional<double>& value, double factor) {
    return value ? std::optional(*value * factor) : std::nullopt;
}

// Of a station whose axes, marker and temperature have been read.
std::vector<TracedReference> read_references(const Value& section, const StationFile& station) {
    std::vector<TracedReference> references;
    if (const auto scales = section.find("stage_scale")) {
        const Value named = scales->with_names();
        for (const Axis& axis : station.stage.axes)
            add_reference(references, named.find(axis.name),
                          {"stage scale " + axis.name, units::ppm, "ppm", "scale_uncertainty_ppm",
                           times(axis.scale_uncertainty, 1e6)});
    }
    add_reference(references, section.find("marker_size"),
                  {"marker print size", units::ppm, "ppm", "marker_size_uncertainty_ppm",
                   times(station.marker_size_uncertainty, 1e6)});
    add_reference(references, section.find("marker_flatness"),
                  {"marker flatness", units::um, "um", "marker_flatness_um",
                   times(station.marker_flatness_mm, 1e3)});
    constexpr double any = std::numeric_limits<double>::infinity();
    add_reference(references, section.find("thermometer"),
                  {"thermometer", units::kelvin, "k", "", any});
    return references;
}

InputFile identify(const std::string& role, const Path& path) {
    return {role, path, sha256_of_file(path), ""};
}

// The value at the end of a chain of keys, if all are there.
std::optional<Value> value_at(const Value& root, std::initializer_list<const char*> keys) {
    std::optional<Value> value = root;
    for (const char* key : keys) {
        if (!value || !value->is_mapping())
            return std::nullopt;
        value = value->find(key);
    }
    return value;
}

void add_camera_parts(std::vector<InputFile>& inputs, const Path& calibration) {
    if (!is_etalon_file(calibration))
        return;
    const StrictFile file(calibration, "camera/1");
    if (const auto profile = value_at(file.root(), {"lens", "psf", "measured", "file"}))
        inputs.push_back(identify("point spread", file.resolve(profile->text())));
    if (const auto table = value_at(file.root(), {"sensor", "transfer", "table", "file"}))
        inputs.push_back(identify("transfer table", file.resolve(table->text())));
}

// A profile extends another one beside it, or a built-in one. Their reader has refused circles.
void add_profiles(std::vector<InputFile>& inputs, Path profile) {
    std::error_code ignored;
    while (std::filesystem::is_regular_file(profile, ignored)) {
        inputs.push_back(identify("stage profile", profile));
        const StrictFile file(profile, "stage-profile/1");
        const auto base = file.root().find("extends");
        if (!base)
            return;
        profile = file.resolve(base->text() + ".yaml");
    }
}

Path full_path(const Path& path) {
    return std::filesystem::absolute(path).lexically_normal();
}

bool is_within(const Path& path, const Path& folder) {
    const Path relative = path.lexically_relative(folder);
    return !relative.empty() && *relative.begin() != "..";
}

Path common_folder(const std::vector<InputFile>& inputs) {
    Path folder = full_path(inputs.front().path).parent_path();
    for (const InputFile& input : inputs)
        while (!is_within(full_path(input.path), folder))
            folder = folder.parent_path();
    return folder;
}

std::string difference(const InputFile& recorded, const std::string& sha256) {
    return fmt::format("is not the {} file that the run was made with: its SHA-256 is {}, not {}",
                       recorded.role, sha256, recorded.sha256);
}

void require_recorded_bytes(const Path& record, const InputFile& input) {
    const Path copy = Path(input.copy).lexically_normal();
    if (copy.is_absolute() || !is_within(copy, "inputs"))
        throw ConfigError({record.string()},
                          fmt::format("the copy '{}' is not in inputs/", input.copy));
    const std::string found = sha256_of_file(record / copy);
    if (found != input.sha256)
        throw ConfigError({(record / copy).string()}, difference(input, found));
}

// Station, calibration and limits, then what these name: the camera's point spread and transfer
// table, the stage's profile and those that it extends. `profile` may be a built-in one's name.
std::vector<InputFile> station_inputs(const Path& station, const Path& calibration,
                                      const Path& limits, const std::string& profile) {
    std::vector<InputFile> inputs = {identify("station", station),
                                     identify("calibration", calibration),
                                     identify("limits", limits)};
    add_camera_parts(inputs, calibration);
    if (profile.ends_with(".yaml"))
        add_profiles(inputs, profile);
    return inputs;
}

}  // namespace

ExpectedScene expected_scene(const StationFile& station) {
    return {station.camera.model, station.marker, station.detector, station.background,
            station.white_level};
}

StationFile read_station(const Path& path, const Path& given_calibration) {
    const StrictFile file(path, "station/1");
    const Value root = file.root();
    StationFile station;
    station.id = non_blank(root.at("id"));
    const Value camera = root.at("camera");
    const Value named = camera.at("calibration");
    const Path calibration =
        given_calibration.empty() ? existing_file(file, named) : given_calibration;
    station.camera = read_camera_section(camera, calibration);
    station.stage = read_stage_section(file, root.at("stage"));
    if (const auto mount = root.find("marker_mount"))
        station.carriage_from_marker_nominal = read_mount(*mount);
    if (const auto mount = root.find("camera_mount"))
        station.camera_from_base_nominal = read_mount(*mount);
    if (const auto ppm = root.find("marker_size_uncertainty_ppm"))
        station.marker_size_uncertainty = ppm->number(units::ppm.non_negative()) * 1e-6;
    if (const auto um = root.find("marker_flatness_um"))
        station.marker_flatness_mm = um->number(units::um.non_negative()) * 1e-3;
    if (const auto temperature = root.find("temperature"))
        station.temperature = read_temperature(*temperature);
    if (const auto environment = root.find("environment"))
        station.environment = read_environment(*environment);
    if (const auto references = root.find("references"))
        station.references = read_references(*references, station);
    station.background = number_or(root, "background", 1.0, {0.0, 1.0});
    station.white_level = number_or(root, "white_level", 1.0, {0.0, 1.0, true});
    station.plan = read_plan(root.at("plan"), station.stage.axes);
    const Value marker = root.at("marker");
    const auto detector = root.find("detector");
    station.detector = detector ? detector->text() : "auto";
    const Value limits = root.at("limits");
    const Path limits_path = existing_file(file, limits);
    file.finish();

    station.marker = parse_marker(marker.text(), place_text(marker));
    make_detector(station.detector, station.marker,  // thrown away: only whether there is one
                  place_text(detector.value_or(marker)));
    station.limits = read_limits(limits_path);
    station.inputs = station_inputs(path, calibration, limits_path, station.stage.profile);
    return station;
}

std::string exact_knowledge(const StationFile& station) {
    std::vector<std::string> names;
    const auto add = [&](const std::optional<double>& uncertainty, const std::string& name) {
        if (uncertainty == 0.0)
            names.push_back(name);
    };
    for (const Axis& axis : station.stage.axes) {
        add(axis.scale_uncertainty, "scale of " + axis.name);
        add(axis.repeatability, "repeatability of " + axis.name);
        add(axis.backlash_uncertainty, "backlash of " + axis.name);
        add(axis.read_noise, "read-back of " + axis.name);
        add(axis.direction_uncertainty, "direction of " + axis.name);
        add(axis.point_uncertainty, "point of " + axis.name);
    }
    add(station.marker_size_uncertainty, "marker size");
    add(station.marker_flatness_mm, "marker flatness");
    if (station.temperature)
        add(station.temperature->standard_uncertainty_k, "temperature");
    if (names.empty())
        return "";
    return fmt::format(
        "declared with an uncertainty of 0, so taken for exact: {}. Without its key "
        "each is unknown",
        fmt::join(names, ", "));
}

StationStage read_station_stage(const Path& path) {
    const StrictFile file(path, "station/1");
    return read_stage_section(file, file.root().at("stage"));
}

double TracedReference::standard_uncertainty() const {
    return std::hypot(value, expanded_uncertainty / 2.0);
}

const TracedReference* reference_named(const std::vector<TracedReference>& references,
                                       const std::string& name) {
    const auto found = std::ranges::find(references, name, &TracedReference::name);
    return found == references.end() ? nullptr : &*found;
}

void copy_inputs(std::vector<InputFile>& inputs, const Path& record) {
    const Path folder = common_folder(inputs);
    for (InputFile& input : inputs) {
        const Path copy = "inputs" / full_path(input.path).lexically_relative(folder);
        std::error_code error;
        make_folder((record / copy).parent_path());
        std::filesystem::copy_file(input.path, record / copy,
                                   std::filesystem::copy_options::overwrite_existing, error);
        if (error)
            fail_writing(record / copy, error);
        input.copy = copy.generic_string();
        require_recorded_bytes(record, input);
        for (Path kept = full_path(record / copy); kept != full_path(record).parent_path();
             kept = kept.parent_path())
            sync_to_disk(kept);
    }
    sync_to_disk(full_path(record).parent_path());
}

StationFile read_recorded_station(const Path& record, const std::vector<InputFile>& inputs) {
    if (inputs.empty() || inputs.front().role != "station")
        throw ConfigError({record.string()}, "the record names no station file");
    for (const InputFile& input : inputs)
        require_recorded_bytes(record, input);
    const bool has_calibration = inputs.size() > 1 && inputs[1].role == "calibration";
    StationFile station = read_station(record / inputs.front().copy,
                                       has_calibration ? record / inputs[1].copy : Path());
    require_same_inputs(inputs, station.inputs);
    for (std::size_t i = 0; i < inputs.size(); ++i)
        if (station.inputs[i].path == station.stage.profile)
            station.stage.profile = inputs[i].path.string();
    station.inputs = inputs;
    return station;
}

void require_same_inputs(const std::vector<InputFile>& recorded,
                         const std::vector<InputFile>& given) {
    for (std::size_t i = 0; i < std::min(recorded.size(), given.size()); ++i)
        if (recorded[i].role != given[i].role || recorded[i].sha256 != given[i].sha256)
            throw ConfigError({given[i].path.string()}, difference(recorded[i], given[i].sha256));
    if (recorded.size() != given.size())
        throw ConfigError(
            {given.front().path.string()},
            fmt::format("names {} files, the run was made with {}", given.size(), recorded.size()));
}

}  // namespace etalon
