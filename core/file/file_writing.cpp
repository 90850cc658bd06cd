#include "core/file/file_writing.h"

#include <cerrno>
#include <system_error>

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

}  // namespace etalon
