# `cmake --install` puts the programs, the libraries and their headers in place, and
# find_package(etalon) finds them: linking etalon::sim alone gives the renderer.

include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(libraries core calib sim capture stage compare)
install(TARGETS etalon_opencv EXPORT etalonTargets)
foreach(library IN LISTS libraries)
    install(TARGETS etalon_${library} EXPORT etalonTargets)
    install(DIRECTORY ${library}/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/etalon/${library}
        FILES_MATCHING PATTERN "*.h")
endforeach()
install(TARGETS etalon)
if(TARGET etalon-twin)
    install(TARGETS etalon-twin)
endif()
install(DIRECTORY stage/profiles DESTINATION ${CMAKE_INSTALL_DATADIR}/etalon)
install(EXPORT etalonTargets NAMESPACE etalon::
    DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/etalon)
configure_package_config_file(cmake/etalonConfig.cmake.in
    ${PROJECT_BINARY_DIR}/etalonConfig.cmake
    INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/etalon)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/etalonConfigVersion.cmake
    COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/etalonConfig.cmake ${PROJECT_BINARY_DIR}/etalonConfigVersion.cmake
    DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/etalon)
