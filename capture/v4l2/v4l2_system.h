// The system calls that the V4L2 backend makes, in one place, so that tests can put a scripted
// device in the kernel's stead (tests/fakes/fake_v4l2.h). No knowledge of video: see
// v4l2_device.h.
//
// Results are the kernel's: 0 or more, or the negative error number. Nothing throws or retries.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstddef>
#include <string>
#include <vector>

namespace etalon {

class V4l2System {
public:
    virtual ~V4l2System() = default;

    // Paths of the video nodes that exist now ("/dev/video0"), by number.
    virtual std::vector<std::string> nodes() = 0;

    // Of the USB device behind a node; empty where there is none.
    virtual std::string serial_number(const std::string& node) = 0;

    virtual int open(const std::string& node) = 0;  // for reading and writing, not blocking
    virtual int close(int file) = 0;
    virtual int ioctl(int file, unsigned long request, void* argument) = 0;

    // Shared memory of a buffer, for reading; null when refused.
    virtual void* map(int file, std::size_t length, off_t offset) = 0;
    virtual void unmap(void* memory, std::size_t length) = 0;

    // Waits for a filled buffer: the kernel's event bits (POLLIN, POLLERR ...), 0 at the time-out.
    virtual int poll(int file, std::chrono::milliseconds timeout) = 0;
};

// The machine's own. Safe from every thread.
V4l2System& v4l2_system();

}  // namespace etalon
