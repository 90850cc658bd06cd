// Which program this is, to the bit: its own file, the libraries that it was loaded with and what
// the processor can do, as code is chosen by it. Two processes with the same fingerprint compute
// the same from the same input; a version number does not promise that.
#pragma once

#include <string>

namespace etalon {

// 64 lower-case hexadecimal digits. Some 15 ms the first time, then none. Throws ConfigError where
// the program's own file cannot be read. Safe from every thread.
const std::string& program_fingerprint();

}  // namespace etalon
