// What an action's DeviceError says, for tests of errors that people have to understand.
#pragma once

#include <string>

#include "core/errors.h"

namespace etalon {

// Runs `act`, which must fail with a DeviceError, and returns its text.
template <class Act>
std::string device_error_of(Act act) {
    try {
        act();
    } catch (const DeviceError& error) {
        return error.what();
    }
    return "no error";
}

inline bool has(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

}  // namespace etalon
