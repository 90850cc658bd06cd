#include "station/setup/station_file.h"

#include <fmt/format.h>

#include "calib/files/camera_file.h"
#include "compare/expect/expected_view.h"
#include "compare/make_detector.h"
#include "compare/qualification/limits_file.h"
#include "core/config/strict_reader.h"
#include "core/geometry/units.h"
#include "stage/profile/profile.h"
#include "station/setup/station_inputs.h"

namespace etalon {
namespace {

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

std::string non_empty_text(const Value& value) {
    if (value.text().empty())
        value.fail("must not be empty");
    return value.text();
}

std::filesystem::path existing_file(const StrictFile& file, const Value& value) {
    const std::filesystem::path path = file.resolve(non_empty_text(value)).lexically_normal();
    std::error_code ignored;
    if (!std::filesystem::is_regular_file(path, ignored))
        value.fail(fmt::format("no such file: {}", path.string()));
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

StationCamera read_camera_section(const Value& section, const std::filesystem::path& calibration) {
    StationCamera camera;
    camera.uri = non_empty_text(section.at("uri"));
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

// A profile that is a file is meant relative to this one.
std::string read_profile_name(const StrictFile& file, const Value& section) {
    const std::string name = text_or(section, "profile", "generic");
    return name.ends_with(".yaml") ? existing_file(file, section.at("profile")).string() : name;
}

StationStage read_stage_section(const StrictFile& file, const Value& section) {
    StationStage stage;
    stage.profile = read_profile_name(file, section);
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
    const bool rotary = axis.kind == Axis::Kind::rotary;
    const auto bounds = value.numbers(2, (rotary ? units::deg : units::mm).either_sign());
    if (bounds[0] > bounds[1])
        value.fail(fmt::format("must be [low, high], not [{}, {}]", bounds[0], bounds[1]));
    const double unit = rotary ? rad_per_deg : 1.0;
    const double low = bounds[0] * unit, high = bounds[1] * unit;
    if (low < axis.low || high > axis.high)
        value.fail(fmt::format("[{}, {}] leaves the soft limits [{}, {}] of axis {}", bounds[0],
                               bounds[1], axis.low / unit, axis.high / unit, axis.name));
    return {low, high};
}

// Every axis must be named: one that stays where it is says so with equal bounds.
std::vector<PlanRequest::Interval> read_volume(const Value& volume, const std::vector<Axis>& axes) {
    std::vector<PlanRequest::Interval> intervals;
    for (const Axis& axis : axes)
        intervals.push_back(read_interval(volume.at(axis.name), axis));
    return intervals;
}

PlanRequest read_plan(const Value& section, const std::vector<Axis>& axes) {
    PlanRequest plan;
    const Value volume = section.at("volume").with_names();
    plan.volume = read_volume(volume, axes);
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

Marker read_marker(const Value& spec, const std::string& detector, const std::string& place) {
    Marker marker = parse_marker(spec.text(), place_text(spec));
    make_detector(detector, marker, place);  // thrown away: only whether there is one
    return marker;
}

}  // namespace

ExpectedScene expected_scene(const StationFile& station) {
    return {station.camera.model, station.marker, station.detector, station.background,
            station.white_level};
}

StationFile read_station(const std::filesystem::path& path,
                         const std::filesystem::path& given_calibration) {
    const StrictFile file(path, "station/1");
    const Value root = file.root();
    StationFile station;
    station.id = non_empty_text(root.at("id"));
    const Value camera = root.at("camera");
    const Value named = camera.at("calibration");
    const std::filesystem::path calibration =
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
    const std::filesystem::path limits_path = existing_file(file, limits);
    file.finish();

    station.marker = read_marker(marker, station.detector, place_text(detector.value_or(marker)));
    station.limits = read_limits(limits_path);
    station.inputs = station_inputs(path, calibration, limits_path, station.stage.profile);
    return station;
}

StationStage read_station_stage(const std::filesystem::path& path) {
    const StrictFile file(path, "station/1");
    return read_stage_section(file, file.root().at("stage"));
}

}  // namespace etalon
