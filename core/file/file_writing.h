// Files that a full disk or a killed program leaves as they were, or with a last line cut off, and
// folders that one program writes at a time. All throw as fail_writing() does: DiskError where the
// disk does not take it.
//
// No file takes the number of a closed stdin, stdout or stderr: what is printed would be written
// into it. These numbers are reserved when a program, or Python's module, is loaded.
#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <string_view>

#include "core/file/file_descriptor.h"

namespace etalon {

// While one lives, the files that are read as inputs (note_input()) are written by nobody: no other
// name and no link leads around it. For programs that do one job; from a library people may write
// what they have read. One at a time.
class InputGuard {
public:
    InputGuard();
    ~InputGuard();
    InputGuard(const InputGuard&) = delete;
    InputGuard& operator=(const InputGuard&) = delete;
};

// Of open_text(), read_image() and the like. Nothing without a guard. From every thread.
void note_input(const std::filesystem::path& file);

// Replaces a file in one step: its text goes to "FILE.part", which commit() renames. Readers see
// the old or the new file. Without commit() the old one stays, and no part is left. Of a link the
// file is replaced that it leads to; owner and mode of the file stay. What is no regular file (a
// pipe, a terminal, /dev/stdout) is not replaced but written to. Throws ConfigError for a disk, for
// an input, for the file that stdout or stderr goes to, and while another program writes it.
class AtomicFile {
public:
    explicit AtomicFile(const std::filesystem::path& path);
    ~AtomicFile();
    AtomicFile(const AtomicFile&) = delete;
    AtomicFile& operator=(const AtomicFile&) = delete;

    void write(std::string_view bytes);
    void commit();

private:
    std::filesystem::path path_, target_;  // as it was named; the file itself
    std::filesystem::path part_;           // empty: none, or none any more
    FileDescriptor file_;
    std::string buffer_;
};

// A file that grows, with one writer at a time. What is written is in it when write() returns, and
// nothing of it comes later. Throws ConfigError for an input and while another one writes to it.
class AppendFile {
public:
    explicit AppendFile(const std::filesystem::path& path);

    void write(std::string_view bytes);

private:
    std::filesystem::path path_;
    FileDescriptor file_;
};

// Returns when a file's content, or a folder's names, outlast a power cut: 0.5 ms to some 20 ms.
void sync_to_disk(const std::filesystem::path& file_or_folder);

// Keeps other programs from writing to a folder: an advisory lock (flock(2)), which the kernel
// releases when its holder dies. Leaves nothing in the folder. A network file system may let
// another machine in; an AppendFile keeps that off, too.
class FolderLock {
public:
    // Does not wait. Throws ConfigError where there is no such folder, and when another lock is
    // held, here or elsewhere.
    explicit FolderLock(const std::filesystem::path& folder);

private:
    FileDescriptor folder_;
};

// Makes the folder, and those above it, where they are missing, and locks it.
FolderLock claim_folder(const std::filesystem::path& folder);

// The folder of a report, which the same command may write again: what the earlier report had and
// this one has not is removed, and other people's files stay. The names of its files are in
// ".KIND-files" there.
class ReportFolder {
public:
    ReportFolder(const std::filesystem::path& folder, const std::string& kind);

    // The path of a file of the report, to be written now. From one thread at a time.
    std::filesystem::path operator/(const std::string& name);

    // The report is whole. Without it, nothing of the earlier one is removed.
    void finish();

private:
    FolderLock lock_;
    std::filesystem::path folder_, list_file_;
    std::set<std::string> earlier_, names_;
    AppendFile list_;
};

}  // namespace etalon
