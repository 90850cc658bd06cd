// CSV files and lists of poses, each by the reader of the header that it has.
#include <array>

#include "calib/files/camera_file.h"
#include "sim/marker/stag_pattern.h"
#include "sim/scene/pose_file.h"
#include "station/register/stage_registration.h"
#include "study/study_results.h"
#include "tests/fuzz/coverage/checked_camera.h"

namespace etalon::test {
namespace {

const std::vector<Axis>& two_axes() {
    static const std::vector<Axis> axes{
        {.name = "x", .low = -100.0, .high = 100.0},
        {.name = "rz", .kind = Axis::Kind::rotary, .low = -1.5, .high = 1.5}};
    return axes;
}

template <bool json>
void read_pose_list(std::string_view text) {
    for (const Rigid& pose : read_poses(write_input(json ? "poses.json" : "poses.csv", text)))
        require(pose.rotation.coeffs().allFinite() && pose.translation.allFinite(),
                "a pose that is none");
}

void read_transfer_table(std::string_view text) {
    static const auto camera = write_input(
        "camera.yml",
        "etalon: camera/1\nimage: {width: 64, height: 48}\n"
        "intrinsics: {fx: 53.5, fy: 53.25, cx: 31.5, cy: 23.5}\n"
        "sensor: {pixel_pitch_um: 8.3, bits: 8, transfer: {table: {file: t.csv}}, black: 0,\n"
        "         gain_e_per_dn: 0, read_noise_e: 0, illumination: {cos4: true}}\n");
    write_input("t.csv", text);
    require_sound(read_any_camera(camera));
}

template <bool rotary>
void read_error_table(std::string_view text) {
    write_input("map.csv", text);
    const StrictFile file =
        StrictFile::from_text("etalon: axis/1\nmap: {file: map.csv}\n",
                              (input_folder() / "axis.yaml").string(), "axis/1");
    const ErrorMap map = read_error_map(file.root().at("map"), rotary);
    for (const ErrorMapPoint& point : map.points())
        require_all_finite(std::array{point.position, point.error, point.uncertainty});
}

void read_photo_rows(std::string_view text) {
    for (const StagePhoto& photo : read_stage_photos(write_input("photos.csv", text), two_axes()))
        require_all_finite(photo.positions);
}

void read_record_rows(std::string_view text) {
    write_input("poses.csv", text);
    for (const StagePhoto& photo : read_record_photos(input_folder(), two_axes()))
        require_all_finite(photo.positions);
}

void read_codewords(std::string_view text) {
    for (const StagCode code : stag_codes(write_input("codes.txt", text).string()))
        require(code >> stag_bits == 0, "a codeword that is too long");
}

void read_study_rows(std::string_view text) {
    static const auto study = write_input(
        "study.json",
        R"({"etalon":"study-record/1","id":"s","camera":"c","poses":2,"volume":"v",)"
        R"("detectors":[{"name":"A,B","detector":"aruco","marker":"aruco:4X4_50:7@50mm"}],)"
        R"("variants":["as it is","no blur"],"axes":[{"name":"focus-mm","unit":"mm"}],)"
        R"("made_from":{},"shard":[1,1]})");
    write_input("results.csv", text);
    for (const PoseComponents& truth : read_results(input_folder()).truth)
        require_all_finite(truth);
}

void read_any_table(std::string_view text) {
    for (const CsvRow& row : read_csv(write_input("table.csv", text)).rows)
        require_all_finite(row.numbers());
}

struct Kind {
    std::string_view start;
    void (*read)(std::string_view);
};
constexpr std::array kinds{Kind{"rx,ry", read_pose_list<false>},
                           Kind{"[", read_pose_list<true>},
                           Kind{"radiance", read_transfer_table},
                           Kind{"position_mm", read_error_table<false>},
                           Kind{"position_deg", read_error_table<true>},
                           Kind{"photo", read_photo_rows},
                           Kind{"pose,variant", read_study_rows},
                           Kind{"pose", read_record_rows},
                           Kind{"#", read_codewords}};

void read(std::string_view text) {
    for (const Kind& kind : kinds)
        if (text.starts_with(kind.start))
            return kind.read(text);
    read_any_table(text);
}

}  // namespace
}  // namespace etalon::test

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace etalon::test;
    read_or_refuse([&] { read(text_of(data, size)); });
    return 0;
}
