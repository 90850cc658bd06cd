#include "mocks/stage/serial_link.h"

#include <utility>

#include "core/program/errors.h"

namespace etalon {

namespace fs = std::filesystem;

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
