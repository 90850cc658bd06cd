// The station of the unit tests, fast and small, and its twin over the real protocols: a run takes
// two seconds, and ends with PASS.
#pragma once

#include "tests/station/stations.h"

namespace etalon {

constexpr int quick_poses = 24;

inline const char* const quick_twin = R"(etalon: twin/1
seed: 7
stage:
  port: 0
  axes:
    - {name: x, kind: linear, direction: [1, 0, 0], travel: [-70, 60], speed: 2000}
    - {name: y, kind: linear, direction: [0, 1, 0], travel: [-50, 55], speed: 2000}
    - {name: z, kind: linear, direction: [0, 0, 1], travel: [-80, 90], speed: 2000}
    - {name: rz, kind: rotary, direction: [0, 0, 1], point_mm: [0, 0, 0],
       travel_deg: [-190, 190], speed_deg: 3000}
camera:
  calibration: camera.yml
  nominal_exposure_us: 2500
scene:
  marker: "apriltag:36h11:5@60mm"
  background: 0.7
  camera_from_base: {rotation_deg: [1.7, -1.1, 0.6], translation_mm: [4, -6, 330]}
  carriage_from_marker: {rotation_deg: [20.5, -0.4, 0.7], translation_mm: [5.3, -7.2, 11.5]}
)";

// The station of the unit tests, fast and small, at the port that the twin has taken.
inline std::string quick_station(const std::string& port) {
    std::string text = replaced(station_text, "port: 1599, unit: 2", "port: " + port);
    for (const auto& [what, by] : std::vector<std::pair<std::string, std::string>>{
             {"speed: 100,", "speed: 2000,"},
             {"speed: 90,", "speed: 2000,"},
             {"speed: 80,", "speed: 2000,"},
             {"speed_deg: 120,", "speed_deg: 3000,"},
             {"white_level: 0.9", "white_level: 0.8"},
             {"poses: 25", fmt::format("poses: {}", quick_poses)},
             {"hold_out: 0.6", "hold_out: 0.625"},
             {"frames: 2", "frames: 1"},
             {"settle_ms: 40", "settle_ms: 5"}})
        text = replaced(text, what, by);
    return text;
}

}  // namespace etalon
