// Files that come with the program, found from where the program lies: no path is compiled in, so
// that it can be installed anywhere.
#pragma once

#include <filesystem>
#include <string>

namespace etalon {

// The folder of the program that runs.
std::filesystem::path program_folder();

// `name` below share/etalon, for instance "examples/demo/station.yaml": of the prefix that the
// program is installed to, or of its build folder. Throws ConfigError where it is in neither.
std::filesystem::path installed_file(const std::string& name);

}  // namespace etalon
