// Numbers as tables and pages show them. What is not there or not finite is a dash.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/geometry/rigid.h"

namespace etalon {

inline constexpr const char* dash = "–";

std::string fixed(double value, int decimals);
std::string fixed(const std::optional<double>& value, int decimals, const char* missing = dash);

std::string significant(double value, int digits, const char* missing = dash);
std::string significant(const std::optional<double>& value, int digits, const char* missing = dash);

// A measured value; one that is lost in noise, 0, is below its U: "below 0.037".
inline constexpr const char* below = "below ";
std::string value_or_below(double value, double expanded_uncertainty, int digits);

// In percent with two digits: "2.3 %"; "< 0.01 %" and "> 99.99 %" where no more is worth saying.
std::string probability_text(double probability);

// Decimals that show two digits of an uncertainty.
int decimals_of(double uncertainty);

// "1 photograph", "7 photographs"; "2 quantities" where the plural is said.
std::string counted(std::size_t count, const std::string& noun, const std::string& plural = "");

// Poses and covariances in files and tables: rotation vector in rad, then translation in mm.

std::vector<double> pose_numbers(const Rigid& transform);
std::vector<std::vector<double>> row_numbers(const Matrix6d& matrix);

// Of any Eigen vector.
template <class Vector>
std::vector<double> numbers_of(const Vector& vector) {
    return {vector.begin(), vector.end()};
}

// Six columns of 9 characters with a blank between them.
std::string pose_columns(const Rigid& transform);
// Below them the standard deviations, which are small: two more digits.
std::string deviation_columns(const Vector6d& deviations);
// What stands above the columns.
std::string pose_heading();

}  // namespace etalon
