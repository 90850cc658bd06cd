# Sourced by demo.sh and test.sh: what the project needs from Debian or Ubuntu, and how it is
# installed when something is missing. Nothing is fetched or asked when all is there.

build_packages="clang cmake ninja-build ccache pkg-config libopencv-dev libopencv-contrib-dev \
    libpng-dev libjpeg-dev libtiff-dev libeigen3-dev libapriltag-dev libaravis-dev libusb-1.0-0-dev libcamera-dev \
    libmodbus-dev libyaml-cpp-dev nlohmann-json3-dev libcli11-dev libfmt-dev libhwy-dev libtbb-dev \
    libboost-math-dev libssl-dev libcpp-httplib-dev libsqlite3-dev"
docs_packages="mkdocs mkdocs-material doxygen python3-matplotlib"   # scripts/docs.sh
package_packages="debhelper dh-python lintian help2man pybind11-dev python3-dev"   # scripts/package.sh
test_packages="libgtest-dev libgmock-dev poppler-utils libxml2-utils"
# ./test.sh --all: Google Benchmark; a system clock that jumps; a virtual machine for tests with real
# camera drivers (its emulator, what its first file system is made of, and the service that tells
# programs about devices); a cluster of one node; another compiler for who links our libraries;
# clang's libFuzzer; mrcal and COLMAP, for what
# we write for them; Python's module and its tests; the shells that complete our commands; the
# documentation's site; a reader of pipelines' files; certificates as PDF.
all_test_packages="libbenchmark-dev libfaketime qemu-system-x86 busybox-static kmod cpio udev slurm-wlm \
    g++ libclang-rt-dev python3-mrcal colmap pybind11-dev python3-dev python3-numpy python3-pytest \
    python3-matplotlib python3-opencv bash-completion zsh fish $docs_packages python3-yaml \
    python3-jsonschema weasyprint"

missing_packages() {
    local package
    for package in "$@"; do
        dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' ||
            echo "$package"
    done
}

# install_packages PACKAGE...: as root, else through sudo, else says the exact line and gives up.
install_packages() {
    command -v apt-get >/dev/null || {
        echo "This script installs Debian or Ubuntu packages, and this system has no apt-get." >&2
        echo "Install the equivalents of: $*" >&2
        return 3
    }
    local missing
    missing=$(missing_packages "$@")
    [ -n "$missing" ] || return 0
    # shellcheck disable=SC2086  # a list of words on purpose
    set -- $missing
    local apt="apt-get -q -o DPkg::Lock::Timeout=300"
    local as_root=""
    if [ "$(id -u)" -ne 0 ]; then
        if ! sudo -n true 2>/dev/null && ! { [ -t 0 ] && command -v sudo >/dev/null; }; then
            echo "These packages are missing and need an administrator:" >&2
            echo "    apt-get update && apt-get install --no-install-recommends $*" >&2
            return 3
        fi
        as_root=sudo
    fi
    echo "== installing $# packages: $*"
    # shellcheck disable=SC2086
    $as_root env DEBIAN_FRONTEND=noninteractive $apt update >/dev/null &&
        $as_root env DEBIAN_FRONTEND=noninteractive $apt install -y --no-install-recommends "$@" \
            >build/packages.log 2>&1 || {
        echo "Installing failed; the last lines of build/packages.log:" >&2
        tail -n 15 build/packages.log >&2
        return 3
    }
}

# build_etalon TARGET...: configures and builds the release preset; says what it took, quiet else
# unless it fails. With clang, which takes two thirds of g++'s time, unless CXX or an earlier build says
# otherwise.
build_etalon() {
    local begun=$SECONDS
    if [ -z "${CXX:-}" ] && command -v clang++ >/dev/null; then
        export CC=clang CXX=clang++
    fi
    echo "== building (log: build/build.log)"
    if ! { cmake --preset release && cmake --build build/release --target "$@"; } \
            >build/build.log 2>&1; then
        echo "The build failed:" >&2
        grep -E -A 5 'error|Error|FAILED' build/build.log | head -n 40 >&2
        return 3
    fi
    echo "   built in $((SECONDS - begun)) s"
}

has_clang_sanitizers() {
    echo 'extern "C" int LLVMFuzzerTestOneInput(const char*, unsigned long) { return 0; }' |
        clang++ -x c++ -fsanitize=fuzzer,address,undefined - -o /dev/null 2>/dev/null
}

# Configures build/sanitized: the sanitizers' build of continuous integration and of scripts/fuzz.sh.
# It links tests and calculating modules from build/release. With clang where it is there: it compiles in
# half of the time, and the same build serves the fuzzer.
configure_sanitized() {
    local options=()
    if has_clang_sanitizers; then
        options=(-D CMAKE_C_COMPILER=clang -D CMAKE_CXX_COMPILER=clang++
            -D ETALON_SANITIZE=fuzzer-no-link,address,undefined
            -D CMAKE_CXX_FLAGS_RELWITHDEBINFO="-O2 -g1")   # faster than -O1 to compile and to run
    fi
    cmake --preset asan-ubsan -B build/sanitized -D ETALON_RELEASE_BUILD="$PWD/build/release" "${options[@]}"
}
