# etalon_library(NAME [STATIC] [ONE_UNIT] [PUBLIC libs...] [PRIVATE libs...] [WITHOUT files or modules...])
#
# One library per folder at the top, with the alias etalon::NAME: every .cpp file of its modules. Static
# unless BUILD_SHARED_LIBS is on, as it is for the Debian packages; STATIC: even then.
# Headers are included from the root ("sim/render/renderer.h"). Each module is one translation unit: what
# its files include is then parsed once, which takes a quarter of the time; ONE_UNIT: the whole folder, which
# takes two thirds of that where modules use the same templates, but not in the preset dev, where an edit
# shall be seen in seconds. All folders share one precompiled header, made by core.
function(etalon_library name)
    cmake_parse_arguments(ARG "STATIC;ONE_UNIT" "" "PUBLIC;PRIVATE;WITHOUT" ${ARGN})
    set(kind "")
    if(ARG_STATIC)
        set(kind STATIC)
    endif()
    file(GLOB_RECURSE sources CONFIGURE_DEPENDS RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} *.cpp)
    foreach(pattern IN LISTS ARG_WITHOUT)
        list(FILTER sources EXCLUDE REGEX "^${pattern}")
    endforeach()
    set(linked "")
    if(ETALON_RELEASE_BUILD)
        set(all ${sources})
        etalon_without_numerics(sources ${name})
        if(NOT sources STREQUAL all)
            # An archive needs what it calls behind it: its folder's other modules and the folders below.
            add_library(etalon_${name}_numerics STATIC IMPORTED GLOBAL)
            set_target_properties(etalon_${name}_numerics PROPERTIES
                IMPORTED_LOCATION ${ETALON_RELEASE_BUILD}/${name}/libetalon_${name}.a
                INTERFACE_LINK_LIBRARIES "etalon_${name};${ARG_PUBLIC}")
            set(linked $<BUILD_INTERFACE:etalon_${name}_numerics>)
        endif()
    endif()
    add_library(etalon_${name} ${kind} ${sources})
    add_library(etalon::${name} ALIAS etalon_${name})
    # No symbol of its own for exports: a precompiled header is refused when one differs.
    set_target_properties(etalon_${name} PROPERTIES EXPORT_NAME ${name} DEFINE_SYMBOL ""
        VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION_MAJOR})
    target_include_directories(etalon_${name} PUBLIC
        $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>
        $<BUILD_INTERFACE:${PROJECT_BINARY_DIR}/generated>
        $<INSTALL_INTERFACE:include>)
    target_link_libraries(etalon_${name} PUBLIC ${linked} ${ARG_PUBLIC}
        PRIVATE $<BUILD_INTERFACE:etalon_compiler> ${ARG_PRIVATE})
    etalon_precompile(etalon_${name})
    if(ARG_ONE_UNIT AND (ETALON_SANITIZE OR CMAKE_BUILD_TYPE STREQUAL "Release"))
        etalon_join_sources(etalon_${name} ${sources})
    else()
        etalon_join_modules(etalon_${name} ${sources})
    endif()
endfunction()

# etalon_without_numerics(LIST FOLDER): takes the modules that only calculate out of a list of FOLDER's
# sources. Continuous integration links them, and the tests, from its release build
# (ETALON_RELEASE_BUILD) when it runs the sanitizers. What reaches these modules are numbers and
# matrices that were checked, and all their memory is Eigen's, OpenCV's or the standard library's. With
# sanitizers it compiles every other module: what reads files, wires, frames and the answers of
# programs, goes through pictures by pointers to their rows, or calculates with the processor's vectors;
# and every new module.
function(etalon_without_numerics list folder)
    set(numerics calib/camera calib/intrinsics calib/registration
        compare/drift compare/edges compare/expect compare/pose compare/uncertainty compare/decision
        compare/diagnosis)
    foreach(module IN LISTS numerics)
        if(module MATCHES "^${folder}/(.*)")
            list(FILTER ${list} EXCLUDE REGEX "(^|/)${CMAKE_MATCH_1}/")
        endif()
    endforeach()
    set(${list} ${${list}} PARENT_SCOPE)
endfunction()

# One translation unit for all of a target's sources.
function(etalon_join_sources target)
    set_source_files_properties(${ARGN} PROPERTIES UNITY_GROUP all)
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
endfunction()

# One translation unit for all of a target's sources in the same folder.
function(etalon_join_modules target)
    foreach(source IN LISTS ARGN)
        cmake_path(GET source PARENT_PATH module)
        string(REPLACE / _ group "all_${module}")
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

# etalon_text(FILE): a style sheet, a script or a text for people as a constant. Of station/compare/comparison.css,
# "station/compare/comparison.css.h" defines etalon::comparison_css.
function(etalon_text file)
    cmake_path(ABSOLUTE_PATH file)
    cmake_path(RELATIVE_PATH file BASE_DIRECTORY ${PROJECT_SOURCE_DIR} OUTPUT_VARIABLE path)
    cmake_path(GET path FILENAME name)
    string(REPLACE . _ name ${name})
    file(READ ${file} text)
    configure_file(${PROJECT_SOURCE_DIR}/cmake/text.h.in ${PROJECT_BINARY_DIR}/generated/${path}.h @ONLY)
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${file})
endfunction()
