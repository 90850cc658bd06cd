// `etalon register`.
#pragma once

namespace etalon {

class Command;

void declare_register(Command& program);

}  // namespace etalon
