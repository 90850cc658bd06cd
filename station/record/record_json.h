// JSON that several files of a record have in common, as run.json, capture.json and the lines of
// events.jsonl write it. Includes json.hpp, which takes seconds to compile: for .cpp files only.
#pragma once

#include <nlohmann/json.hpp>

#include "report/json_text.h"
#include "station/record/qualify_result.h"

namespace etalon {

using RecordJson = nlohmann::ordered_json;  // keys in the order in which they are written

RecordJson settings_json(const CaptureSettings& settings);
RecordJson device_json(const CameraIdentity& camera);
RecordJson inputs_json(std::span<const InputFile> inputs);

// The camera's counters go into the record of whatever it was used for.
void add_counters(RecordJson& camera, const CaptureStatistics& counts);

template <class Vector>
RecordJson numbers_json(const Vector& vector) {
    return std::vector<double>(vector.data(), vector.data() + vector.size());
}

}  // namespace etalon
