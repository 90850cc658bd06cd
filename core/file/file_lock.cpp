#include "core/file/file_lock.h"

#include <fcntl.h>
#include <sys/file.h>

#include <cerrno>

#include "core/program/errors.h"

namespace etalon {

// For writing, though nothing is written: NFS grants exclusive locks only then.
FileLock::FileLock(const std::filesystem::path& file)
    : file_(open(file.c_str(), O_RDWR | O_CLOEXEC)) {
    if (!file_)
        throw ConfigError({file.string()}, errno == ENOENT
                                               ? "no such file"
                                               : std::generic_category().message(errno));
    if (flock(file_.get(), LOCK_EX | LOCK_NB) == 0)
        return;
    if (errno == EWOULDBLOCK)
        throw ConfigError({file.parent_path().string()},
                          "is in use: another etalon is writing to this folder");
    throw ConfigError({file.string()},
                      "cannot be locked: " + std::generic_category().message(errno));
}

}  // namespace etalon
