#include "core/file/file_writing.h"

#include <fcntl.h>
#include <sys/file.h>

#include <cerrno>

#include "core/program/errors.h"

namespace etalon {
namespace {

// `step` of a stream, which tells why it failed in errno alone.
template <class Step>
void run_step(std::ofstream& file, const std::filesystem::path& path, Step step) {
    errno = 0;
    step();
    if (!file)
        fail_writing(path, {errno ? errno : EIO, std::generic_category()});
}

}  // namespace

AtomicFile::AtomicFile(const std::filesystem::path& path) : path_(path), part_(path) {
    part_ += ".part";
    run_step(file_, path_, [&] { file_.open(part_, std::ios::binary | std::ios::trunc); });
}

AtomicFile::~AtomicFile() {
    std::error_code ignored;
    if (!part_.empty())
        std::filesystem::remove(part_, ignored);
}

void AtomicFile::write(std::string_view bytes) {
    run_step(file_, path_,
             [&] { file_.write(bytes.data(), static_cast<std::streamsize>(bytes.size())); });
}

void AtomicFile::commit() {
    run_step(file_, path_, [&] { file_.close(); });
    std::error_code error;
    std::filesystem::rename(part_, path_, error);
    if (error)
        fail_writing(path_, error);
    part_.clear();
}

AppendFile::AppendFile(const std::filesystem::path& path) : path_(path) {
    file_.rdbuf()->pubsetbuf(nullptr, 0);
    run_step(file_, path_, [&] { file_.open(path_, std::ios::binary | std::ios::app); });
}

void AppendFile::write(std::string_view bytes) {
    run_step(file_, path_,
             [&] { file_.write(bytes.data(), static_cast<std::streamsize>(bytes.size())); });
}

void sync_to_disk(const std::filesystem::path& file_or_folder) {
    const FileDescriptor file(open(file_or_folder.c_str(), O_RDONLY | O_CLOEXEC));
    const int failure = !file || fsync(file.get()) != 0 ? errno : 0;
    // A file system that cannot keep folders by themselves keeps them some other way.
    if (failure != 0 && failure != EINVAL)
        fail_writing(file_or_folder, {failure, std::generic_category()});
}

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
