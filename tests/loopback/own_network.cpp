// Gives a test program a network of its own, loopback only: GigE Vision's control port is fixed,
// and two tests with a camera, or a test and a demo, would meet there. Where the kernel does not
// allow it, tests wait for each other instead. Programs that a test starts are in its network.
#include <fcntl.h>
#include <net/if.h>
#include <sched.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

namespace {

// Without rights of its own a program may do it as the root of a user namespace.
bool leave_the_common_network() {
    const std::string id = std::to_string(getuid());
    if (unshare(CLONE_NEWNET) == 0)
        return true;
    if (unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0)
        return false;
    std::ofstream("/proc/self/uid_map") << "0 " << id << " 1";
    return true;
}

void switch_loopback_on() {
    ifreq request{};
    std::string("lo").copy(request.ifr_name, IFNAMSIZ);
    request.ifr_flags = IFF_UP;
    const int socket = ::socket(AF_INET, SOCK_DGRAM, 0);
    ioctl(socket, SIOCSIFFLAGS, &request);
    close(socket);
}

void wait_for_the_common_network() {
    const auto file = std::filesystem::temp_directory_path() / "etalon-loopback.lock";
    const int lock = open(file.c_str(), O_CREAT | O_RDWR, 0666);
    flock(lock, LOCK_EX);  // until the program and all that it starts have ended
}

// Before main(): no thread runs yet, which a user namespace asks for.
[[maybe_unused]] const bool done = [] {
    if (leave_the_common_network())
        switch_loopback_on();
    else
        wait_for_the_common_network();
    return true;
}();

}  // namespace
