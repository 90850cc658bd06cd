// `etalon history`.
#pragma once

namespace etalon {

class Command;

void declare_history(Command& program);

}  // namespace etalon
