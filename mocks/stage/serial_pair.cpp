#include "mocks/stage/serial_pair.h"

#include <fcntl.h>
#include <stdlib.h>
#include <termios.h>

#include <cerrno>
#include <cstring>

#include "core/program/errors.h"

namespace etalon {
namespace {

namespace fs = std::filesystem;

// Without echo and without line editing, until the station sets what it needs.
bool make_raw(int fd) {
    termios settings{};
    if (tcgetattr(fd, &settings) != 0)
        return false;
    cfmakeraw(&settings);
    return tcsetattr(fd, TCSANOW, &settings) == 0;
}

}  // namespace

SerialPair::SerialPair() : controller_(posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)) {
    char name[64] = "";
    const int fd = controller_.get();
    if (controller_ && grantpt(fd) == 0 && unlockpt(fd) == 0 &&
        ptsname_r(fd, name, sizeof name) == 0)
        keeper_ = FileDescriptor(open(name, O_RDWR | O_NOCTTY | O_CLOEXEC));
    device_ = name;
    if (!keeper_ || !make_raw(keeper_.get()))
        throw DeviceError("stage controller", "make a pseudo-terminal", std::strerror(errno));
}

SerialLink::SerialLink(fs::path path) : path_(std::move(path)) {
    std::error_code error;
    if (fs::is_symlink(fs::symlink_status(path_, error)))
        fs::remove(path_, error);
    fs::create_symlink(pair_.device(), path_, error);
    if (error)
        throw DeviceError("stage controller", "link " + path_.string() + " to its line",
                          error.message());
}

SerialLink::~SerialLink() {
    std::error_code ignored;
    if (fs::read_symlink(path_, ignored) == pair_.device())
        fs::remove(path_, ignored);
}

}  // namespace etalon
