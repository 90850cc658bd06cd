#include "station/record/record_json.h"

namespace etalon {

RecordJson settings_json(const CaptureSettings& settings) {
    return {{"width", settings.width},
            {"height", settings.height},
            {"bits", settings.bits},
            {"format", settings.format},
            {"exposure_us", settings.exposure.count()},
            {"gain_db", settings.gain_db},
            {"black_level", optional_number(settings.black_level)},
            {"trigger", settings.trigger},
            {"controls", settings.controls}};
}

RecordJson device_json(const CameraIdentity& camera) {
    return {{"uri", camera.uri},
            {"vendor", camera.vendor},
            {"model", camera.model},
            {"serial", camera.serial}};
}

RecordJson inputs_json(std::span<const InputFile> inputs) {
    RecordJson list = RecordJson::array();
    for (const InputFile& input : inputs)
        list.push_back({{"role", input.role},
                        {"path", input.path.string()},
                        {"copy", input.copy},
                        {"sha256", input.sha256}});
    return list;
}

void add_counters(RecordJson& camera, const CaptureStatistics& counts) {
    for (const CounterField& field : counter_fields)
        camera[field.name] = counts.*field.count;
}

}  // namespace etalon
