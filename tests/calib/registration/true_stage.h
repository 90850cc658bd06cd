// The stage that the tests of this room register: its places and the corners of the tag on it.
#pragma once

#include <vector>

#include "core/geometry/rigid.h"

namespace etalon {

inline const std::vector<Eigen::Vector3d> tag = {
    {-40, -40, 0}, {40, -40, 0}, {40, 40, 0}, {-40, 40, 0}};
inline const Rigid true_x{rotation_from_vector({0.05, -0.09, 0.03}), {11.0, -7.0, 520.0}};
inline const Rigid true_y{rotation_from_vector({0.35, 0.06, -0.11}), {5.0, -13.0, 17.0}};

}  // namespace etalon
