# Compiler settings that every target shares, as one interface target.

add_library(etalon_compiler INTERFACE)
# No fast-math anywhere: NaN must stay visible, and sums must not be reordered behind our back.
# No contraction: a fused multiply-add in one build and not in the next would change results.
target_compile_options(etalon_compiler INTERFACE
    -Wall -Wextra -Wpedantic -Wno-missing-field-initializers -Wnon-virtual-dtor -Woverloaded-virtual -ffp-contract=off
    # On every file or none: a precompiled header is refused when they differ. Position-independent, so
    # that the libraries can be linked into shared ones and Python's module; without interposition, so
    # that calls within a file are still inlined, and the renderer is as fast.
    -pthread -fPIC -fno-semantic-interposition
    $<$<BOOL:${ETALON_WARNINGS_AS_ERRORS}>:-Werror>)

# What is linked is what is used, whatever a library's own list says.
target_link_options(etalon_compiler INTERFACE LINKER:--as-needed)

# g++ 12 sees an impossible memcpy inside std::string (its bug 105651): not our warning.
# -Wshadow=local: names of other files of the module are no reason for a warning.
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    target_compile_options(etalon_compiler INTERFACE -Wshadow=local -Wno-stringop-overflow -Wno-stringop-overread -Wno-restrict -Wno-array-bounds)
endif()

if(ETALON_SANITIZE)
    target_compile_options(etalon_compiler INTERFACE
        -fsanitize=${ETALON_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all
        # The address sanitizer sees what the first two would; Eigen binds references to nothing when it
        # solves an empty system. Plugins have no type information that the third could compare.
        -fno-sanitize=null,object-size,vptr
        # Nor do they see a variable or a vector that nobody has set: it is no plausible number.
        -ftrivial-auto-var-init=pattern)
    target_compile_definitions(etalon_compiler INTERFACE EIGEN_INITIALIZE_MATRICES_BY_NAN
        # As without the address sanitizer: libraries with and without it free what the other made.
        EIGEN_MALLOC_ALREADY_ALIGNED=1)
    target_link_options(etalon_compiler INTERFACE -fsanitize=${ETALON_SANITIZE})
    if(CMAKE_CXX_COMPILER_ID MATCHES "Clang")
        # Functions that g++ compiled carry no type that it could check.
        target_compile_options(etalon_compiler INTERFACE -fno-sanitize=function
            -fsanitize-ignorelist=${PROJECT_SOURCE_DIR}/tests/fuzz/coverage/unaligned_modules.txt)
    endif()
    if(ETALON_SANITIZE MATCHES "fuzzer")
        target_compile_options(etalon_compiler INTERFACE
            -fsanitize-coverage-allowlist=${PROJECT_SOURCE_DIR}/tests/fuzz/coverage/covered_modules.txt)
    endif()
endif()

# Shared libraries, and with them mocks, which shares their precompiled header. Programs find the
# libraries wherever both are moved to.
if(BUILD_SHARED_LIBS)
    set(CMAKE_POSITION_INDEPENDENT_CODE ON)
    set(CMAKE_BUILD_RPATH_USE_ORIGIN ON)
    set(CMAKE_INSTALL_RPATH "$ORIGIN/../${CMAKE_INSTALL_LIBDIR}")
endif()

# ccache is used when it is there. The two sloppiness flags are what it needs for precompiled
# headers; neither can change what is compiled. Paths below the source folder count as relative, so
# that a second clone finds what the first one compiled.
find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
    set(CMAKE_CXX_COMPILER_LAUNCHER
        ${CMAKE_COMMAND} -E env CCACHE_SLOPPINESS=pch_defines,time_macros
        CCACHE_BASEDIR=${PROJECT_SOURCE_DIR} CCACHE_NOHASHDIR=1 ${CCACHE_PROGRAM})
    if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
        target_compile_options(etalon_compiler INTERFACE -fpch-preprocess)
    else()
        target_compile_options(etalon_compiler INTERFACE "SHELL:-Xclang -fno-pch-timestamp")
    endif()
endif()
