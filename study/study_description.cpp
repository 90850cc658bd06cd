#include "study/study_description.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "calib/camera/camera_model.h"
#include "core/file/sha256.h"
#include "core/file/text.h"
#include "core/geometry/units.h"
#include "core/program/errors.h"
#include "core/program/version.h"
#include "report/json_text.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

constexpr const char* kind = "study-record/1";

ordered_json json_of(const StudyDescription& description) {
    const auto detector_json = [](const StudyDescription::DetectorEntry& one) -> ordered_json {
        return {{"name", one.name}, {"detector", one.detector}, {"marker", one.marker}};
    };
    const auto axis_json = [](const StudyAxis& axis) -> ordered_json {
        return {{"name", axis.name}, {"unit", axis.unit}};
    };
    return {{"etalon", kind},
            {"id", description.id},
            {"camera", description.camera},
            {"poses", description.poses},
            {"volume", description.volume},
            {"detectors", json_list(description.detectors, detector_json)},
            {"variants", description.variants},
            {"axes", json_list(description.axes, axis_json)},
            {"made_from", ordered_json::parse(description.made_from)},
            {"shard", {description.shard.index, description.shard.count}}};
}

StudyDescription description_of(const ordered_json& json) {
    StudyDescription description;
    description.id = json.at("id");
    description.camera = json.at("camera");
    description.poses = json.at("poses");
    description.volume = json.at("volume");
    for (const auto& one : json.at("detectors"))
        description.detectors.push_back({one.at("name"), one.at("detector"), one.at("marker")});
    description.variants = json.at("variants").get<std::vector<std::string>>();
    for (const auto& axis : json.at("axes"))
        description.axes.push_back({axis.at("name"), axis.at("unit")});
    description.made_from = json.at("made_from").dump();
    description.shard = {json.at("shard").at(0), json.at("shard").at(1)};
    const Shard& shard = description.shard;
    if (shard.index < 1 || shard.index > shard.count || description.rows_per_pose() == 0)
        throw ConfigError({study_work.description}, "describes no study");
    return description;
}

std::string camera_words(const CameraModel& camera) {
    std::string words =
        fmt::format("{} x {} px, fx {:.6g} px", camera.width, camera.height, camera.intrinsics.fx);
    if (!camera.projection.is_flat())
        words += fmt::format(", {}", name_of(camera.projection.kind).name);
    if (camera.lens)
        words += fmt::format(", f/{:.3g} focused at {:.6g} mm", camera.lens->f_number,
                             camera.lens->focus_distance_mm);
    if (camera.sensor)
        words += camera.sensor->transfer.kind == Transfer::Kind::linear   ? ", linear"
                 : camera.sensor->transfer.kind == Transfer::Kind::rec709 ? ", Rec. 709"
                                                                          : ", measured curve";
    if (camera.sensor)
        words += camera.sensor->gain_e_per_dn > 0.0 ? ", with noise" : ", without noise";
    return words;
}

std::string range_words(const std::string& name, const std::optional<Interval>& range,
                        double unit = 1.0) {
    if (!range)
        return name + " all that is seen";
    if (range->is_fixed())
        return fmt::format("{} {:.6g}", name, range->low * unit);
    return fmt::format("{} {:.6g} to {:.6g}", name, range->low * unit, range->high * unit);
}

std::string volume_words(const StudyPoses& poses) {
    if (!poses.file.empty())
        return "listed in a file";
    const PoseVolume& v = poses.volume;
    const char* sequence = poses.sequence == SequenceKind::sobol          ? "Sobol"
                           : poses.sequence == SequenceKind::halton_faure ? "Halton (Faure)"
                                                                          : "Halton";
    return fmt::format("{}, {}, {} mm; {}, {}, {} deg; {} points, seed {}",
                       range_words("x", v.x_mm), range_words("y", v.y_mm), range_words("z", v.z_mm),
                       range_words("roll", v.roll, deg_per_rad),
                       range_words("pitch", v.pitch, deg_per_rad),
                       range_words("yaw", v.yaw, deg_per_rad), sequence, poses.seed);
}

}  // namespace

StudyDescription describe(const StudyFile& study, const std::filesystem::path& file,
                          const std::vector<StudyVariant>& variants, const Shard& shard) {
    StudyDescription description{.id = study.id,
                                 .camera = camera_words(study.camera),
                                 .poses = static_cast<std::size_t>(study.poses.count),
                                 .volume = volume_words(study.poses),
                                 .shard = shard};
    for (const StudiedDetector& one : study.detectors)
        description.detectors.push_back({one.name, one.detector, one.marker.spec});
    for (const StudyVariant& variant : variants)
        description.variants.push_back(variant.name);
    for (const StudiedDisturbance& one : study.disturbances)
        description.axes.push_back({one.axis->name, one.axis->unit});
    if (!study.focus_mm.empty())
        description.axes.push_back({"focus-mm", "mm"});
    ordered_json made_from{{"version", version},
                           {"study_sha256", sha256_of_file(file)},
                           {"camera_sha256", camera_sha256(study.camera_file, study.camera)}};
    if (!study.poses.file.empty())
        made_from["poses_sha256"] = sha256_of_file(study.poses.file);
    for (const StudiedDetector& one : study.detectors)
        if (const std::string name = marker_file(one.marker); !name.empty())
            made_from["marker_files_sha256"][name] = sha256_of_file(name);
    description.made_from = made_from.dump();
    return description;
}

StudyDescription read_description(const std::filesystem::path& folder) {
    const std::filesystem::path path = folder / study_work.description;
    const ordered_json json = read_json(path);
    if (!json.is_object() || json.value("etalon", ordered_json()) != kind)
        throw ConfigError({path.string()}, std::string("is not of ") + kind);
    try {
        return description_of(json);
    } catch (const ordered_json::exception& error) {
        throw ConfigError({path.string()}, error.what());
    }
}

std::string description_text(const StudyDescription& description) {
    return text_of(json_of(description));
}

}  // namespace etalon
