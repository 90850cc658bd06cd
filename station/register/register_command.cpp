// `etalon register`: where stage and marker stand, with what the motions cannot tell.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/file/text.h"
#include "core/program/print_stderr.h"
#include "report/json_text.h"
#include "report/number_text.h"
#include "station/register/stage_registration.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

// Either a record, or a station with positions.
struct RegisterArguments {
    std::filesystem::path record;              // folder of a qualification
    std::filesystem::path station, positions;  // positions: CSV of photographs and axis positions
    std::string detector;                      // empty: the station's own
    bool json = false;
};

void print_transform(const char* name, const Rigid& transform, const Vector6d& deviations) {
    fmt::print("{:<21}{}\n", name, pose_columns(transform));
    fmt::print("{:<21}{}\n", "  +-", deviation_columns(deviations));
}

void print_freedoms(const StageRegistration& result) {
    const Registration& registration = result.registration;
    for (const GaugeFreedom& freedom : registration.freedoms)
        fmt::print("free: {};\n  fixed at the nominal mounting\n", freedom.name);
    for (const PoorlyConstrainedDirection& weak : registration.weak)
        fmt::print("poorly constrained: {},\n  +- {:.3g} {}\n", weak.name,
                   result.scale * weak.deviation, weak.is_shift() ? "mm" : "rad");
}

void print_residuals(const StageRegistration& result, std::size_t points) {
    const Registration& registration = result.registration;
    if (result.rounds > 0)
        fmt::print("residual {:.4f} px RMS; {} of {} corners flagged as outliers\n",
                   registration.residual_rms_px, registration.down_weighted_points,
                   points * static_cast<std::size_t>(result.used));
    else
        fmt::print(
            "residual {:.2f} stated standard deviations RMS; {} of {} poses flagged as outliers\n",
            std::sqrt(registration.reduced_squares), registration.down_weighted_points,
            result.used);
    const RegisteredPhoto* worst = nullptr;
    for (const RegisteredPhoto& photo : result.photos)
        if (photo.failure.empty() && (!worst || photo.residual.translation_mm.norm() >
                                                    worst->residual.translation_mm.norm()))
            worst = &photo;
    if (worst)
        fmt::print(
            "largest difference of a pose {:.3f} mm{}, {}\n", worst->residual.translation_mm.norm(),
            result.rounds > 0 ? " with the detector's bias" : "", worst->photo.filename().string());
}

void print_text(const StationFile& station, const StageRegistration& result) {
    const Registration& registration = result.registration;
    fmt::print("{} of {} photographs, detector {}\n", result.used, result.photos.size(),
               result.detector);
    fmt::print("motion: {}\n", registration.motion);
    fmt::print("rank {} of 12, condition number {:.3g}\n", registration.rank,
               registration.condition_number);
    fmt::print("{:<21}{}\n", "", pose_heading());
    print_transform("camera_from_base", registration.camera_from_base, result.deviations.head<6>());
    print_transform("carriage_from_marker", registration.carriage_from_marker,
                    result.deviations.tail<6>());
    fmt::print("{:<21}{}\n", "  nominal", pose_columns(station.carriage_from_marker_nominal));
    print_freedoms(result);
    print_residuals(result, station.marker.points_mm.size());
}

Json json_of(const RegisteredPhoto& photo) {
    if (!photo.failure.empty())
        return {{"photo", photo.photo.string()}, {"failure", photo.failure}};
    return {{"photo", photo.photo.string()},
            {"difference_mm", numbers_of(photo.residual.translation_mm)},
            {"difference_rad", numbers_of(photo.residual.rotation_rad)}};
}

