// etalon.run_study: detectors compared on rendered poses.
#include "python/arrays.h"
#include "python/interruptible.h"
#include "study/study_report.h"
#include "study/study_run.h"

namespace etalon {
namespace {

py::object study_to(const std::filesystem::path& file, const std::filesystem::path& out,
                    const std::vector<std::string>& ablate, bool progress) {
    run_interruptibly([&](std::stop_token stop) {
        const StudyFile study = read_study(file);
        const Shard all;
        const StudyOptics optics(study, study_variants(study, ablate));
        StudyRecord record(out, describe(study, file, optics.variants(), all));
        RunProgress shown(progress);
        if (!run_study(optics, all, record, stop, shown.progress()).complete)
            throw Interrupted();
        const StudyResults results = read_results(out);
        write_study_report(results, summarise(results), out);
    });
    return py::module_::import("etalon.records").attr("read_results")(out);
}

}  // namespace

void bind_study(py::module_& module) {
    module.def(
        "run_study", &study_to, "study"_a, "out"_a, py::kw_only(),
        "ablate"_a = std::vector<std::string>(), "progress"_a = false,
        R"(Compares detectors on rendered poses: study.yaml in, results and report in the folder out.

ablate: also with each of these switched: tone, half-pixel, noise, blur, undistortion. Returns what
read_results() does. Ctrl-C keeps what is done; the same call goes on. Raises ConfigError.)");
}

}  // namespace etalon
