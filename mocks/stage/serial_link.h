// A serial line with a name that its user may choose: a symbolic link to the station's end.
#pragma once

#include <filesystem>

#include "mocks/stage/serial_pair.h"

namespace etalon {

class SerialLink {
public:
    // A link that is there already is left from a twin that was killed, and replaced; anything else
    // of that name is a DeviceError.
    explicit SerialLink(std::filesystem::path path);
    ~SerialLink();  // the link is gone with the line
    SerialLink(const SerialLink&) = delete;
    SerialLink& operator=(const SerialLink&) = delete;

    const SerialPair& pair() const { return pair_; }
    const std::filesystem::path& path() const { return path_; }

private:
    SerialPair pair_;
    std::filesystem::path path_;
};

}  // namespace etalon
