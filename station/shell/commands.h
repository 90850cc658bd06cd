// `etalon certify`.
#pragma once

namespace etalon {

class Command;

void declare_certify(Command& program);

// `etalon history`.

class Command;

void declare_history(Command& program);

// `etalon expect`, `plan` and `oc`.

class Command;

void declare_expect(Command& program);
void declare_plan(Command& program);
void declare_oc(Command& program);

// `etalon register`.

class Command;

void declare_register(Command& program);

// `etalon serve`.

class Command;

void declare_serve(Command& program);

}  // namespace etalon
