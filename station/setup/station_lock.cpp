#include "station/setup/station_lock.h"

#include <fcntl.h>
#include <fmt/chrono.h>
#include <netdb.h>
#include <pwd.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <ctime>
#include <filesystem>

#include "core/file/sha256.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// 127.0.0.1 is another place in another network namespace.
std::string network() {
    std::error_code ignored;
    return std::filesystem::read_symlink("/proc/self/ns/net", ignored).string();
}

// A host by its number, IPv4's where it has one, as it is written where nobody knows it: localhost
// and 127.0.0.1 are one.
std::string numeric(const std::string& host) {
    for (const int family : {AF_INET, AF_INET6}) {
        addrinfo hints{};
        hints.ai_family = family;
        addrinfo* found = nullptr;
        if (getaddrinfo(host.c_str(), nullptr, &hints, &found) != 0)
            continue;
        std::array<char, NI_MAXHOST> number{};
        const int failure = getnameinfo(found->ai_addr, found->ai_addrlen, number.data(),
                                        number.size(), nullptr, 0, NI_NUMERICHOST);
        freeaddrinfo(found);
        if (failure == 0)
            return number.data();
    }
    return host;
}

// However the link is spelled: a device by way of /dev/serial/by-id is the same.
StageLink as_one(StageLink stage) {
    if (auto* tcp = std::get_if<TcpAddress>(&stage.address))
        tcp->host = numeric(tcp->host);
    if (auto* serial = std::get_if<SerialPort>(&stage.address)) {
        std::error_code missing;
        const auto device = std::filesystem::canonical(serial->device, missing);
        serial->device = missing ? serial->device : device.string();
    }
    return stage;
}

std::filesystem::path lock_path(const StageLink& stage) {
    const std::filesystem::path usual = "/run/lock";
    const std::filesystem::path folder =
        access(usual.c_str(), W_OK) == 0 ? usual : std::filesystem::temp_directory_path();
    const std::string name = sha256(describe(as_one(stage)) + "\n" + network());
    return folder / fmt::format("etalon-stage-{}.lock", name.substr(0, 16));
}

// Another user's file can be locked by who can only read it.
int opened(const std::filesystem::path& path) {
    constexpr int flags = O_CLOEXEC | O_NOFOLLOW;
    const int existing = open(path.c_str(), O_RDWR | flags);
    if (existing >= 0)
        return existing;
    if (errno != ENOENT)
        return open(path.c_str(), O_RDONLY | flags);
    const int made = open(path.c_str(), O_RDWR | O_CREAT | flags, 0666);
    if (made >= 0)
        fchmod(made, 0666);
    return made;
}

std::string words_in(int descriptor) {
    std::array<char, 256> text{};
    const ssize_t count = pread(descriptor, text.data(), text.size(), 0);
    return count > 0 ? std::string(text.data(), static_cast<std::size_t>(count)) : "another";
}

}  // namespace

StationLock::StationLock(const StageLink& stage, const std::string& holder)
    : descriptor_(opened(lock_path(stage))) {
    if (descriptor_ < 0)
        return;
    if (flock(descriptor_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
        const std::string by = words_in(descriptor_);
        close(descriptor_);
        throw ConfigError({"stage " + describe(stage)}, "is in use by " + by);
    }
    if (ftruncate(descriptor_, 0) == 0) {
        [[maybe_unused]] const ssize_t count = pwrite(descriptor_, holder.data(), holder.size(), 0);
    }
}

StationLock::~StationLock() {
    if (descriptor_ >= 0)
        close(descriptor_);
}

std::string stage_holder(const std::string& what, const std::string& who) {
    std::string name = who;
    if (const passwd* user = name.empty() ? getpwuid(getuid()) : nullptr)
        name = user->pw_name;
    return fmt::format("{}{} since {:%H:%M} UTC, process {}", what,
                       name.empty() ? "" : " by " + name, fmt::gmtime(std::time(nullptr)),
                       getpid());
}

}  // namespace etalon
