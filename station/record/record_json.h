// JSON that several files of a record have in common, as run.json, capture.json and the lines of
// events.jsonl write it. Includes json.hpp, which takes seconds to compile: for .cpp files only.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "station/record/qualify_result.h"

namespace etalon {

using RecordJson = nlohmann::ordered_json;  // keys in the order in which they are written

// Bytes that are not UTF-8 are replaced. `indent` -1: on one line.
std::string text_of(const RecordJson& json, int indent);

RecordJson settings_json(const CaptureSettings& settings);
RecordJson device_json(const CameraIdentity& camera);
RecordJson inputs_json(std::span<const InputFile> inputs);

// The camera's counters go into the record of whatever it was used for.
void add_counters(RecordJson& camera, const CaptureStatistics& counts);

// null without a value; nlohmann writes NaN and infinity as null by itself.
inline RecordJson optional_number(const std::optional<double>& value) {
    return value ? RecordJson(*value) : RecordJson();
}

template <class Vector>
RecordJson numbers_json(const Vector& vector) {
    return std::vector<double>(vector.data(), vector.data() + vector.size());
}

}  // namespace etalon