void print_json(const StationFile& station, const StageRegistration& result) {
    const Registration& registration = result.registration;
    std::vector<std::vector<double>> covariance;
    for (int k = 0; k < 12; ++k)
        covariance.push_back(
            numbers_of(result.scale * result.scale * registration.covariance.row(k)));
    const Json json = {
        {"etalon", "registration/1"},
        {"station", station.id},
        {"marker", station.marker.spec},
        {"detector", result.detector},
        {"photos_used", result.used},
        {"motion", registration.motion},
        {"camera_from_base", pose_numbers(registration.camera_from_base)},
        {"carriage_from_marker", pose_numbers(registration.carriage_from_marker)},
        {"carriage_from_marker_nominal", pose_numbers(station.carriage_from_marker_nominal)},
        {"deviations", numbers_of(result.deviations)},
        {"covariance", covariance},
        {"rank", registration.rank},
        {"condition_number", registration.condition_number},
        {"freedoms",
         json_list(
             registration.freedoms,
             [](const GaugeFreedom& freedom) -> Json {
                 return {{"name", freedom.name}, {"direction", numbers_of(freedom.direction)}};
             })},
        {"badly_determined", json_list(registration.weak,
                                       [&](const PoorlyConstrainedDirection& weak) -> Json {
                                           return {{"name", weak.name},
                                                   {"direction", numbers_of(weak.direction)},
                                                   {"deviation", result.scale * weak.deviation},
                                                   {"unit", weak.is_shift() ? "mm" : "rad"},
                                                   {"worth_photographs", weak.worth_poses}};
                                       })},
        {"residual_rms_px", result.rounds > 0 ? Json(registration.residual_rms_px) : Json()},
        {"reduced_squares", registration.reduced_squares},
        {"down_weighted", registration.down_weighted_points},
        {"bias_correction_rounds", result.rounds},
        {"photos", json_list(result.photos, [](const auto& one) { return json_of(one); })}};
    std::puts(text_of(json).c_str());
}

int run_register(const RegisterArguments& arguments) {
    if (arguments.record.empty() == arguments.positions.empty())
        throw ConfigError({"--positions"}, "give either a record's folder or --positions");
    if (arguments.record.empty() && arguments.station.empty())
        throw ConfigError({"--station"}, "is needed with --positions");
    const StationFile station = read_station(
        arguments.station.empty() ? station_of_record(arguments.record) : arguments.station);
    const std::vector<StagePhoto> photos =
        arguments.record.empty() ? read_stage_photos(arguments.positions, station.stage.axes)
                                 : read_record_photos(arguments.record, station.stage.axes);
    const StageRegistration result = register_photos(
        station, photos, arguments.detector.empty() ? station.detector : arguments.detector);
    for (const RegisteredPhoto& photo : result.photos)
        if (!photo.failure.empty())
            print_stderr("{}: {}\n", photo.photo.string(), photo.failure);
    if (arguments.json)
        print_json(station, result);
    else
        print_text(station, result);
    return 0;
}

}  // namespace

void declare_register(Command& program) {
    auto [command, asked] = program.add(
        run_register, "register", "find a stage before the camera, a marker on the stage",
        "Estimates X = camera_from_base and Y = carriage_from_marker from photographs\n"
        "at known positions of the stage, corrected for the detector's bias. Names the\n"
        "directions that no motion of the stage can tell (they are fixed at the\n"
        "station's nominal mounting) and those that the poses hardly tell. Poses that\n"
        "move less than the stage can are refused, by name. No verdict, no device.\n\n"
        "The CSV has a column `photo` (seen from its folder) and one for each axis:\n"
        "x_mm, y_mm, rz_deg ...\n\n"
        "Of a qualification's record all poses count, training and hold-out, with what\n"
        "the axes read.\n\n"
        "Examples:\n"
        "  etalon register --station station.yaml --positions positions.csv\n"
        "  etalon register run-7\n");
    command.option("RECORD", asked->record, "folder of a qualification");
    command.option("--station", asked->station,
                   "calibration, axes, marker, mounting\n(default: that of the record)", "FILE");
    command.option("--positions", asked->positions, "CSV of photographs and positions", "CSV");
    command.option("--detector", asked->detector,
                   "the station's own (default), a detector's name,\n"
                   "or photometric: poses from all pixels, each\nweighted by its covariance",
                   "NAME");
}

}  // namespace etalon
