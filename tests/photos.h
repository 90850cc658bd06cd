// Whether the photographs of Debian's opencv-doc are there: ./test.sh puts them into build/photos.
#pragma once

#include <filesystem>

#include "tests/paths.h"

namespace etalon::test {

inline bool photos_are_there() {
    return std::filesystem::exists(std::filesystem::path(ETALON_PHOTO_DIR) / "left01.jpg");
}

}  // namespace etalon::test
