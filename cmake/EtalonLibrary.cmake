# etalon_library(NAME [STATIC] [PUBLIC libs...] [PRIVATE libs...] [WITHOUT files or rooms...])
#
# One library per folder at the top, with the alias etalon::NAME: every .cpp file of its rooms. Static
# unless BUILD_SHARED_LIBS is on, as it is for the Debian packages; STATIC: even then.
# Headers are included from the root ("sim/render/renderer.h"). Each room is one translation unit: what
# its files include is then parsed once, which takes a quarter of the time. All folders share one
# precompiled header, made by core.
function(etalon_library name)
    cmake_parse_arguments(ARG "STATIC" "" "PUBLIC;PRIVATE;WITHOUT" ${ARGN})
    set(kind "")
    if(ARG_STATIC)
        set(kind STATIC)
    endif()
    file(GLOB_RECURSE sources CONFIGURE_DEPENDS RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} *.cpp)
    foreach(pattern IN LISTS ARG_WITHOUT)
        list(FILTER sources EXCLUDE REGEX "^${pattern}")
    endforeach()
    add_library(etalon_${name} ${kind} ${sources})
    add_library(etalon::${name} ALIAS etalon_${name})
    # No symbol of its own for exports: a precompiled header is refused when one differs.
    set_target_properties(etalon_${name} PROPERTIES EXPORT_NAME ${name} DEFINE_SYMBOL ""
        VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION_MAJOR})
    target_include_directories(etalon_${name} PUBLIC
        $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>
        $<BUILD_INTERFACE:${PROJECT_BINARY_DIR}/generated>
        $<INSTALL_INTERFACE:include>)
    target_link_libraries(etalon_${name} PUBLIC ${ARG_PUBLIC}
        PRIVATE $<BUILD_INTERFACE:etalon_compiler> ${ARG_PRIVATE})
    etalon_precompile(etalon_${name})
    etalon_join_rooms(etalon_${name} ${sources})
endfunction()

# One translation unit for all of a target's sources in the same folder.
function(etalon_join_rooms target)
    foreach(source IN LISTS ARGN)
        cmake_path(GET source PARENT_PATH room)
        string(REPLACE / _ group "${target}_${room}")
        set_source_files_properties(${source} PROPERTIES UNITY_GROUP ${group})
    endforeach()
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
endfunction()

# Reuses core's precompiled header, so that OpenCV, Eigen and the standard library are parsed once.
set(etalon_common_headers
    ${PROJECT_SOURCE_DIR}/core/precompiled/eigen_instances.h
    ${PROJECT_SOURCE_DIR}/core/precompiled/json_instances.h <opencv2/core.hpp> <fmt/format.h>
    <algorithm> <array> <chrono> <cmath> <filesystem> <fstream> <functional> <iostream> <map> <memory>
    <mutex> <numeric> <optional> <set> <span> <sstream> <string> <string_view> <thread> <variant>
    <vector>)
function(etalon_precompile target)
    if(target STREQUAL "etalon_core")
        target_precompile_headers(${target} PRIVATE ${etalon_common_headers})
    else()
        target_precompile_headers(${target} REUSE_FROM etalon_core)
    endif()
endfunction()

# The same with GoogleMock, made by the first program that asks.
function(etalon_precompile_tests target)
    get_property(first GLOBAL PROPERTY etalon_first_test)
    if(first)
        target_precompile_headers(${target} REUSE_FROM ${first})
    else()
        set_property(GLOBAL PROPERTY etalon_first_test ${target})
        target_precompile_headers(${target} PRIVATE ${etalon_common_headers} <gmock/gmock.h>
            <gtest/gtest.h>)
    endif()
endfunction()
