#include "station/qualify/run_results.h"

#include <system_error>

#include "core/file/sha256.h"
#include "core/file/text.h"
#include "station/qualify/junit.h"
#include "station/qualify/qualify_report.h"
#include "station/record/run_json.h"
#include "station/record/run_record.h"

namespace etalon {
namespace {

// A file that could not be written has no hash: the run says so elsewhere.
void attach(QualifyResult& result, const std::string& path) {
    std::error_code ignored;
    if (std::filesystem::is_regular_file(result.folder / path, ignored))
        result.attachments.push_back({path, sha256_of_file(result.folder / path)});
}

void attach_all(QualifyResult& result) {
    result.attachments.clear();
    for (const char* file : {log_file, "poses.csv", "convergence.csv", "junit.xml", "report.html"})
        attach(result, file);
    for (const InputFile& input : result.station.inputs)
        result.attachments.push_back({input.copy, input.sha256});
    for (const Pose& pose : result.poses) {
        for (const FrameRecord& frame : pose.frames)
            if (!frame.file.empty())
                result.attachments.push_back({frame.file, frame.sha256});
        if (!pose.render_file.empty())
            attach(result, pose.render_file);
    }
}

}  // namespace

void write_results(QualifyResult& result) {
    write_text(result.folder / "poses.csv", poses_csv(result));
    write_text(result.folder / "convergence.csv", convergence_csv(result));
    write_text(result.folder / "junit.xml", junit_xml(result));
    write_qualify_report(result, result.folder / "report.html");
    attach_all(result);
    write_text(result.folder / "run.json", run_json(result));
}

}  // namespace etalon
