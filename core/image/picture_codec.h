// Pictures in memory: PNG, JPEG and TIFF by libpng, libjpeg-turbo and libtiff; others, CMYK JPEGs
// and other TIFFs than ours by core/image/opencv_plugin.h. Pixels stay where the file has them
// (EXIF's rotation is not followed), transparency is dropped. Any thread; as fast as the libraries.
// Throws Error with the cause.
#pragma once

#include <opencv2/core.hpp>
#include <span>
#include <string>
#include <vector>

namespace etalon {

// More is refused before memory is taken: 16384 x 16384, 1.6 GB of 16-bit colour.
inline constexpr long most_picture_pixels = 1L << 28;

// CV_8UC1, CV_16UC1 or CV_32FC1; of colours CV_8UC3 or CV_16UC3 in OpenCV's order (BGR).
cv::Mat decode_picture(std::span<const unsigned char> bytes);

// CV_8UC1: a colour JPEG's own luma, before any conversion to RGB.
cv::Mat decode_jpeg_luma(std::span<const unsigned char> bytes);

// 8 or 16 bits, one channel, BGR or BGRA. Fast rather than small. A resolution of 0 is not written.
std::vector<unsigned char> encode_png(const cv::Mat& picture, unsigned dots_per_metre = 0);

// 8 bits, one channel or BGR; quality 0 to 100.
std::vector<unsigned char> encode_jpeg(const cv::Mat& picture, int quality = 95);

// By a file's extension (".png"), what the format has: a JPEG of quality 95, a TIFF of floats
// without compression.
std::vector<unsigned char> encode_picture(const std::string& extension, const cv::Mat& picture);

}  // namespace etalon
