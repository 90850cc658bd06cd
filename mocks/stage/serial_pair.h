// Both ends of a serial line: a pseudo-terminal. The controller holds this end, the station opens
// the device by its name. Bytes pass at once; baud rate and parity have no effect.
#pragma once

#include <filesystem>
#include <string>

#include "core/file/file_descriptor.h"

namespace etalon {

class SerialPair {
public:
    SerialPair();  // throws DeviceError

    const std::string& device() const { return device_; }     // "/dev/pts/7"
    int controller_end() const { return controller_.get(); }  // does not block

private:
    FileDescriptor controller_;
    FileDescriptor keeper_;  // holds the station's end open, or reading ours would fail without one
    std::string device_;
};

// A serial line with a name that its user may choose: a symbolic link to the station's end.
class SerialLink {
public:
    // Replaces a link, which a killed twin left. Throws DeviceError for anything else of that name.
    explicit SerialLink(std::filesystem::path path);
    ~SerialLink();  // the link is gone with the line

    const SerialPair& pair() const { return pair_; }
    const std::filesystem::path& path() const { return path_; }

private:
    SerialPair pair_;
    std::filesystem::path path_;
};

}  // namespace etalon
