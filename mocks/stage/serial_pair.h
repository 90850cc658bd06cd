// Two ends of a serial line without a wire: a pseudo-terminal, as posix_openpt() gives it. The
// controller holds this end, the station opens the device by its name. Bytes pass at once, whatever
// the baud rate, and the parity is not looked at.
#pragma once

#include <string>

namespace etalon {

class SerialPair {
public:
    SerialPair();  // throws DeviceError
    ~SerialPair();
    SerialPair(const SerialPair&) = delete;
    SerialPair& operator=(const SerialPair&) = delete;

    const std::string& device() const { return device_; }  // "/dev/pts/7"
    int controller_end() const { return controller_; }     // does not block

private:
    int controller_ = -1;
    int keeper_ = -1;  // holds the station's end open, or reading ours would fail without one
    std::string device_;
};

}  // namespace etalon
