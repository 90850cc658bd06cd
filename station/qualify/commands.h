// `etalon qualify` and `etalon report`.
#pragma once

namespace etalon {

class Command;

void declare_qualify(Command& program);
void declare_report(Command& program);

}  // namespace etalon
