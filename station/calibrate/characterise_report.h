// The page of `etalon characterise`: every value with its uncertainty, and the curves behind them.
#pragma once

#include "compare/characterise/characterisation.h"

namespace etalon {

// "gain 3.021 +- 0.034 e/DN": U = 2u with two digits, the value to the same place.
std::string with_uncertainty(const MeasuredValue& value);

// Writes report.html into the folder, which is made. Throws ConfigError when it cannot be written.
void write_characterise_report(const std::filesystem::path& folder, const CharacteriseInput& input,
                               const Characterisation& result);

}  // namespace etalon
