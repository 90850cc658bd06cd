// Commands that declare themselves and have nothing else to share; the others are declared in
// commands.h of their module.
#pragma once

namespace etalon {

class Command;

void declare_certify(Command& program);
void declare_demo(Command& program);
void declare_expect(Command& program);
void declare_history(Command& program);
void declare_oc(Command& program);
void declare_plan(Command& program);
void declare_qualify(Command& program);
void declare_register(Command& program);
void declare_report(Command& program);
void declare_serve(Command& program);

}  // namespace etalon
