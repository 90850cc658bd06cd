// SHA-256 (FIPS 180-4) of files and texts, so that a record can say which inputs it was made from.
// For identification only; nothing here guards secrets.
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
