# Every library from outside, found once. Required ones stop the configuration; the SDKs of
# devices are optional: without one its backend is left out, and `etalon devices` says so.

find_package(PkgConfig REQUIRED)
find_package(Threads REQUIRED)
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(OpenCV 4.5 REQUIRED COMPONENTS core imgproc calib3d
                         imgcodecs videoio ximgproc)   # the plugin's, and the tests'
if(OpenCV_VERSION VERSION_LESS 4.7)
    set(aruco opencv_aruco)   # a contributed module
else()
    set(aruco opencv_objdetect)
endif()
find_package(PNG REQUIRED)
find_package(JPEG REQUIRED)
find_package(TIFF REQUIRED)
find_package(Boost 1.74 REQUIRED CONFIG)   # Boost.Math, headers only
find_package(OpenSSL REQUIRED)
find_package(yaml-cpp REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(CLI11 REQUIRED)
find_package(fmt REQUIRED)
find_package(TBB REQUIRED)
pkg_check_modules(APRILTAG REQUIRED IMPORTED_TARGET apriltag)
pkg_check_modules(HWY REQUIRED IMPORTED_TARGET libhwy)
pkg_check_modules(HTTPLIB REQUIRED IMPORTED_TARGET cpp-httplib)
pkg_check_modules(SQLITE REQUIRED IMPORTED_TARGET sqlite3)

pkg_check_modules(MODBUS REQUIRED IMPORTED_TARGET libmodbus>=3.1.6)
pkg_check_modules(ARAVIS IMPORTED_TARGET aravis-0.8)
pkg_check_modules(LIBXML2 IMPORTED_TARGET libxml-2.0)   # Aravis' own
pkg_check_modules(LIBCAMERA IMPORTED_TARGET libcamera)

if(NOT TARGET yaml-cpp::yaml-cpp)
    add_library(yaml-cpp::yaml-cpp ALIAS yaml-cpp)   # the target's name before yaml-cpp 0.8
endif()

# OpenCV's headers mix enumerations in ways that C++20 deprecates: included as system headers. Linked
# is what loads within milliseconds; imgcodecs, videoio and ximgproc, which bring GDAL, FFmpeg and
# GStreamer along, are a plugin's (core/image/opencv_plugin.h).
add_library(etalon_opencv INTERFACE)
target_include_directories(etalon_opencv SYSTEM INTERFACE ${OpenCV_INCLUDE_DIRS})
target_link_libraries(etalon_opencv INTERFACE opencv_core opencv_imgproc opencv_calib3d ${aruco})

set(ETALON_HAVE_ARAVIS ${ARAVIS_FOUND})
if(NOT LIBXML2_FOUND)
    set(ETALON_HAVE_ARAVIS 0)
endif()
message(STATUS "Aravis (GenICam cameras): ${ETALON_HAVE_ARAVIS} ${ARAVIS_VERSION}")

set(ETALON_HAVE_LIBCAMERA ${LIBCAMERA_FOUND})
message(STATUS "libcamera: ${LIBCAMERA_FOUND} ${LIBCAMERA_VERSION}")
