// Files that a full disk or a killed program leaves as they were, or with a last line cut off. All
// throw as fail_writing() does: DiskError where the disk does not take it.
#pragma once

#include <filesystem>
#include <fstream>
#include <string_view>

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

}  // namespace etalon
