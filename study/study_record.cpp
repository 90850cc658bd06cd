#include "study/study_record.h"

#include <fmt/format.h>

#include <algorithm>

#include "report/csv.h"
#include "study/study_results.h"

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

}  // namespace etalon
