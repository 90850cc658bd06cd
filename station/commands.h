// All commands of `etalon`.
#pragma once

#include "station/shell/command.h"

namespace etalon {

// In the order of the help.
void declare_commands(Command& program);

// `etalon completion`, which is asked about all of them.
void declare_completion(Command& program);

void declare_schema(Command& program);

}  // namespace etalon
