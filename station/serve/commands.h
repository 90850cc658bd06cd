// `etalon serve`.
#pragma once

namespace etalon {

class Command;

void declare_serve(Command& program);

}  // namespace etalon
