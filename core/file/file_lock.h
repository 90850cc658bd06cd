// An advisory lock on a file, so that two programs do not write to one folder: flock(2), which the
// kernel releases when its holder dies, however it dies. It leaves nothing behind.
#pragma once

#include <filesystem>

#include "core/file/file_descriptor.h"

namespace etalon {

class FileLock {
public:
    // Does not wait. Throws ConfigError when there is no such file, when it cannot be written, or
    // when another lock on it is held, here or in another process: the message names its folder.
    explicit FileLock(const std::filesystem::path& file);

private:
    FileDescriptor file_;
};

}  // namespace etalon
