// Poses and covariances as the numbers of files and tables: rotation vector in rad, then
// translation in mm.
#pragma once

#include <string>
#include <vector>

#include "core/rigid.h"

namespace etalon {

std::vector<double> pose_numbers(const Rigid& transform);
std::vector<std::vector<double>> row_numbers(const Matrix6d& matrix);

// Six columns of 9 characters with a blank between them.
std::string pose_columns(const Rigid& transform);

}  // namespace etalon
