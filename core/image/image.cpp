#include "core/image/image.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string_view>

#include "core/file/file_writing.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// The first bytes of a file, zeros behind its end.
using FileStart = std::array<char, 132>;
FileStart start_of(const std::filesystem::path& path) {
    FileStart start{};
    std::ifstream(path, std::ios::binary).read(start.data(), start.size());
    return start;
}

// ISO 23008-12: a box "ftyp" at the beginning with one of these brands.
bool is_heif(const FileStart& start) {
    const std::string_view box(&start[4], 4), brand(&start[8], 4);
    constexpr std::array<std::string_view, 6> brands{"heic", "heix", "hevc",
                                                     "mif1", "msf1", "avif"};
    return box == "ftyp" && std::ranges::find(brands, brand) != brands.end();
}

// DICOM PS3.10, 7.1: these letters behind a preamble of 128 bytes. Debian's OpenCV hands such a
// file to GDCM 3.0.21, which ends the program when what follows is no DICOM.
bool is_dicom(const FileStart& start) {
    constexpr std::string_view mark = "DICM";
    return std::string_view(&start[0], 4) == mark || std::string_view(&start[128], 4) == mark;
}

// Whether a JPEG lacks the marker that ends it, FF D9, behind its segments (ITU-T T.81, B.1.1); one
// in a segment, of a thumbnail, is another picture's. It would be decoded as far as it goes.
bool is_cut_jpeg(const std::filesystem::path& path) {
    constexpr std::string_view begin = "\xff\xd8", end = "\xff\xd9";
    std::string bytes(begin.size(), 0);
    std::ifstream file(path, std::ios::binary);
    if (!file.read(bytes.data(), static_cast<std::streamsize>(bytes.size())) || bytes != begin)
        return false;
    bytes.append(std::istreambuf_iterator<char>(file), {});
    const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(bytes[i]); };
    constexpr unsigned char marker = 0xff, start_of_scan = 0xda;
    std::size_t at = begin.size();
    while (at + 4 <= bytes.size() && byte(at) == marker && byte(at + 1) != start_of_scan)
        at += byte(at + 1) == marker ? 1U : 2U + (byte(at + 2) << 8 | byte(at + 3));
    return bytes.find(end, at) == std::string::npos;
}

cv::Mat read_any(const std::filesystem::path& path) {
    std::error_code ignored;
    if (!std::filesystem::exists(path, ignored))  // OpenCV would print a warning of its own
        throw ConfigError({path.string()}, "no such image");
    const FileStart start = start_of(path);
    if (is_heif(start))
        throw ConfigError({path.string()},
                          "is HEIC, which is not read here: convert it to PNG, or "
                          "to JPEG of quality 95 (heif-convert)");
    if (is_dicom(start))
        throw ConfigError({path.string()}, "is DICOM, which is not read here: convert it to PNG");
    if (is_cut_jpeg(path))
        throw ConfigError({path.string()}, "is a JPEG that ends early: copy or download it again");
    cv::Mat image;
    try {
        // As the sensor has it: whichever way up a viewer is told to show it, a camera is one.
        image = cv::imread(path.string(), cv::IMREAD_ANYDEPTH | cv::IMREAD_ANYCOLOR |
                                              cv::IMREAD_IGNORE_ORIENTATION);
    } catch (const cv::Exception& error) {
        throw ConfigError({path.string()}, "cannot be decoded: " + error.err);
    }
    if (image.empty())
        throw ConfigError({path.string()}, "is not an image that can be read");
    return image;
}

std::vector<unsigned char> encoded(const std::filesystem::path& path, const cv::Mat& image) {
    std::vector<unsigned char> bytes;
    try {
        if (cv::imencode(path.extension().string(), image, bytes))
            return bytes;
    } catch (const cv::Exception&) {
        // an extension that OpenCV has no writer for
    }
    throw ConfigError({path.string()}, "cannot be written: no such image format");
}

// OpenCV's own writer does not notice when the disk is full.
void write_any(const std::filesystem::path& path, const cv::Mat& image) {
    const std::vector<unsigned char> bytes = encoded(path, image);
    AtomicFile file(path);
    file.write({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    file.commit();
}

}  // namespace

const char* name(FrameStatus status) {
    switch (status) {
        case FrameStatus::complete:
            return "complete";
        case FrameStatus::short_frame:
            return "short";
        case FrameStatus::corrupt:
            return "corrupt";
        case FrameStatus::lost:
            return "lost";
        case FrameStatus::timed_out:
            return "timed out";
    }
    return "unknown";
}

const char* name(TimeSource source) {
    switch (source) {
        case TimeSource::request:
            return "request";
        case TimeSource::device_clock:
            return "device clock";
        case TimeSource::driver_start:
            return "driver, start";
        case TimeSource::driver_end:
            return "driver, end";
        case TimeSource::recording:
            return "recording";
    }
    return "unknown";
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
