// Text in the cells of the CSV files that commands write.
#pragma once

#include <string>
#include <string_view>

namespace etalon {

// Text with commas, quotes or line ends is quoted (RFC 4180, section 2).
std::string csv_text(const std::string& text);

// What csv_text() was given.
std::string text_of_csv(std::string_view field);

}  // namespace etalon
