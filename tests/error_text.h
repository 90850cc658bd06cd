// What an action's error says, for tests of errors that people have to understand.
#pragma once

#include <string>

#include "core/program/errors.h"

namespace etalon {

// Runs `act`, which must fail with such an error, and returns its text.
template <class Expected, class Act>
std::string text_of_error(Act act) {
    try {
        act();
    } catch (const Expected& error) {
        return error.what();
    }
    return "no error";
}

template <class Act>
std::string device_error_of(Act act) {
    return text_of_error<DeviceError>(act);
}

template <class Act>
std::string config_error_of(Act act) {
    return text_of_error<ConfigError>(act);
}

inline bool has(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

}  // namespace etalon
