// The part of characterise() that looks at the target's edges: defocus, point spread, modulation.
#pragma once

#include <optional>
#include <vector>

#include "compare/characterise/characterisation.h"
#include "core/geometry/rigid.h"

namespace etalon {

// Adds focus distance, f-number, point spread and MTF to `result`, or why not.
void measure_blur(const CharacteriseInput& input, const std::vector<std::optional<Rigid>>& poses,
                  Characterisation& result);

}  // namespace etalon
