#include "mocks/stage/serial_pair.h"

#include <fcntl.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

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
    const bool named = controller_ >= 0 && grantpt(controller_) == 0 &&
                       unlockpt(controller_) == 0 && ptsname_r(controller_, name, sizeof name) == 0;
    keeper_ = named ? open(name, O_RDWR | O_NOCTTY | O_CLOEXEC) : -1;
    device_ = name;
    if (keeper_ >= 0 && make_raw(keeper_))
        return;
    const std::string cause = std::strerror(errno);
    ::close(keeper_);
    ::close(controller_);
    throw DeviceError("stage controller", "make a pseudo-terminal", cause);
}

SerialPair::~SerialPair() {
    ::close(keeper_);
    ::close(controller_);
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
