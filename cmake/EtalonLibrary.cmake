# etalon_library(NAME [PUBLIC libs...] [PRIVATE libs...] [WITHOUT files or rooms...])
#
# One static library per folder at the top, with the alias etalon::NAME: every .cpp file of its rooms.
# Headers are included from the root ("sim/render/renderer.h"). All folders share one precompiled
# header, made by core.
function(etalon_library name)
    cmake_parse_arguments(ARG "" "" "PUBLIC;PRIVATE;WITHOUT" ${ARGN})
    file(GLOB_RECURSE sources CONFIGURE_DEPENDS RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} *.cpp)
    foreach(pattern IN LISTS ARG_WITHOUT)
        list(FILTER sources EXCLUDE REGEX "^${pattern}")
    endforeach()
    add_library(etalon_${name} STATIC ${sources})
    add_library(etalon::${name} ALIAS etalon_${name})
    set_target_properties(etalon_${name} PROPERTIES EXPORT_NAME ${name})
    target_include_directories(etalon_${name} PUBLIC
        $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>
        $<BUILD_INTERFACE:${PROJECT_BINARY_DIR}/generated>
        $<INSTALL_INTERFACE:include/etalon>)
    target_link_libraries(etalon_${name} PUBLIC ${ARG_PUBLIC}
        PRIVATE $<BUILD_INTERFACE:etalon_compiler> ${ARG_PRIVATE})
    etalon_precompile(etalon_${name})
endfunction()

# Reuses core's precompiled header, so that OpenCV, Eigen and the standard library are parsed once.
function(etalon_precompile target)
    if(target STREQUAL "etalon_core")
        target_precompile_headers(${target} PRIVATE
            <Eigen/Core> <Eigen/Geometry> <opencv2/core.hpp> <fmt/format.h>
            <algorithm> <array> <chrono> <cmath> <filesystem> <functional> <map> <memory> <mutex>
            <optional> <span> <string> <string_view> <thread> <vector>)
    else()
        target_precompile_headers(${target} REUSE_FROM etalon_core)
    endif()
endfunction()
