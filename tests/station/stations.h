// A small station for tests: its files on disk, and the same devices as mocks.
#pragma once

#include "tests/test.h"

namespace etalon {

inline const char* const camera_text = R"(etalon: camera/1
serial: "CAM-7"
image: {width: 320, height: 240}
intrinsics: {fx: 275.0, fy: 275.0, cx: 158.3, cy: 121.6}
distortion: {k1: -0.05}
)";

inline const char* const limits_text = R"(etalon: limits/1
id: test-limits-5
b3_position_field_rms_mm: {limit: 0.30, unit: mm}
b3_position_field_max_mm: {limit: 0.90, unit: mm}
may_be_unchecked: [residuals against noise]   # of quick runs: one frame a pose, no noise stated
)";

// One line per setting, so that a test can break any of them and knows its line.
inline const char* const station_text = R"(etalon: station/1
id: test-station
camera:
  uri: "genicam:127.0.0.1"
  calibration: camera.yml
  exposure_us: 2000
  gain_db: 0
  packet_size: 1400
  frame_timeout_ms: 900
  retries: 3
stage:
  link: {host: 127.0.0.1, port: 1599, unit: 2, response_timeout_ms: 250}
  profile: generic
  axes:
    - {name: x, kind: linear, direction: [1, 0, 0], travel: [-70, 60], speed: 100, scale_uncertainty_ppm: 30, repeatability_um: 2}
    - {name: y, kind: linear, direction: [0, 1, 0], travel: [-50, 55], speed: 90, scale_uncertainty_ppm: 30, repeatability_um: 2}
    - {name: z, kind: linear, direction: [0, 0, 1], travel: [-80, 90], speed: 80, scale_uncertainty_ppm: 30, repeatability_um: 2}
    - {name: rz, kind: rotary, direction: [0, 0, 1], point_mm: [0, 0, 0], travel_deg: [-190, 190], speed_deg: 120, scale_uncertainty_ppm: 30, repeatability_deg: 0.001}
marker: "apriltag:36h11:5@60mm"
marker_mount: {rotation_deg: [20, 0, 0], translation_mm: [5, -7, 11]}
marker_size_uncertainty_ppm: 50
background: 0.7
white_level: 0.9
plan:
  volume: {x: [-60, 50], y: [-40, 45], z: [-70, 80], rz: [-170, 175]}
  poses: 25
  hold_out: 0.6
  frames: 2
  seed: 7
  settle_ms: 40
detector: auto
limits: limits.yaml
marker_flatness_um: 4
temperature: {uncertainty_k: 0.3, marker_expansion_ppm_per_k: 9, stage_expansion_ppm_per_k: 11}
)";

// Appended to it: everything that a certificate asks of a station.
inline const char* const traced_text =
    R"(environment: {temperature_c: [19.9, 20.5], humidity_percent: [40, 52]}
references:
  stage_scale:
    x: {value_ppm: 3, U_ppm: 20, certificate: S-1, laboratory: Laboratory A, date: 2026-01-12, due: 2999-01-12}
    y: {value_ppm: -7, U_ppm: 24, certificate: S-2, laboratory: Laboratory A, date: 2026-01-12, due: 2999-01-12}
    z: {value_ppm: 5, U_ppm: 30, certificate: S-3, laboratory: Laboratory A, date: 2026-01-12, due: 2999-01-12}
    rz: {value_ppm: 0, U_ppm: 50, certificate: S-4, laboratory: Laboratory A, date: 2026-01-12, due: 2999-01-12}
  marker_size: {value_ppm: 12, U_ppm: 60, certificate: M-1, laboratory: "Laboratory <B> & Sons", date: 2026-02-03, due: 2999-02-03}
  marker_flatness: {value_um: 2, U_um: 6, certificate: M-2, laboratory: Laboratory B, date: 2026-02-03, due: 2999-02-03}
  thermometer: {value_k: 0.03, U_k: 0.08, certificate: T-1, laboratory: Laboratory C, date: 2026-03-04, due: 2999-03-04}
)";

inline std::filesystem::path write_station(const TemporaryFolder& folder,
                                           const std::string& text = station_text) {
    write_text(folder / "camera.yml", camera_text);
    write_text(folder / "limits.yaml", limits_text);
    write_text(folder / "station.yaml", text);
    return folder / "station.yaml";
}

}  // namespace etalon
