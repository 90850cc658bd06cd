// A gray: 1/255 of linear full scale.
#pragma once

namespace etalon {

inline constexpr double gray = 1.0 / 255.0;

}  // namespace etalon
