// The names of a camera's parameters in files and covariances: fx fy cx cy, then the distortion
// coefficients, OpenCV's fourteen first and in its order, then those of the projections, and skew.
#pragma once

#include <algorithm>
#include <array>
#include <string_view>

namespace etalon {

inline constexpr std::array<const char*, 4> intrinsic_names{"fx", "fy", "cx", "cy"};
inline constexpr std::array<const char*, 15> distortion_names{
    "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y", "k7"};
inline constexpr std::array<const char*, 4> projection_parameter_names{"xi", "omega", "beta",
                                                                       "alpha"};

inline bool is_camera_parameter(std::string_view name) {
    const auto is_name = [name](const char* known) { return name == known; };
    return name == "skew" || std::any_of(intrinsic_names.begin(), intrinsic_names.end(), is_name) ||
           std::any_of(distortion_names.begin(), distortion_names.end(), is_name) ||
           std::any_of(projection_parameter_names.begin(), projection_parameter_names.end(),
                       is_name);
}

}  // namespace etalon
