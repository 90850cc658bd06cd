// `etalon certify`.
#pragma once

namespace etalon {

class Command;

void declare_certify(Command& program);

}  // namespace etalon
