#include "core/image/image.h"

#include <algorithm>
#include <array>
#include <opencv2/imgproc.hpp>

#include "core/file/file_writing.h"
#include "core/file/text.h"
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

// Of a TIFF structure (TIFF 6.0, 2): the tag Orientation of its first directory; 1 without.
unsigned tiff_orientation(std::string_view tiff) {
    const bool low_first = tiff.starts_with("II");
    const auto number = [&](std::size_t at, unsigned bytes) {
        std::size_t value = 0;
        for (unsigned i = 0; i < bytes; ++i) {
            const std::size_t from = at + (low_first ? bytes - 1 - i : i);
            value = value << 8 | (from < tiff.size() ? static_cast<unsigned char>(tiff[from]) : 0U);
        }
        return value;
    };
    constexpr std::size_t orientation = 0x0112, entry_bytes = 12, value_at = 8;
    const std::size_t directory = number(4, 4), entries = number(directory, 2);
    for (std::size_t i = 0; i < entries; ++i)
        if (const std::size_t at = directory + 2 + i * entry_bytes; number(at, 2) == orientation)
            return static_cast<unsigned>(number(at + value_at, 2));
    return 1;
}

// A JPEG's (CIPA DC-008 "Exif", 4.7.2), as far as these bytes go; 1: the pixels stand as shown.
unsigned exif_orientation(const FileBytes& bytes) {
    constexpr std::string_view head("Exif\0\0", 6);
    constexpr unsigned char marker = 0xff, app1 = 0xe1, start_of_scan = 0xda;
    std::size_t at = 2;
    while (at + 4 <= bytes.size() && bytes[at] == marker && bytes[at + 1] != start_of_scan) {
        const std::size_t length = static_cast<std::size_t>(bytes[at + 2] << 8 | bytes[at + 3]);
        if (bytes[at + 1] == app1 && text_at(bytes, at + 4, head.size()) == head)
            return tiff_orientation(text_at(bytes, at + 4 + head.size(), length));
        at += 2 + length;
    }
    return 1;
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
    require_file(path);
    std::error_code error;
    const std::uintmax_t size = std::filesystem::file_size(path, error);
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

bool is_marked_rotated(const std::filesystem::path& path) {
    constexpr std::size_t head_bytes = 128u << 10;  // Exif is in the first segments, of 64 KiB each
    if (!no_file_cause(path).empty())
        return false;
    FileBytes head(head_bytes);
    std::ifstream file(path, std::ios::binary);
    file.read(reinterpret_cast<char*>(head.data()), static_cast<std::streamsize>(head.size()));
    head.resize(static_cast<std::size_t>(file.gcount()));
    const unsigned orientation =
        head.size() > 2 && head[0] == 0xff && head[1] == 0xd8 ? exif_orientation(head) : 1;
    return orientation > 1 && orientation <= 8;
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
