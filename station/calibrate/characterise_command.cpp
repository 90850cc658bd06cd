// `etalon characterise`: what a camera's lens and sensor do, measured from photographs and written
// into its camera file. The measuring is in compare/characterise/characterisation.cpp.
#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "calib/files/camera_file.h"
#include "compare/characterise/characterisation.h"
#include "compare/photo_pose.h"
#include "core/config/csv_file.h"
#include "core/program/errors.h"
#include "report/json_text.h"
#include "station/calibrate/characterise_report.h"
#include "station/calibrate/commands.h"
#include "station/shell/command.h"
#include "station/shell/photo_files.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;
using Paths = std::vector<std::filesystem::path>;

CharacteriseInput read_input(const CharacteriseArguments& arguments) {
    Paths exposed;
    std::vector<double> exposures_us;
    if (!arguments.exposures.empty())  // files are seen from the CSV's folder
        for (const CsvRow& row : read_csv(arguments.exposures, {"file,exposure_us"}).rows) {
            exposures_us.push_back(row.number(1, units::us.positive()));
            exposed.push_back(arguments.exposures.parent_path() / row.cells[0]);
        }
    const auto joined = [](std::initializer_list<const Paths*> lists) {
        Paths all;
        for (const Paths* list : lists)
            all.insert(all.end(), list->begin(), list->end());
        return all;
    };
    const Paths of_noise = joined({&arguments.repeats, &arguments.darks, &exposed});
    const Paths all = joined({&arguments.photos, &arguments.flats, &of_noise});
    if (all.empty())
        throw ConfigError({"PHOTOS"}, "no photograph given");
    CharacteriseInput input{.camera = read_camera_for(arguments.camera, all),
                            .target = parse_calibration_target(arguments.target, "--target")};
    require_distinct(all);
    const auto read = [&](const std::filesystem::path& path) {
        return read_photo(path, input.camera, arguments.camera);
    };
    for (const auto& path : arguments.photos)
        input.photos.push_back({path.string(), read(path)});
    for (const auto& path : arguments.flats)
        input.flats.push_back({path.string(), read(path)});
    std::ranges::transform(arguments.repeats, std::back_inserter(input.repeats), read);
    std::ranges::transform(arguments.darks, std::back_inserter(input.darks), read);
    for (std::size_t i = 0; i < exposed.size(); ++i)
        input.exposures.push_back({read(exposed[i]), exposures_us[i], exposed[i].string()});
    if (const auto lossy = std::ranges::find_if(of_noise, is_jpeg); lossy != of_noise.end())
        input.lossy_file = lossy->string();
    return input;
}

const char* word(Transfer::Kind kind) {
    constexpr std::array words{"linear", "rec709", "table"};
    return words[static_cast<std::size_t>(kind)];
}

const char* word(Illumination::Kind kind) {
    constexpr std::array words{"uniform", "cos4", "polynomial"};
    return words[static_cast<std::size_t>(kind)];
}

// One line each, `WORDS VALUE +- U UNIT`: U = 2u, two digits of it.
void print_words(const Characterisation& result) {
    for (const MeasuredValue& value : result.values)
        fmt::print("{}\n", with_uncertainty(value));
    if (result.transfer)
        fmt::print("transfer {}\n", word(result.transfer->transfer.kind));
    if (result.illumination)
        fmt::print("illumination {}\n", word(result.illumination->illumination.kind));
    for (const NotMeasured& missing : result.not_measured)
        fmt::print("{}: {}: {}\n", missing.was_refused ? "refused" : "not measured",
                   missing.quantity, missing.reason);
}

ordered_json values_json(const Characterisation& result) {
    ordered_json json = ordered_json::object();
    for (const MeasuredValue& value : result.values)
        json[value.key] = {{"value", value.value},
                           {"standard_uncertainty", value.standard_uncertainty},
                           {"expanded_uncertainty", 2.0 * value.standard_uncertainty},
                           {"coverage_factor", 2},
                           {"unit", value.unit},
                           {"from", value.how},
                           {"written", value.is_written}};
    return json;
}

ordered_json json_of(const TransferCandidate& candidate) {
    return {{"kind", word(candidate.kind)},
            {"chi_square", candidate.chi_square},
            {"degrees_of_freedom", candidate.degrees_of_freedom},
            {"bic", candidate.information_criterion}};
}

ordered_json json_of(const NoiseLevel& level) {
    return {{"signal_dn", level.signal_dn},
            {"variance_dn2", level.variance_dn2},
            {"standard_uncertainty_dn2", level.standard_uncertainty_dn2},
            {"used", level.is_used}};
}

ordered_json json_of(const NotMeasured& missing) {
    return {{"quantity", missing.quantity},
            {"reason", missing.reason},
            {"refused", missing.was_refused}};
}

ordered_json json_of(const ModulationRow& row) {
    return {row.cycles_per_px, row.modulation, row.standard_uncertainty};
}

ordered_json json_of(const std::optional<BlurWidth>& zone) {
    return zone ? ordered_json{{"sigma_px", zone->sigma_px},
                               {"standard_uncertainty", zone->standard_uncertainty_px},
                               {"edges", zone->edges}}
                : ordered_json(nullptr);
}

ordered_json json_of(const EdgeModulation& at) {
    return {{"photo", at.photo},
            {"centre_px", {at.centre_px.x(), at.centre_px.y()}},
            {"angle_deg", at.edge.angle_deg},
            {"mtf50_cycles_per_px", at.edge.mtf50_cycles_per_px},
            {"at_nyquist", at.edge.at_nyquist},
            {"rows",
             json_list(at.edge.modulation, [](const ModulationRow& row) { return json_of(row); })}};
}

