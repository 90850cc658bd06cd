#include "station/setup/station_lock.h"

#include <fcntl.h>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <netdb.h>
#include <pwd.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <ctime>
#include <set>

#include "core/file/sha256.h"

namespace etalon {
namespace {

// A host by its number, IPv4's where it has one, or as it is written: localhost is 127.0.0.1.
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

// By its number: links and other nodes of the same device are the same.
std::string name_of(const SerialPort& serial) {
    struct stat status {};
    if (stat(serial.device.c_str(), &status) == 0 && S_ISCHR(status.st_mode))
        return fmt::format("serial {}:{}", major(status.st_rdev), minor(status.st_rdev));
    return "serial " + serial.device;
}

// Of the controllers that drive the stage's axes. A serial line has one master, whatever its units.
std::set<std::string> controllers_of(const StationStage& stage) {
    if (const auto* serial = std::get_if<SerialPort>(&stage.link.address))
        return {name_of(*serial)};
    const auto& tcp = std::get<TcpAddress>(stage.link.address);
    const std::string host = numeric(tcp.host);
    const bool is_loopback = host.starts_with("127.") || host == "::1";
    std::error_code ignored;
    const std::string network =
        is_loopback ? std::filesystem::read_symlink("/proc/self/ns/net", ignored).string() : "";
    std::set<std::string> names;
    for (const Axis& axis : stage.axes)
        names.insert(fmt::format("tcp {} {} unit {} {}", host, tcp.port,
                                 axis.unit.value_or(stage.link.unit), network));
    return names;
}

// The same for all users of a machine, whatever their rights.
std::filesystem::path lock_folder() {
    constexpr const char* usual = "/run/lock";
    const char* chosen = std::getenv("ETALON_LOCK_FOLDER");
    if (chosen && *chosen != '\0')
        return chosen;
    struct stat status {};
    const bool may_write = stat(usual, &status) == 0 && (status.st_mode & S_IWOTH) != 0;
    return may_write ? usual : "/tmp";
}

// Everybody can lock it: who can only read it, too.
int opened(const std::filesystem::path& path) {
    constexpr int flags = O_CLOEXEC | O_NOFOLLOW;
    for (int attempt = 0; attempt < 2; ++attempt) {  // another program may make it in between
        for (const int access : {O_RDWR, O_RDONLY})
            if (const int existing = open(path.c_str(), access | flags); existing >= 0)
                return existing;
        if (errno != ENOENT)
            return -1;
        const int made = open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | flags, 0666);
        if (made >= 0)
            fchmod(made, 0666);
        if (made >= 0 || errno != EEXIST)
            return made;
    }
    return -1;
}

std::string words_in(int descriptor) {
    std::array<char, 256> text{};
    const ssize_t count = pread(descriptor, text.data(), text.size(), 0);
    return count > 0 ? std::string(text.data(), static_cast<std::size_t>(count)) : "another";
}

int locked(const std::filesystem::path& path, const StageLink& stage, const std::string& holder) {
    const int descriptor = opened(path);
    if (descriptor >= 0 && flock(descriptor, LOCK_EX | LOCK_NB) == 0) {
        if (ftruncate(descriptor, 0) == 0) {
            [[maybe_unused]] const ssize_t count =
                pwrite(descriptor, holder.data(), holder.size(), 0);
        }
        return descriptor;
    }
    const int error = errno;
    const std::string by = descriptor >= 0 ? words_in(descriptor) : "";
    if (descriptor >= 0)
        close(descriptor);
    if (descriptor >= 0 && error == EWOULDBLOCK)
        throw ConfigError({"stage " + describe(stage)}, "is in use by " + by);
    throw ConfigError(
        {path.string()},
        fmt::format("cannot be locked: {}. Without this lock another program could move the stage "
                    "{} at the same time. Set ETALON_LOCK_FOLDER to a folder that all users of the "
                    "stage can write to, the same for all of them",
                    std::generic_category().message(error), describe(stage)));
}

}  // namespace

StationLock::StationLock(const StationStage& stage, const std::string& holder) {
    const std::filesystem::path folder = lock_folder();
    try {
        for (const std::string& controller : controllers_of(stage))
            descriptors_.push_back(locked(
                folder / fmt::format("etalon-stage-{}.lock", sha256(controller).substr(0, 16)),
                stage.link, holder));
    } catch (const ConfigError&) {
        for (const int descriptor : descriptors_)
            close(descriptor);
        throw;
    }
}

StationLock::~StationLock() {
    for (const int descriptor : descriptors_)
        close(descriptor);
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
