// Files that a full disk or a killed program leaves as they were, or with a last line cut off. All
// throw as fail_writing() does: DiskError where the disk does not take it.
#pragma once

#include <filesystem>
#include <fstream>
#include <string_view>

#include "core/file/file_descriptor.h"

namespace etalon {

// Replaces a file in one step: its text goes to "FILE.part", which commit() renames. Readers see
// the old or the new file. Without commit() the old one stays, and no part is left.
class AtomicFile {
public:
    explicit AtomicFile(const std::filesystem::path& path);
    ~AtomicFile();

    void write(std::string_view bytes);
    void commit();

private:
    std::filesystem::path path_, part_;
    std::ofstream file_;
};

// A file that grows. What is written is in it when write() returns, and nothing of it comes later.
class AppendFile {
public:
    explicit AppendFile(const std::filesystem::path& path);

    void write(std::string_view bytes);

private:
    std::filesystem::path path_;
    std::ofstream file_;  // without a buffer: what failed would be written again when it is closed
};

// Returns when a file's content, or a folder's names, outlast a power cut: 0.5 ms to some 20 ms.
void sync_to_disk(const std::filesystem::path& file_or_folder);

// An advisory lock on a file (flock(2)) against two programs writing to one folder. The kernel
// releases it when its holder dies.
class FileLock {
public:
    // Does not wait. Throws ConfigError when there is no such file, it cannot be written, or
    // another lock is held, here or elsewhere (naming its folder).
    explicit FileLock(const std::filesystem::path& file);

private:
    FileDescriptor file_;
};

}  // namespace etalon
