// Files of ours, each by the reader of the kind that it names ("etalon: camera/1").
#include <array>

#include "calib/files/camera_file.h"
#include "compare/qualification/limits_file.h"
#include "mocks/twin/twin_file.h"
#include "station/certify/certificate.h"
#include "station/compare/compare_baseline.h"
#include "station/setup/station_file.h"
#include "study/study_file.h"
#include "tests/fuzz/coverage/checked_camera.h"

namespace etalon::test {
namespace {

using Path = std::filesystem::path;

void read_spread_file(const Path& path) {
    std::filesystem::rename(path, input_folder() / "spread.yml");
    static const Path camera = write_input(
        "spread_camera.yml",
        "etalon: camera/1\nimage: {width: 64, height: 48}\n"
        "intrinsics: {fx: 53.5, fy: 53.25, cx: 31.5, cy: 23.5}\n"
        "lens: {f_number: 2.8, focus_distance_mm: 150, wavelength_nm: 650,\n"
        "       psf: {measured: {file: spread.yml}}}\n"
        "sensor: {pixel_pitch_um: 8.3, bits: 8, transfer: linear, black: 0, gain_e_per_dn: 0,\n"
        "         read_noise_e: 0, illumination: {cos4: true}}\n");
    require_sound(read_any_camera(camera));
}

void read_axes_of(const std::vector<Axis>& axes) {
    for (const Axis& axis : axes)
        require_all_finite(std::array{axis.low, axis.high, axis.speed, axis.zero, axis.backlash});
}

void read_station_file(const Path& path) {
    const StationFile station = read_station(path);
    read_axes_of(station.stage.axes);
    require_sound(station.camera.model);
    require_all_finite(station.carriage_from_marker_nominal.translation);
    require(!station.marker.points_mm.empty(), "a marker without points");
    for (const PlanRequest::Interval& interval : station.plan.volume)
        require_all_finite(std::array{interval.low, interval.high});
    for (const TracedReference& reference : station.references)
        require_finite(reference.standard_uncertainty());
}

void read_twin(const Path& path) {
    const TwinFile twin = read_twin_file(path);
    require_sound(twin.true_camera);
    read_axes_of(twin.stage.axes);
}

void read_profile(const Path& path) {
    const StageProfile profile = read_stage_profile(path);
    require_all_finite(std::array{profile.counts.sign, profile.counts.offset, profile.speed.step,
                                  profile.done.tolerance_mm, profile.done.tolerance_deg});
}

void read_study_file(const Path& path) {
    const StudyFile study = read_study(path);
    require_sound(study.camera);
    require_all_finite(std::array{study.poses.volume.z_mm.low, study.poses.volume.z_mm.high});
}

void read_comparison_file(const Path& path) {
    std::filesystem::rename(path, input_folder() / "comparison.json");
    for (const PhotoSummary& photo : read_comparison(input_folder()).photos)
        for (const auto& value :
             {photo.residual_gray, photo.refined_residual_gray, photo.edge_shift_px,
              photo.refined_edge_shift_px, photo.psf_sigma_px})
            require_finite(value.value_or(0.0));
}

struct Kind {
    std::string_view name;
    void (*read)(const Path&);
};
constexpr std::array kinds{
    Kind{"station/1", read_station_file},
    Kind{"stage-profile/1", read_profile},
    Kind{"limits/1", [](const Path& path) { read_limits(path); }},
    Kind{"certificate/1",
         [](const Path& path) { address_of(read_certificate_form(path).laboratory); }},
    Kind{"twin/1", read_twin},
    Kind{"psf/1", read_spread_file},
    Kind{"study/1", read_study_file},
    Kind{"comparison/1", read_comparison_file}};

void provide_what_files_name() {
    for (const char* name :
         {"demo/camera.yml", "demo/limits.yaml", "study/published-camera.yml", "study/webcam.yml"})
        provide(examples() / name, Path(name).filename());
}

void read(std::string_view text) {
    for (const Kind& kind : kinds)
        if (text.find(kind.name) != std::string_view::npos)
            return kind.read(write_input("input.yaml", text));
    require_sound(read_any_camera(write_input("input.yaml", text)));
}

}  // namespace
}  // namespace etalon::test

extern "C" int LLVMFuzzerInitialize(int*, char***) {
    etalon::test::provide_what_files_name();
    return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace etalon::test;
    read_or_refuse([&] { read(text_of(data, size)); });
    return 0;
}
