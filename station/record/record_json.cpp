#include "station/record/record_json.h"

namespace etalon {

Json settings_json(const CaptureSettings& settings) {
    return {{"width", settings.width},
            {"height", settings.height},
            {"bits", settings.bits},
            {"format", settings.format},
            {"exposure_us", settings.exposure.count()},
            {"gain_db", settings.gain_db},
            {"black_level", or_null(settings.black_level)},
            {"trigger", settings.trigger},
            {"controls", settings.controls}};
}

Json inputs_json(std::span<const InputFile> inputs) {
    Json list = Json::array();
    for (const InputFile& input : inputs)
        list.push_back({{"role", input.role},
                        {"path", input.path.string()},
                        {"copy", input.copy},
                        {"sha256", input.sha256}});
    return list;
}

void add_counters(Json& camera, const CaptureStatistics& counts) {
    for (const CounterField& field : counter_fields)
        camera[field.name] = counts.*field.count;
}

}  // namespace etalon
