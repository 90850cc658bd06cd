# Every test that a document names must exist. Run as a test; fails with every name that does not.

cmake_policy(VERSION 3.25)

file(GLOB_RECURSE sources ${ROOT}/tests/*.cpp)
set(declared "")
foreach(source IN LISTS sources)
    file(READ ${source} text)
    string(REGEX MATCHALL "TEST(_F|_P)?\\([A-Za-z0-9_]+,[ \n]*[A-Za-z0-9_]+" tests "${text}")
    list(APPEND declared ${tests})
endforeach()
list(TRANSFORM declared REPLACE "TEST(_F|_P)?\\(([A-Za-z0-9_]+),[ \n]*([A-Za-z0-9_]+)" "\\2.\\3")

set(missing "")
file(READ ${ROOT}/docs/cameras.md document)
string(REGEX MATCHALL "`[A-Z][A-Za-z0-9]+\\.[A-Z][A-Za-z0-9]+`" names "${document}")
foreach(name IN LISTS names)
    string(REPLACE "`" "" name ${name})
    if(NOT name IN_LIST declared)
        string(APPEND missing "  docs/cameras.md: ${name}\n")
    endif()
endforeach()

list(LENGTH names count)
if(missing OR count EQUAL 0)
    message(FATAL_ERROR "Documents name tests that do not exist:\n${missing}")
endif()
message(STATUS "All ${count} tests that docs/cameras.md names exist.")
