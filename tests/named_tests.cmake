# Every test that a document names, as `Suite.Name`, must exist. Run as a test; fails with every name
# that does not.

cmake_policy(VERSION 3.25)

file(GLOB_RECURSE sources ${ROOT}/tests/*.cpp ${ROOT}/tests/*.h ${ROOT}/tests/CMakeLists.txt)
set(declared "")
foreach(source IN LISTS sources)
    file(READ ${source} text)
    string(REGEX MATCHALL "TEST(_F|_P)?\\([A-Za-z0-9_]+,[ \n]*[A-Za-z0-9_]+|NAME [A-Za-z0-9]+\\.[A-Za-z0-9]+"
        tests "${text}")
    list(APPEND declared ${tests})
endforeach()
list(TRANSFORM declared REPLACE "TEST(_F|_P)?\\(([A-Za-z0-9_]+),[ \n]*([A-Za-z0-9_]+)" "\\2.\\3")
list(TRANSFORM declared REPLACE "^NAME " "")

set(missing "")
set(count 0)
file(GLOB pages RELATIVE ${ROOT} ${ROOT}/docs/*.md)
foreach(page IN LISTS pages)
    file(READ ${ROOT}/${page} document)
    string(REGEX MATCHALL "`[A-Z][A-Za-z0-9]+\\.[A-Z][A-Za-z0-9]+`" names "${document}")
    foreach(name IN LISTS names)
        math(EXPR count "${count} + 1")
        string(REPLACE "`" "" name ${name})
        if(NOT name IN_LIST declared)
            string(APPEND missing "  ${page}: ${name}\n")
        endif()
    endforeach()
endforeach()

if(missing OR count EQUAL 0)
    message(FATAL_ERROR "Documents name tests that do not exist:\n${missing}")
endif()
message(STATUS "All ${count} tests that documents name exist.")
