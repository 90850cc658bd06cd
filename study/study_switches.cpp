#include "study/study_switches.h"

#include <fmt/ranges.h>

#include <algorithm>

#include "core/program/errors.h"

namespace etalon {

const std::vector<std::string>& study_switch_names() {
    static const std::vector<std::string> names = {"tone", "half-pixel", "noise", "blur",
                                                   "undistortion"};
    return names;
}

std::string name_of(StudySwitch one) {
    return study_switch_names().at(static_cast<std::size_t>(one));
}

StudySwitch parse_study_switch(const std::string& name, const SourcePlace& place) {
    const std::vector<std::string>& names = study_switch_names();
    const auto at = std::ranges::find(names, name);
    if (at == names.end())
        throw ConfigError(place,
                          fmt::format("there is no switch '{}': {}", name, fmt::join(names, ", ")));
    return static_cast<StudySwitch>(at - names.begin());
}

CameraModel imaging_camera(const CameraModel& camera, const StudySwitches& switches,
                           const SourcePlace& place) {
    CameraModel result = camera;
    if (switches.has(StudySwitch::tone)) {
        if (!result.sensor)
            result.sensor = Sensor{.pixel_pitch_um = 1.0};
        const bool is_linear = result.sensor->transfer.kind == Transfer::Kind::linear;
        result.sensor->transfer = {is_linear ? Transfer::Kind::rec709 : Transfer::Kind::linear, {}};
    }
    if (switches.has(StudySwitch::noise)) {
        if (!result.sensor || result.sensor->gain_e_per_dn <= 0.0)
            throw ConfigError(place, "noise cannot be switched: the camera states none");
        result.sensor->gain_e_per_dn = result.sensor->read_noise_e = 0.0;
    }
    if (switches.has(StudySwitch::blur)) {
        if (!result.lens)
            throw ConfigError(place, "blur cannot be switched: the camera states no lens");
        result.lens.reset();
    }
    return result;
}

CameraModel estimation_camera(const CameraModel& camera, const StudySwitches& switches) {
    CameraModel result = camera;
    if (switches.has(StudySwitch::undistortion))
        result.distortion = {};
    return result;
}

}  // namespace etalon
