// The names of a camera's parameters in files and covariances: fx fy cx cy, then OpenCV's fourteen
// distortion coefficients in OpenCV's order.
#pragma once

#include <algorithm>
#include <array>
#include <string_view>

namespace etalon {

inline constexpr std::array<const char*, 4> intrinsic_names{"fx", "fy", "cx", "cy"};
inline constexpr std::array<const char*, 14> distortion_names{
    "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"};

inline bool is_camera_parameter(std::string_view name) {
    const auto is_name = [name](const char* known) { return name == known; };
    return std::any_of(intrinsic_names.begin(), intrinsic_names.end(), is_name) ||
           std::any_of(distortion_names.begin(), distortion_names.end(), is_name);
}

}  // namespace etalon
