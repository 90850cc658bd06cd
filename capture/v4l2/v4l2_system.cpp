#include "capture/v4l2/v4l2_system.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <filesystem>
#include <fstream>

namespace etalon {
namespace {

namespace fs = std::filesystem;

int result_of(int result) {
    return result < 0 ? -errno : result;
}

// N of "/dev/videoN"; -1 for any other path.
int node_number(const fs::path& path) {
    const std::string name = path.filename().string();
    int number = -1;
    if (name.rfind("video", 0) == 0)
        std::from_chars(name.data() + 5, name.data() + name.size(), number);
    return number;
}

class KernelSystem final : public V4l2System {
public:
    std::vector<std::string> nodes() override;
    std::string serial_number(const std::string& node) override;

    int open(const std::string& node) override {
        return result_of(::open(node.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC));
    }
    int close(int file) override { return result_of(::close(file)); }
    int ioctl(int file, unsigned long request, void* argument) override {
        return result_of(::ioctl(file, request, argument));
    }
    void* map(int file, std::size_t length, off_t offset) override {
        void* memory = ::mmap(nullptr, length, PROT_READ, MAP_SHARED, file, offset);
        return memory == MAP_FAILED ? nullptr : memory;
    }
    void unmap(void* memory, std::size_t length) override { ::munmap(memory, length); }
    int poll(int file, std::chrono::milliseconds timeout) override {
        pollfd waited{file, POLLIN, 0};
        const int ready = result_of(::poll(&waited, 1, static_cast<int>(timeout.count())));
        return ready > 0 ? waited.revents : ready;
    }
};

std::vector<std::string> KernelSystem::nodes() {
    std::vector<fs::path> found;
    std::error_code error;
    for (fs::directory_iterator entry("/dev", error), end; !error && entry != end;
         entry.increment(error))
        if (node_number(entry->path()) >= 0)
            found.push_back(entry->path());
    std::sort(found.begin(), found.end(),
              [](const fs::path& a, const fs::path& b) { return node_number(a) < node_number(b); });
    return {found.begin(), found.end()};
}

// The node's "device" is the USB interface; the number is an attribute of the device above it.
std::string KernelSystem::serial_number(const std::string& node) {
    std::error_code error;
    const fs::path real = fs::canonical(node, error);  // may be a link below /dev/v4l
    const fs::path interface =
        fs::canonical("/sys/class/video4linux" / real.filename() / "device", error);
    std::string serial;
    if (!error)
        std::getline(std::ifstream(interface.parent_path() / "serial"), serial);
    return serial;
}

}  // namespace

V4l2System& v4l2_system() {
    static KernelSystem system;
    return system;
}

}  // namespace etalon
