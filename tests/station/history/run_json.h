// The run.json of a qualification as far as its history reads it.
#pragma once

#include <fmt/format.h>

#include <nlohmann/json.hpp>

namespace etalon {

// A run of this day of March 2026, with one quantity of this value.
inline nlohmann::json run_of_day(int day, double value, const std::string& camera = "CAM-7",
                                 const std::string& outcome = "PASS") {
    return {{"etalon", "run/1"},
            {"outcome", outcome},
            {"started_utc", fmt::format("2026-03-{:02}T14:05:09Z", day)},
            {"station", "demo"},
            {"marker", "apriltag:36h11:5@80mm"},
            {"limits", "demo-1"},
            {"camera", {{"serial", camera}, {"uri", "genicam:127.0.0.1"}}},
            {"inputs", {{{"role", "calibration"}, {"sha256", std::string(64, 'a')}}}},
            {"measurements",
             {{{"name", "b3_position_field_rms_mm"},
               {"unit", "mm"},
               {"value", value},
               {"expanded_uncertainty", 0.005},
               {"limit", 0.06},
               {"outcome", outcome}}}}};
}

}  // namespace etalon
