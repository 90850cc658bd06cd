# Run by `cmake --install`: installs the headers of etalon/ and what these include, and nothing else.
# "sim/render/renderer.h" becomes <etalon/sim/render/renderer.h>, so that no name of ours stands in
# the way of a user's. Needs SOURCE_DIR, BINARY_DIR and CMAKE_INSTALL_PREFIX.
file(GLOB waiting RELATIVE ${SOURCE_DIR} ${SOURCE_DIR}/etalon/*.h)
set(seen ${waiting})
while(waiting)
    list(POP_FRONT waiting header)
    file(READ ${SOURCE_DIR}/${header} text)
    string(REGEX MATCHALL "#include \"[^\"]+" includes "${text}")
    list(TRANSFORM includes REPLACE "#include \"" "")
    list(REMOVE_ITEM includes ${seen})
    list(APPEND seen ${includes})
    list(APPEND waiting ${includes})

    string(REGEX REPLACE "#include \"(etalon/)?([^\"]+)\"" "#include <etalon/\\2>" text "${text}")
    string(REGEX REPLACE "^etalon/" "" installed ${header})
    file(WRITE ${BINARY_DIR}/include/${installed} "${text}")
    cmake_path(GET installed PARENT_PATH module)
    file(INSTALL ${BINARY_DIR}/include/${installed}
        DESTINATION ${CMAKE_INSTALL_PREFIX}/include/etalon/${module})
endwhile()
