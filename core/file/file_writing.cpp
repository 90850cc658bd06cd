#include "core/file/file_writing.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>

#include <cerrno>
#include <fstream>
#include <mutex>

#include "core/file/text.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// Before anything of ours is opened; later libraries are loaded with these numbers taken, too. Like
// a closed descriptor, one of O_PATH refuses to be read and written.
[[gnu::constructor(101)]] void reserve_standard_descriptors() {
    int taken = -1;
    do
        taken = open("/", O_PATH);  // the lowest number that is free
    while (taken >= 0 && taken <= STDERR_FILENO);
    if (taken >= 0)
        close(taken);
}

[[noreturn]] void fail_with(int error, const std::filesystem::path& path) {
    fail_writing(path, {error, std::generic_category()});
}

using FileStatus = struct stat;

bool is_same(const FileStatus& a, const FileStatus& b) {
    return a.st_dev == b.st_dev && a.st_ino == b.st_ino;
}

struct KnownInputs {
    std::mutex mutex;
    bool are_guarded = false;
    std::set<std::pair<dev_t, ino_t>> files;
};

KnownInputs& known_inputs() {
    static KnownInputs inputs;
    return inputs;
}

bool is_input(const FileStatus& file) {
    const std::lock_guard lock(known_inputs().mutex);
    return known_inputs().files.contains({file.st_dev, file.st_ino});
}

// What every writer asks of a file that is there.
void require_writable(const std::filesystem::path& path, const FileStatus& file) {
    if (S_ISBLK(file.st_mode))
        throw ConfigError({path.string()}, "is a disk, which is not written to: name a file");
    if (!S_ISREG(file.st_mode))
        return;
    for (const int stream : {STDOUT_FILENO, STDERR_FILENO})
        if (FileStatus status{}; fstat(stream, &status) == 0 && is_same(status, file))
            throw ConfigError({path.string()},
                              "is where stdout or stderr goes: name another file to write");
    if (is_input(file))
        throw ConfigError({path.string()},
                          "is an input of this command and stays: name another file to write");
}

// Where a path leads: the last link may lead to a file that is not there yet.
std::filesystem::path followed(std::filesystem::path path) {
    constexpr int most_links = 40;  // as many as the kernel follows
    std::error_code error;
    for (int links = 0; std::filesystem::is_symlink(path, error); ++links) {
        if (links == most_links)
            fail_with(ELOOP, path);
        path = path.parent_path() / std::filesystem::read_symlink(path, error);
    }
    return path;
}

