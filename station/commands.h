// All commands of `etalon`.
#pragma once

#include "station/shell/command.h"

namespace etalon {

// In the order of the help.
void declare_commands(Command& program);

}  // namespace etalon
