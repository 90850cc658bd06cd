#include "mocks/twin/twin_file.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <string>

#include "calib/files/camera_file.h"
#include "core/config/strict_reader.h"
#include "core/geometry/units.h"
#include "sim/marker/marker.h"

namespace etalon {
namespace {

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
    const std::vector<double> rotation_deg =
        value.at("rotation_deg").numbers(3, units::deg.either_sign());
    const std::vector<double> translation_mm =
        value.at("translation_mm").numbers(3, units::mm.either_sign());
    const Eigen::Vector3d rotation(rotation_deg[0], rotation_deg[1], rotation_deg[2]);
    return {rotation_from_vector(rotation * rad_per_deg),
            {translation_mm[0], translation_mm[1], translation_mm[2]}};
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
