// What a run, a study, a set of images and a shard of runs leave behind: run.json, study.json,
// set.json, images.jsonl and oc.json, each by the kind that the text names.
#include <array>

#include "station/history/run_history.h"
#include "station/planning/operating_characteristic.h"
#include "station/render/image_set.h"
#include "study/study_results.h"
#include "tests/fuzz/coverage/fuzz_input.h"

namespace etalon::test {
namespace {

using Path = std::filesystem::path;

void read_run_json(std::string_view text) {
    write_input("run.json", text);
    const std::array folders{input_folder()};
    const std::vector<HistoricRun> runs = read_history(folders);
    for (const QuantityHistory& history : chart_history(runs))
        for (const ChartedRun& run : history.runs)
            require_finite(run.quantity.value.value());
}

void read_study_json(std::string_view text) {
    write_input("study.json", text);
    require(read_description(input_folder()).rows_per_pose() > 0, "a study of nothing");
}

// The manifest is written again: what is kept must be kept again.
void read_manifest(std::string_view text) {
    static const Path folder = [] {
        const Path made = input_folder() / "images";
        ImageSet(made, R"({"seed": 7})", "{}", ".png", 3);
        std::ofstream(made / "pose-000001.png") << "an image";
        return made;
    }();
    std::ofstream(folder / "images.jsonl", std::ios::binary) << text;
    const bool had = ImageSet(folder, R"({"seed": 7})", "{}", ".png", 3).had(1);
    require(ImageSet(folder, R"({"seed": 7})", "{}", ".png", 3).had(1) == had,
            "a line that was lost");
}

void read_settings(std::string_view text) {
    static const Path folder = [] {
        const Path made = input_folder() / "set";
        std::filesystem::create_directories(made);
        return made;
    }();
    std::ofstream(folder / "set.json", std::ios::binary) << text;
    ImageSet(folder, R"({"seed": 7, "marker": "aruco:4X4_50:7@50mm"})", "{}", ".png", 3);
}

// Its runs are not there: whatever the description says, it cannot be merged.
void read_oc_json(std::string_view text) {
    write_input("oc.json", text);
    write_input("results.csv", "");
    merged_characteristic({input_folder()});
    violation("runs that are not there were merged");
}

void read(std::string_view text) {
    if (text.find("image-set/1") != std::string_view::npos)
        read_settings(text);
    else if (text.find("study-record/1") != std::string_view::npos)
        read_study_json(text);
    else if (text.find("oc-record/1") != std::string_view::npos)
        read_oc_json(text);
    else if (text.starts_with("{\"image\""))
        read_manifest(text);
    else
        read_run_json(text);
}

}  // namespace
}  // namespace etalon::test

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace etalon::test;
    read_or_refuse([&] { read(text_of(data, size)); });
    return 0;
}
