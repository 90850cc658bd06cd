// Numbers as tables and pages show them. What is not there or not finite is a dash.
#pragma once

#include <optional>
#include <string>

namespace etalon {

inline constexpr const char* dash = "–";

std::string fixed(double value, int decimals);
std::string fixed(const std::optional<double>& value, int decimals, const char* missing = dash);

std::string significant(double value, int digits, const char* missing = dash);
std::string significant(const std::optional<double>& value, int digits, const char* missing = dash);

// Decimals that show two digits of an uncertainty.
int decimals_of(double uncertainty);

// "1 photograph", "7 photographs".
std::string counted(std::size_t count, const std::string& noun);

}  // namespace etalon
