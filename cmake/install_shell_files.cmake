# Run by `cmake --install`: asks the built programs for their completions and their help, and installs
# the completions of bash, zsh and fish and a manual page for every command. Pages are made by
# help2man; where that is missing there are none. Needs BINARY_DIR, CMAKE_INSTALL_PREFIX, VERSION.
set(program ${BINARY_DIR}/etalon)
set(scratch ${BINARY_DIR}/shell)
set(share ${CMAKE_INSTALL_PREFIX}/share)

# install_completion(SHELL FOLDER NAME)
function(install_completion shell folder name)
    execute_process(COMMAND ${program} completion ${shell}
        OUTPUT_FILE ${scratch}/${name} COMMAND_ERROR_IS_FATAL ANY)
    file(INSTALL ${scratch}/${name} DESTINATION ${share}/${folder})
endfunction()
file(MAKE_DIRECTORY ${scratch})
install_completion(bash bash-completion/completions etalon)
install_completion(zsh zsh/vendor-completions _etalon)
install_completion(fish fish/vendor_completions.d etalon.fish)

# Schemas for editors, from the files that have every key.
file(GLOB files ${SOURCE_DIR}/examples/every-key/*.y*ml
    ${SOURCE_DIR}/examples/study/*.yaml ${SOURCE_DIR}/stage/profiles/*.yaml)
list(FILTER files EXCLUDE REGEX "/(twin[^/]*|psf)\\.y")
execute_process(COMMAND ${program} schema --out ${scratch}/schema ${files} COMMAND_ERROR_IS_FATAL ANY)
if(EXISTS ${BINARY_DIR}/etalon-twin)
    file(GLOB files ${SOURCE_DIR}/examples/every-key/twin*.yaml)
    execute_process(COMMAND ${BINARY_DIR}/etalon-twin --schema ${scratch}/schema ${files}
        COMMAND_ERROR_IS_FATAL ANY)
endif()
file(INSTALL ${scratch}/schema DESTINATION ${share}/etalon)

find_program(HELP2MAN help2man)
if(NOT HELP2MAN)
    message(STATUS "help2man is missing: no manual pages are installed")
    return()
endif()

# install_page(NAME SUMMARY COMMAND...): NAME.1 from the command's --help.
function(install_page name summary)
    list(JOIN ARGN " " command)
    execute_process(COMMAND ${HELP2MAN} --no-info --no-discard-stderr --section=1
            --manual=Etalon --source=etalon --version-string=${VERSION} --name=${summary}
            --output=${scratch}/${name}.1 ${command}
        COMMAND_ERROR_IS_FATAL ANY)
    # "etalon render" is found as what its page is called.
    file(READ ${scratch}/${name}.1 page)
    string(REGEX REPLACE "(.SH NAME\n)[^\n]* \\\\- " "\\1${name} \\\\- " page "${page}")
    file(WRITE ${scratch}/${name}.1 "${page}")
    file(INSTALL ${scratch}/${name}.1 DESTINATION ${share}/man/man1)
endfunction()
install_page(etalon "qualifies calibrated cameras on a motorised stage" ${program})
if(EXISTS ${BINARY_DIR}/etalon-twin)
    install_page(etalon-twin "a simulated camera and stage" ${BINARY_DIR}/etalon-twin)
endif()
execute_process(COMMAND ${program} completion commands
    OUTPUT_VARIABLE lines COMMAND_ERROR_IS_FATAL ANY OUTPUT_STRIP_TRAILING_WHITESPACE)
string(REPLACE ";" "," lines "${lines}")
string(REPLACE "\n" ";" lines "${lines}")
foreach(line IN LISTS lines)
    string(REGEX MATCH "^([^\t]+)\t(.*)$" matched "${line}")
    set(summary "${CMAKE_MATCH_2}")
    string(REPLACE " " ";" words "${CMAKE_MATCH_1}")
    list(JOIN words "-" page)
    install_page(etalon-${page} "${summary}" ${program} ${words})
endforeach()
