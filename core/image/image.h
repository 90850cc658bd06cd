// Images and frames: the words in which cameras, the renderer and the comparison talk.
//
// Pixel (0, 0) is the centre of the top-left pixel, x right, y down. Inside, intensities are linear
// radiance in [0, 1]; code values exist only behind the sensor model.
#pragma once

#include <opencv2/core.hpp>

#include <cstdint>
#include <filesystem>
#include <map>

#include "core/time/clock.h"

namespace etalon {

// Colour filters on a sensor's pixels.

// By the first two pixels of the first two rows.
enum class Mosaic { none, rggb, bggr, grbg, gbrg };

// CV_32FC1, linear radiance, 1 = full scale. Pixels that the camera model cannot reach are
// NaN-free: the renderer reports them in a mask of its own.
using Radiance = cv::Mat;

// What a camera delivers: CV_8UC1 (bits <= 8) or CV_16UC1, the code value in the low bits.
struct CodeImage {
    cv::Mat pixels;
    int bits = 8;  // 1..16; full scale is 2^bits - 1

    int full_scale() const { return (1 << bits) - 1; }
};

// What became of a frame on its way from the sensor. Only `complete` frames are measured.
enum class FrameStatus {
    complete,
    short_frame,  // fewer bytes than the format needs
    corrupt,      // flagged by the driver, or missing packets
    lost,         // announced but never arrived
    timed_out,    // nothing came in time
};
const char* name(FrameStatus status);

// The settings of an exposure: as asked for, and as read back from the device.
struct CaptureSettings {
    int width = 0, height = 0;  // px; 0 leaves the device's own
    int bits = 8;               // per pixel; 0: as many as `format` has
    // The device's own name of its pixel format ("GREY", "Y12P", "Mono12p"); empty: a monochrome
    // one that holds `bits`. Of colour images the luma is kept, of a mosaic the raw pixels.
    std::string format;
    std::chrono::microseconds exposure{0};  // 0 leaves the device's own
    double gain_db = 0.0;
    std::optional<double> black_level;  // in the device's unit; nothing leaves its own
    // What starts an exposure, by the device's own name ("Software", "Line1"), or "none" for a
    // camera that runs freely; empty: by software, and freely where the device has no trigger.
    std::string trigger;
    std::map<std::string, double> controls;  // further ones by the device's name, in its unit
};

// How the station knows when an exposure began.
enum class TimeSource {
    request,       // between asking for the frame and its arrival
    device_clock,  // the device's own clock, mapped to the station's
    driver_start,  // the driver's stamp at the start of the exposure or of the readout
    driver_end,    // the driver's stamp when the frame had arrived, less what came before
    recording,     // not at all: the image was taken some time ago
};
const char* name(TimeSource source);

struct Frame {
    CodeImage image;  // empty unless the status is complete
    Mosaic mosaic = Mosaic::none;
    FrameStatus status = FrameStatus::timed_out;
    std::string status_detail;              // the driver's own words, for the record
    std::uint64_t id = 0;                   // the device's frame counter
    Instant exposure_start{};               // on the station's clock
    Duration exposure_start_uncertainty{};  // the exposure began within +- this
    TimeSource time_source = TimeSource::request;
    std::uint64_t device_time_ns = 0;  // the frame's stamp as the device gave it; 0: none
    CaptureSettings settings;          // in force during the exposure
};

// The one reader of picture files (core/image/picture_codec.h): 8 or 16 bit, one channel; colours
// become luma (Rec. 601, as OpenCV does), transparency is dropped, EXIF's rotation not followed, so
// that all photographs of a camera have one size. Written by the extension. Throws ConfigError with
// the path.
CodeImage read_image(const std::filesystem::path& path);
void write_image(const std::filesystem::path& path, const CodeImage& image);

// Whether it is a JPEG that viewers show rotated or mirrored, by EXIF's orientation. False for what
// cannot be read. Reads 128 KiB.
bool is_marked_rotated(const std::filesystem::path& path);

// A picture for people, CV_8UC3 in OpenCV's order (BGR). Throws as above.
void write_picture(const std::filesystem::path& path, const cv::Mat& bgr);

// 32-bit float TIFF of linear radiance.
void write_radiance(const std::filesystem::path& path, const Radiance& radiance);
Radiance read_radiance(const std::filesystem::path& path);

}  // namespace etalon
