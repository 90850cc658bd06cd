#include "core/image/image.h"

#include <algorithm>
#include <array>
#include <opencv2/imgproc.hpp>

#include "core/file/file_writing.h"
#include "core/image/picture_codec.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

using FileBytes = std::vector<unsigned char>;

// `count` bytes from `at` as text, shorter behind the end.
std::string_view text_at(const FileBytes& bytes, std::size_t at, std::size_t count) {
    const std::string_view all(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    return at < all.size() ? all.substr(at, count) : std::string_view();
}

// ISO 23008-12: a box "ftyp" at the beginning with one of these brands.
bool is_heif(const FileBytes& bytes) {
    constexpr std::array<std::string_view, 6> brands{"heic", "heix", "hevc",
                                                     "mif1", "msf1", "avif"};
    return text_at(bytes, 4, 4) == "ftyp" &&
           std::ranges::find(brands, text_at(bytes, 8, 4)) != brands.end();
}

// DICOM PS3.10, 7.1: these letters behind a preamble of 128 bytes. Debian's OpenCV hands such a
// file to GDCM 3.0.21, which ends the program when what follows is no DICOM.
bool is_dicom(const FileBytes& bytes) {
    constexpr std::string_view mark = "DICM";
    return text_at(bytes, 0, 4) == mark || text_at(bytes, 128, 4) == mark;
}

// Whether a JPEG lacks the marker that ends it, FF D9, behind its segments (ITU-T T.81, B.1.1); one
// in a segment, of a thumbnail, is another picture's. It would be decoded as far as it goes.
bool is_cut_jpeg(const FileBytes& bytes) {
    constexpr std::string_view begin = "\xff\xd8", end = "\xff\xd9";
    if (text_at(bytes, 0, 2) != begin)
        return false;
    constexpr unsigned char marker = 0xff, start_of_scan = 0xda;
    std::size_t at = begin.size();
    while (at + 4 <= bytes.size() && bytes[at] == marker && bytes[at + 1] != start_of_scan)
        at += bytes[at + 1] == marker ? 1U : 2U + (bytes[at + 2] << 8 | bytes[at + 3]);
    return at >= bytes.size() ||
           std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size())
                   .find(end, at) == std::string_view::npos;
}

// What is not read at all, and why; empty for all others.
std::string refusal(const FileBytes& bytes) {
    if (is_heif(bytes))
        return "is HEIC, which is not read here: convert it to PNG, or to JPEG of quality 95 "
               "(heif-convert)";
    if (is_dicom(bytes))
        return "is DICOM, which is not read here: convert it to PNG";
    if (is_cut_jpeg(bytes))
        return "is a JPEG that ends early: copy or download it again";
    return "";
}

// Longer ones hold more pixels than are read.
constexpr std::uintmax_t longest_file = std::uintmax_t{1} << 31;

FileBytes bytes_of(const std::filesystem::path& path) {
    std::error_code error, ignored;
    const std::uintmax_t size = std::filesystem::file_size(path, error);
    if (!std::filesystem::exists(path, ignored))
        throw ConfigError({path.string()}, "no such image");
    if (error || size > longest_file)
        throw ConfigError({path.string()}, error ? error.message() : "is longer than 2 GB");
    FileBytes bytes(size);
    std::ifstream file(path, std::ios::binary);
    if (!file.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size)))
        throw ConfigError({path.string()}, "cannot be read");
    note_input(path);
    return bytes;
}

cv::Mat read_any(const std::filesystem::path& path) {
    const FileBytes bytes = bytes_of(path);
    if (const std::string why = refusal(bytes); !why.empty())
        throw ConfigError({path.string()}, why);
    try {
        return decode_picture(bytes);
    } catch (const Error& error) {
        throw ConfigError({path.string()}, error.what());
    }
}

void write_any(const std::filesystem::path& path, const cv::Mat& image) {
    FileBytes bytes;
    try {
        bytes = encode_picture(path.extension().string(), image);
    } catch (const Error& error) {
        throw ConfigError({path.string()}, std::string("cannot be written: ") + error.what());
    }
    AtomicFile file(path);
    file.write({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    file.commit();
}

}  // namespace

const char* name(FrameStatus status) {
    constexpr const char* names[] = {"complete", "short", "corrupt", "lost", "timed out"};
    return names[static_cast<std::size_t>(status)];
}

const char* name(TimeSource source) {
    constexpr const char* names[] = {"request", "device clock", "driver, start", "driver, end",
                                     "recording"};
    return names[static_cast<std::size_t>(source)];
}

CodeImage read_image(const std::filesystem::path& path) {
    cv::Mat image = read_any(path);
    if (image.channels() == 3)
        cv::cvtColor(image, image, cv::COLOR_BGR2GRAY);
    else if (image.channels() == 4)
        cv::cvtColor(image, image, cv::COLOR_BGRA2GRAY);
    if (image.type() == CV_8UC1)
        return {image, 8};
    if (image.type() == CV_16UC1)
        return {image, 16};
    throw ConfigError({path.string()}, "is neither an 8-bit nor a 16-bit image");
}

void write_image(const std::filesystem::path& path, const CodeImage& image) {
    write_any(path, image.pixels);
}

void write_picture(const std::filesystem::path& path, const cv::Mat& bgr) {
    write_any(path, bgr);
}

void write_radiance(const std::filesystem::path& path, const Radiance& radiance) {
    write_any(path, radiance);
}

Radiance read_radiance(const std::filesystem::path& path) {
    cv::Mat image = read_any(path);
    if (image.type() != CV_32FC1)
        throw ConfigError({path.string()}, "is not a 32-bit float image with one channel");
    return image;
}

}  // namespace etalon
