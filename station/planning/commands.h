// `etalon expect`, `plan` and `oc`.
#pragma once

namespace etalon {

class Command;

void declare_expect(Command& program);
void declare_plan(Command& program);
void declare_oc(Command& program);

}  // namespace etalon
