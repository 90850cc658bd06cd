// JSON that several files of a record have in common, as run.json, capture.json and the lines of
// events.jsonl write it. Includes json.hpp, which takes seconds to compile: for .cpp files only.
#pragma once

#include <nlohmann/json.hpp>

#include "report/json_text.h"
#include "station/record/qualify_result.h"

namespace etalon {

ETALON_MEMBERS_TO_JSON(CameraIdentity, uri, vendor, model, serial)

Json settings_json(const CaptureSettings& settings);
Json inputs_json(std::span<const InputFile> inputs);

// The camera's counters go into the record of whatever it was used for.
void add_counters(Json& camera, const CaptureStatistics& counts);

}  // namespace etalon
