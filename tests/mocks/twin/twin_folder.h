// A twin's files in a folder of their own: a small camera before a marker on a two-axis stage.
#pragma once

#include "tests/test.h"

namespace etalon {

class TwinFolder {
public:
    TwinFolder() {
        write("camera.yml", R"(etalon: camera/1
serial: TWIN-7
image: {width: 160, height: 120}
intrinsics: {fx: 190, fy: 187, cx: 81.5, cy: 57.25}
distortion: {k1: -0.2, k2: 0.05}
lens: {f_number: 2.8, focus_distance_mm: 300, wavelength_nm: 550}
sensor: {pixel_pitch_um: 8.3, bits: 8, gain_e_per_dn: 40, read_noise_e: 20}
)");
        write("twin.yaml", twin_yaml());
    }

    static std::string twin_yaml() {
        return R"(etalon: twin/1
seed: 7
stage:
  port: 0
  axes:
    - {name: x, kind: linear, direction: [1, 0, 0], travel: [-30, 30], speed: 400}
    - {name: rz, kind: rotary, direction: [0, 0, 1], point_mm: [0, 0, 0],
       travel_deg: [-20, 20], speed_deg: 200}
  errors:
    x: {scale_ppm: 2000, backlash_um: 50}
camera:
  calibration: camera.yml
  errors: {focal_length_percent: 0.5}
  nominal_exposure_us: 5000
scene:
  marker: "apriltag:36h11:5@50mm"
  background: 0.6
  camera_from_base: {rotation_deg: [0, 0, 0], translation_mm: [2, -3, 300]}
  carriage_from_marker: {rotation_deg: [9, -14, 1.5], translation_mm: [1.5, -2, 3]}
)";
    }

    void write(const std::string& name, const std::string& text) const {
        std::ofstream(folder_ / name) << text;
    }
    std::filesystem::path file(const std::string& name) const { return folder_ / name; }

private:
    TemporaryFolder folder_;
};

// twin.yaml with one part replaced; the test fails if that part is not in it.
inline std::string twin_yaml_with(const std::string& part, const std::string& replacement) {
    std::string text = TwinFolder::twin_yaml();
    const std::size_t at = text.find(part);
    EXPECT_NE(at, std::string::npos) << part;
    if (at != std::string::npos)
        text.replace(at, part.size(), replacement);
    return text;
}

}  // namespace etalon
