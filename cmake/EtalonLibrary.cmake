# etalon_library(NAME SOURCES ... [PUBLIC libs...] [PRIVATE libs...])
#
# One static library per folder, with the alias etalon::NAME. Headers are included from the root
# ("sim/renderer.h"). All folders share one precompiled header, made by core.
function(etalon_library name)
    cmake_parse_arguments(ARG "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
    add_library(etalon_${name} STATIC ${ARG_SOURCES})
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
