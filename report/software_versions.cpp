#include "report/software_versions.h"

#include <fmt/format.h>
#include <Eigen/Core>

#include <opencv2/core.hpp>

#include "core/program/version.h"

namespace etalon {

// Versions that only the build knows come from report/CMakeLists.txt.
std::vector<SoftwareVersion> software_versions() {
    return {
        {"etalon", version},
        {"OpenCV", cv::getVersionString()},
        {"Eigen",
         fmt::format("{}.{}.{}", EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION)},
        {"Boost", ETALON_BOOST_VERSION},
        {"AprilTag", ETALON_APRILTAG_VERSION},
        {"oneTBB", ETALON_TBB_VERSION},
        {"libmodbus", ETALON_MODBUS_VERSION},
        {"Aravis", ETALON_ARAVIS_VERSION},
        {"libcamera", ETALON_LIBCAMERA_VERSION},
        {"yaml-cpp", ETALON_YAML_VERSION},
        {"compiler", ETALON_COMPILER},
    };
}

}  // namespace etalon
