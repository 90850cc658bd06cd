// Poses and covariances as the numbers of files and tables: rotation vector in rad, then
// translation in mm.
#pragma once

#include <string>
#include <vector>

#include "core/geometry/rigid.h"

namespace etalon {

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
