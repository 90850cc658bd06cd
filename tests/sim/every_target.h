// What must hold on every instruction set that the vector code was built for.
#pragma once

#include "sim/tiles/vector_targets.h"
#include "tests/test.h"

#include <hwy/targets.h>

#include <cstdint>

namespace etalon {

// Each instruction set of this machine in turn.
template <class Body>
void on_every_target(Body body) {
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
        hwy::SetSupportedTargetsForTest(target);
        SCOPED_TRACE(hwy::TargetName(target));
        body();
    }
    hwy::SetSupportedTargetsForTest(0);
}

}  // namespace etalon
