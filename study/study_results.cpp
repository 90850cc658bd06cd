#include "study/study_results.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/file/sha256.h"
#include "core/file/text.h"
#include "core/geometry/units.h"
#include "core/program/version.h"
#include "report/json_text.h"
#include "report/result_table.h"

namespace etalon {

ETALON_MEMBERS_TO_JSON(StudyAxis, name, unit)
ETALON_MEMBERS_TO_JSON(StudyDescription::DetectorEntry, name, detector, marker)

namespace {

constexpr const char* kind = "study-record/1";
constexpr ShardedWork study_work{"study", "pose", "study merge", "study.json"};

Json json_of(const StudyDescription& description) {
    return {{"etalon", kind},
            {"id", description.id},
            {"camera", description.camera},
            {"poses", description.poses},
            {"volume", description.volume},
            {"detectors", description.detectors},
            {"variants", description.variants},
            {"axes", description.axes},
            {"made_from", Json::parse(description.made_from)},
            {"shard", {description.shard.index, description.shard.count}}};
}

StudyDescription description_of(const Json& json) {
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

void append_numbers(std::string& line, std::span<const double> numbers) {
    for (const double number : numbers)
        fmt::format_to(std::back_inserter(line), "{:.6f},", number);
}

std::string findings_text(const StudyFinding& finding, const std::string& common) {
    std::string line = fmt::format("{:d},{:d},{:.3f},", finding.error.has_value(),
                                   finding.error && finding.error->flip, finding.size_px);
    if (finding.corner_rms_px)
        fmt::format_to(std::back_inserter(line), "{:.6f}", *finding.corner_rms_px);
    line += "," + common;
    if (finding.error)
        append_numbers(line, finding.error->measures);
    else
        line.append(error_measure_count, ',');
    return line + csv_text(finding.failure) + "\n";
}

// The first line of results.csv, with its end.
std::string results_header(const StudyDescription& description) {
    std::string line =
        "pose,variant,detector,detected,flip,size_px,corner_rms_px,"
        "x_mm,y_mm,z_mm,roll_deg,pitch_deg,yaw_deg";
    for (const StudyAxis& axis : description.axes)
        line += "," + axis.name;
    return line +
           ",x_error_mm,y_error_mm,z_error_mm,roll_error_deg,pitch_error_deg,yaw_error_deg,"
           "distance_mm,angle_deg,failure\n";
}

RowsDescription rows_of(const StudyDescription& description) {
    return {study_work, text_of(json_of(description)), results_header(description),
            description.poses, description.rows_per_pose()};
}

// Places of the fields in a line.
struct Fields {
    explicit Fields(const StudyDescription& description)
        : axes(13), errors(axes + description.axes.size()), failure(errors + error_measure_count) {}
    static constexpr std::size_t detected = 3, flip = 4, size = 5, corner_rms = 6, truth = 7;
    std::size_t axes, errors, failure;
};

class ResultsReader {
public:
    ResultsReader(const std::filesystem::path& folder, StudyResults& results)
        : path_(folder / "results.csv"), file_(path_, std::ios::binary), results_(results) {
        next_line();
        if (line_ + "\n" != results_header(results.description))
            fail("is not the header of this study");
    }

    void read_all() {
        const StudyDescription& description = results_.description;
        for (std::size_t pose = 0; pose < description.poses; ++pose) {
            bool refused = false;
            for (std::size_t variant = 0; variant < description.variants.size(); ++variant)
                for (std::size_t detector = 0; detector < description.detectors.size(); ++detector)
                    refused |= read_row(pose, variant, detector);
            results_.refused += refused;
        }
        if (std::getline(file_, line_))
            fail("is one too many");
    }

private:
    [[noreturn]] void fail(const std::string& why) const {
        throw ConfigError({path_.string(), number_}, why);
    }

    void next_line() {
        ++number_;
        if (!std::getline(file_, line_) || file_.eof())
            fail("is missing: the study is not finished");
    }

    // Of numbers no field is quoted; names before them may be, and the failure behind them.
    void next_fields(const std::string& start) {
        next_line();
        if (!line_.starts_with(start))
            fail("is not that of the pose, variant and detector that are due: " + start);
        fields_.assign(3, {});
        std::string_view rest = std::string_view(line_).substr(start.size());
        while (fields_.size() < places_.failure) {
            const std::size_t comma = rest.find(',');
            if (comma == std::string_view::npos)
                fail("has too few fields");
            fields_.push_back(rest.substr(0, comma));
            rest.remove_prefix(comma + 1);
        }
        fields_.push_back(rest);
    }

    double number(std::size_t field) const {
        const auto value = parse_number(fields_[field]);
        if (!value)
            fail(fmt::format("field {} is no number", field + 1));
        return *value;
    }

    bool flag(std::size_t field) const {
        if (fields_[field] != "0" && fields_[field] != "1")
            fail(fmt::format("field {} is neither 0 nor 1", field + 1));
        return fields_[field] == "1";
    }

    // Whether the pose could not be rendered.
    bool read_row(std::size_t pose, std::size_t variant, std::size_t detector) {
        const StudyDescription& description = results_.description;
        next_fields(fmt::format("{},{},{},", pose, csv_text(description.variants[variant]),
                                csv_text(description.detectors[detector].name)));
        if (variant == 0 && detector == 0)
            read_pose();
        if (variant == 0)
            results_.sizes_px[detector].push_back(number(Fields::size));
        std::optional<DetectedError> error;
        if (flag(Fields::detected)) {
            error.emplace();
            error->flip = flag(Fields::flip);
            for (std::size_t k = 0; k < error_measure_count; ++k)
                error->measures[k] = number(places_.errors + k);
        }
        results_.errors[variant][detector].push_back(error);
        const bool has_corners = !fields_[Fields::corner_rms].empty();
        results_.corner_rms_px[variant][detector].push_back(
            has_corners ? std::optional(number(Fields::corner_rms)) : std::nullopt);
        const std::string failure = text_of_csv(fields_[places_.failure]);
        if (variant == 0 && !error)
            ++results_.failures[detector][failure];
        return failure.starts_with("not rendered: ");
    }

    void read_pose() {
        PoseComponents truth;
        for (std::size_t k = 0; k < truth.size(); ++k)
            truth[k] = number(Fields::truth + k);
        results_.truth.push_back(truth);
        for (std::size_t k = 0; k < results_.axes.size(); ++k)
            results_.axes[k].push_back(number(places_.axes + k));
    }

    std::filesystem::path path_;
    std::ifstream file_;
    StudyResults& results_;
    Fields places_{results_.description};
    std::string line_;
    int number_ = 0;
    std::vector<std::string_view> fields_;
};

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
    Json made_from{{"version", version},
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
    const Json json = read_json(path);
    if (!json.is_object() || json.value("etalon", Json()) != kind)
        throw ConfigError({path.string()}, std::string("is not of ") + kind);
    try {
        return description_of(json);
    } catch (const Json::exception& error) {
        throw ConfigError({path.string()}, error.what());
    }
}

StudyRecord::StudyRecord(const std::filesystem::path& folder, const StudyDescription& description)
    : description_(description), rows_(folder, rows_of(description)) {}

void StudyRecord::add(const StudyPose& pose, const std::vector<double>& axis_values,
                      const std::vector<StudyFinding>& findings) {
    std::string common;
    append_numbers(common, pose_components(pose.camera_from_marker));
    append_numbers(common, axis_values);
    std::string lines;
    for (std::size_t i = 0; i < findings.size(); ++i) {
        const std::size_t detectors = description_.detectors.size();
        lines +=
            fmt::format("{},{},{},", pose.index, csv_text(description_.variants[i / detectors]),
                        csv_text(description_.detectors[i % detectors].name));
        lines += findings_text(findings[i], common);
    }
    rows_.add(lines);
}

void merge_shards(const std::vector<std::filesystem::path>& shards,
                  const std::filesystem::path& out) {
    std::vector<std::string> descriptions;
    for (const std::filesystem::path& folder : shards)
        descriptions.push_back(text_of(json_of(read_description(folder))));
    StudyDescription whole = read_description(shards.front());
    whole.shard = {};
    merge_rows(shards_in_order(study_work, shards, descriptions), rows_of(whole), out);
}

StudyResults read_results(const std::filesystem::path& folder) {
    StudyResults results;
    results.description = read_description(folder);
    const StudyDescription& description = results.description;
    if (!description.shard.is_all())
        throw ConfigError({(folder / "study.json").string()},
                          fmt::format("is shard {}/{} of a study: merge the shards first",
                                      description.shard.index, description.shard.count));
    const std::size_t detectors = description.detectors.size();
    results.axes.resize(description.axes.size());
    results.sizes_px.resize(detectors);
    results.errors.assign(description.variants.size(), std::vector<DetectorErrors>(detectors));
    results.corner_rms_px.assign(description.variants.size(),
                                 std::vector<std::vector<std::optional<double>>>(detectors));
    results.failures.resize(detectors);
    ResultsReader(folder, results).read_all();
    return results;
}

}  // namespace etalon