template <class List>
ordered_json list_of(const List& list) {
    return json_list(list, [](const auto& each) { return json_of(each); });
}

ordered_json transfer_json(const TransferEstimate& estimate) {
    ordered_json json = {{"kind", word(estimate.transfer.kind)},
                         {"candidates", list_of(estimate.candidates)},
                         {"lowest_code", estimate.lowest_code},
                         {"highest_code", estimate.highest_code},
                         {"saturation_code", estimate.saturation_code}};
    if (estimate.light_drift)
        json["light_drift"] = *estimate.light_drift;
    return json;
}

ordered_json photon_transfer_json(const PhotonTransfer& photon) {
    return {{"reduced_chi_square", photon.reduced_chi_square},
            {"degrees_of_freedom", photon.degrees_of_freedom},
            {"covariance_gain_read_noise", photon.covariance(0, 1)},
            {"brightness_drift", photon.brightness_drift},
            {"shift_px", photon.shift_px},
            {"noise_correlation", photon.noise_correlation},
            {"saturation_code", photon.saturation_code},
            {"levels", list_of(photon.levels)}};
}

ordered_json illumination_json(const Characterisation& result) {
    const IlluminationEstimate& estimate = *result.illumination;
    ordered_json covariance = ordered_json::array();
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j <= i; ++j)
            covariance.push_back(estimate.covariance(i, j));
    return {{"kind", word(estimate.illumination.kind)},
            {"from", result.illumination_from},
            {"polynomial", estimate.coefficients},
            {"standard_uncertainty", estimate.standard_uncertainty},
            {"covariance_lower", covariance},
            {"reduced_chi_square", estimate.reduced_chi_square},
            {"farthest_radius", estimate.farthest_radius}};
}

void print_json(const CharacteriseArguments& arguments, const Characterisation& result) {
    ordered_json json = {
        {"etalon", "characterisation/1"}, {"camera", arguments.out.string()},
        {"target", arguments.target},     {"photos_with_target", result.photos_with_target},
        {"values", values_json(result)},  {"not_measured", list_of(result.not_measured)},
        {"remarks", result.remarks}};
    if (result.transfer)
        json["transfer"] = transfer_json(*result.transfer);
    if (result.photon_transfer)
        json["photon_transfer"] = photon_transfer_json(*result.photon_transfer);
    if (result.illumination)
        json["illumination"] = illumination_json(result);
    if (result.point_spread)
        json["psf_zones"] = list_of(result.point_spread->zones);
    json["modulation"] = list_of(result.modulation);
    std::puts(text_of(json).c_str());
}

}  // namespace

int run_characterise(const CharacteriseArguments& given) {
    const PhotoFiles files(given.photos);
    CharacteriseArguments arguments = given;
    arguments.photos = files.paths();
    if (!arguments.edge.empty())
        return run_edge(arguments);
    for (const auto& [option, is_missing] : {std::pair("--camera", arguments.camera.empty()),
                                             {"--target", arguments.target.empty()},
                                             {"--out", arguments.out.empty()}})
        if (is_missing)
            throw ConfigError({option}, "is required, unless with --edge");
    const CharacteriseInput input = read_input(arguments);
    const Characterisation result = characterise(input);
    for (const std::string& remark : result.remarks)
        fmt::print(stderr, "{}\n", remark);
    write_camera(arguments.out, result.camera);
    if (!arguments.report.empty())
        write_characterise_report(arguments.report, input, result);
    if (arguments.json) {
        print_json(arguments, result);
    } else {
        print_words(result);
        fmt::print("camera {}\n", arguments.out.string());
        print_report(arguments.report);
    }
    return result.was_anything_refused() ? ExitCode::inconclusive : 0;
}

void declare_characterise(Command& program) {
    auto [command, asked] = program.add(
        run_characterise, "characterise", "measure blur, noise, tone and illumination of a camera",
        "Writes the camera file with the measured values and their uncertainties, and\n"
        "prints a line `QUANTITY VALUE +- U` each (k = 2). What is not given is not\n"
        "measured. Exit code 2 when photographs were given that cannot be used.\n"
        "How to take them: docs/characterising.md.\n\n"
        "Example:\n"
        "  etalon characterise --camera camera.yml --target chessboard:9x6@25mm board*.png \\\n"
        "      --repeats still*.png --flat flat*.png --dark dark*.png \\\n"
        "      --exposures series.csv --out characterised.yml --report characterised\n"
        "  etalon characterise --edge auto chart.png --report edges\n");
    command.option("PHOTOS", asked->photos, "the target in several places and tilts");
    command.option("--camera", asked->camera, "calibration: ours or another tool's", "FILE");
    command.option("--target", asked->target, "the target, as for calibrating", "M");
    command.option("--repeats", asked->repeats, "one still view, two or more times", "PHOTOS");
    command.option("--flat", asked->flats, "a uniform field", "PHOTOS");
    command.option("--dark", asked->darks, "lens covered", "PHOTOS");
    command.option("--exposures", asked->exposures,
                   "CSV file,exposure_us: one still scene at\nseveral exposure times", "FILE");
    command.option("--out", asked->out, "camera.yml to write", "FILE");
    command.option(
        "--edge", asked->edge,
        "only the MTF, along slanted edges of any\nphotographs: auto finds them, or X,Y,WxH in px",
        "WHERE");
    command.option("--report", asked->report, "folder for report.html", "DIR");
}

}  // namespace etalon
