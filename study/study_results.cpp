#include "study/study_results.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>

#include "core/file/text.h"
#include "core/program/errors.h"
#include "report/csv.h"

namespace etalon {
namespace {

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

// The rows of a study with this description.
RowsDescription rows_of(const StudyDescription& description) {
    return {study_work, description_text(description), results_header(description),
            description.poses, description.rows_per_pose()};
}

}  // namespace

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
        descriptions.push_back(description_text(read_description(folder)));
    StudyDescription whole = read_description(shards.front());
    whole.shard = {};
    merge_rows(shards_in_order(study_work, shards, descriptions), rows_of(whole), out);
}

namespace {

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
