// Text in the cells of the CSV files that commands write.
#pragma once

#include <string>

namespace etalon {

// Text with commas, quotes or line ends is quoted (RFC 4180, section 2).
std::string csv_text(const std::string& text);

}  // namespace etalon
