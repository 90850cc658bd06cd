# `cmake --install` puts the programs, the libraries and their public headers in place, and
# find_package(etalon) finds them: linking etalon::sim alone gives the renderer. examples/library/
# shows how each of the five headers of etalon/ is used.

include(CMakePackageConfigHelpers)

install(TARGETS etalon_opencv EXPORT etalonTargets)
foreach(library core report calib sim capture stage compare bench study station)
    install(TARGETS etalon_${library} EXPORT etalonTargets)
endforeach()
install(CODE "set(SOURCE_DIR \"${PROJECT_SOURCE_DIR}\")\nset(BINARY_DIR \"${PROJECT_BINARY_DIR}\")")
install(CODE "set(VERSION \"${PROJECT_VERSION}\")")
install(SCRIPT cmake/install_headers.cmake)
install(SCRIPT cmake/install_shell_files.cmake COMPONENT shell)
install(TARGETS etalon)
if(TARGET etalon-twin)
    install(TARGETS etalon-twin)
endif()
install(DIRECTORY stage/profiles web examples DESTINATION ${CMAKE_INSTALL_DATADIR}/etalon
    USE_SOURCE_PERMISSIONS)
# The programs find these in the build folder as they do where they are installed.
file(MAKE_DIRECTORY ${PROJECT_BINARY_DIR}/share/etalon)
foreach(folder examples web)
    file(CREATE_LINK ${PROJECT_SOURCE_DIR}/${folder} ${PROJECT_BINARY_DIR}/share/etalon/${folder} SYMBOLIC)
endforeach()
install(EXPORT etalonTargets NAMESPACE etalon::
    DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/etalon)
set(ETALON_PLUGIN_DIR ${CMAKE_INSTALL_LIBDIR}/etalon)
configure_package_config_file(cmake/etalonConfig.cmake.in
    ${PROJECT_BINARY_DIR}/etalonConfig.cmake PATH_VARS ETALON_PLUGIN_DIR
    INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/etalon)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/etalonConfigVersion.cmake
    COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/etalonConfig.cmake ${PROJECT_BINARY_DIR}/etalonConfigVersion.cmake
    DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/etalon)