bool is_locked_by_another(const FileDescriptor& file) {
    return flock(file.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

// Locked, so that two programs do not write one part. Its last writer may rename or remove it
// between the opening and the locking.
FileDescriptor opened_part(const std::filesystem::path& part, const std::filesystem::path& path) {
    constexpr int most_attempts = 100;
    for (int attempt = 0; attempt < most_attempts; ++attempt) {
        FileDescriptor file(open(part.c_str(), O_WRONLY | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0666));
        if (!file)
            fail_with(errno, path);
        if (is_locked_by_another(file))
            break;
        FileStatus opened{}, named{};
        if (fstat(file.get(), &opened) != 0 || lstat(part.c_str(), &named) != 0 ||
            !is_same(opened, named))
            continue;
        if (ftruncate(file.get(), 0) != 0)  // what a killed program left
            fail_with(errno, path);
        return file;
    }
    throw ConfigError({path.string()}, "is being written by another program");
}

void write_all(const FileDescriptor& file, std::string_view bytes,
               const std::filesystem::path& path) {
    while (!bytes.empty()) {
        const ssize_t count = ::write(file.get(), bytes.data(), bytes.size());
        if (count >= 0)
            bytes.remove_prefix(static_cast<std::size_t>(count));
        else if (errno != EINTR)
            fail_with(errno, path);
    }
}

}  // namespace

InputGuard::InputGuard() {
    const std::lock_guard lock(known_inputs().mutex);
    known_inputs().are_guarded = true;
}

InputGuard::~InputGuard() {
    const std::lock_guard lock(known_inputs().mutex);
    known_inputs().are_guarded = false;
    known_inputs().files.clear();
}

void note_input(const std::filesystem::path& file) {
    const std::lock_guard lock(known_inputs().mutex);
    if (FileStatus status{}; known_inputs().are_guarded && stat(file.c_str(), &status) == 0)
        known_inputs().files.emplace(status.st_dev, status.st_ino);
}

AtomicFile::AtomicFile(const std::filesystem::path& path) : path_(path) {
    FileStatus there{};
    const bool is_there = stat(path.c_str(), &there) == 0;
    if (is_there)
        require_writable(path, there);
    if (is_there && !S_ISREG(there.st_mode)) {
        file_ = FileDescriptor(open(path.c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC));
        if (!file_)
            fail_with(errno, path);
        return;
    }
    target_ = followed(path);
    std::filesystem::path part = target_;
    part += ".part";
    file_ = opened_part(part, path);
    part_ = part;
    if (!is_there)
        return;
    // As far as the user may and the file system can.
    [[maybe_unused]] const int owner = fchown(file_.get(), there.st_uid, there.st_gid);
    [[maybe_unused]] const int mode = fchmod(file_.get(), there.st_mode & 0777);
}

AtomicFile::~AtomicFile() {
    std::error_code ignored;
    if (!part_.empty())
        std::filesystem::remove(part_, ignored);
}

void AtomicFile::write(std::string_view bytes) {
    constexpr std::size_t enough = 1u << 16;
    buffer_ += bytes;
    if (buffer_.size() < enough)
        return;
    write_all(file_, buffer_, path_);
    buffer_.clear();
}

void AtomicFile::commit() {
    write_all(file_, buffer_, path_);
    buffer_.clear();
    if (close(dup(file_.get())) != 0)  // NFS tells only then that the disk is full
        fail_with(errno, path_);
    if (part_.empty())
        return;
    std::error_code error;
    std::filesystem::rename(part_, target_, error);
    if (error)
        fail_writing(path_, error);
    part_.clear();
}

AppendFile::AppendFile(const std::filesystem::path& path) : path_(path) {
    FileStatus there{};
    if (stat(path.c_str(), &there) == 0)
        require_writable(path, there);
    // For writing also where it is only locked: NFS grants exclusive locks only then.
    file_ = FileDescriptor(open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666));
    if (!file_ || fstat(file_.get(), &there) != 0)
        fail_with(errno, path);
    if (!S_ISREG(there.st_mode) || flock(file_.get(), LOCK_EX | LOCK_NB) == 0)
        return;
    throw ConfigError({path.string()},
                      errno == EWOULDBLOCK
                          ? "is in use: another etalon is writing to it"
                          : "cannot be locked: " + std::generic_category().message(errno));
}

void AppendFile::write(std::string_view bytes) {
    write_all(file_, bytes, path_);
}

void sync_to_disk(const std::filesystem::path& file_or_folder) {
    const FileDescriptor file(open(file_or_folder.c_str(), O_RDONLY | O_CLOEXEC));
    const int failure = !file || fsync(file.get()) != 0 ? errno : 0;
    // A file system that cannot keep folders by themselves keeps them some other way.
    if (failure != 0 && failure != EINVAL)
        fail_writing(file_or_folder, {failure, std::generic_category()});
}

FolderLock::FolderLock(const std::filesystem::path& folder)
    : folder_(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
    if (!folder_)
        throw ConfigError({folder.string()}, errno == ENOENT
                                                 ? "no such folder"
                                                 : std::generic_category().message(errno));
    if (is_locked_by_another(folder_))
        throw ConfigError({folder.string()}, "is in use: another etalon is writing to this folder");
}

FolderLock claim_folder(const std::filesystem::path& folder) {
    make_folder(folder);
    return FolderLock(folder);
}

ReportFolder::ReportFolder(const std::filesystem::path& folder, const std::string& kind)
    : lock_(claim_folder(folder)),
      folder_(folder),
      list_file_(folder / ("." + kind + "-files")),
      list_(list_file_) {
    std::ifstream list(list_file_);
    for (std::string name; std::getline(list, name);)
        if (!name.empty() && name.find('/') == std::string::npos)
            earlier_.insert(name);
}

std::filesystem::path ReportFolder::operator/(const std::string& name) {
    if (names_.insert(name).second && !earlier_.contains(name))
        list_.write(name + "\n");  // at once: a killed program's files are known, too
    return folder_ / name;
}

void ReportFolder::finish() {
    std::string text;
    for (const std::string& name : names_)
        text += name + "\n";
    for (const std::string& name : earlier_)
        if (FileStatus file{}; !names_.contains(name) &&
                               lstat((folder_ / name).c_str(), &file) == 0 && !is_input(file))
            unlink((folder_ / name).c_str());
    write_text(list_file_, text);
}

}  // namespace etalon
