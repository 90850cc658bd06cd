// The text of the profiles that CMake builds into the library, by name. Use
// builtin_stage_profile() of stage/profile/profile.h instead.
#pragma once

#include <map>
#include <string>

namespace etalon {

const std::map<std::string, std::string>& builtin_profile_texts();

}  // namespace etalon
