#include "core/file/file_sync.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

#include "core/program/errors.h"

namespace etalon {

void sync_to_disk(const std::filesystem::path& file_or_folder) {
    const int descriptor = open(file_or_folder.c_str(), O_RDONLY | O_CLOEXEC);
    const int failure = descriptor < 0 || fsync(descriptor) != 0 ? errno : 0;
    if (descriptor >= 0)
        close(descriptor);
    // A file system that cannot keep folders by themselves keeps them some other way.
    if (failure != 0 && failure != EINVAL)
        fail_writing(file_or_folder, {failure, std::generic_category()});
}

}  // namespace etalon
