// SHA-256 (FIPS 180-4) of files and texts, to identify inputs in records; guards no secrets.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace etalon {

// 64 lower-case hexadecimal digits. About 1 GB/s.
std::string sha256(std::string_view bytes);

// Throws ConfigError with the path when the file cannot be read.
std::string sha256_of_file(const std::filesystem::path& path);

}  // namespace etalon
