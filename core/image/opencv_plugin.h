// What of OpenCV is loaded when first used (core/program/plugin.h): formats, films, edge segments.
#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace etalon {

// The plugin's table. Errors are cv::Exception, or what a function's line says.
struct OpenCvPlugin {
    // As cv::imdecode, of a row of bytes: any format, with the pixels where the file has them;
    // empty when it is none.
    cv::Mat (*decode)(const cv::Mat& bytes);
    // As cv::imencode for a file's extension (".bmp").
    std::vector<unsigned char> (*encode)(const std::string& extension, const cv::Mat& picture);
    // Calls `use` with each so many-th frame of a film, from the first: its number, its pixels
    // (BGR). False when the film cannot be opened.
    bool (*read_film)(const std::string& file, long every,
                      const std::function<void(long, const cv::Mat&)>& use);
    // Edge segments of an 8-bit image without parameters: C. Akinlar, C. Topal, "EDPF", IJPRAI 26
    // (2012).
    std::vector<std::vector<cv::Point>> (*edge_segments)(const cv::Mat& image);
};

// Throws Error when the plugin cannot be loaded. Any thread.
const OpenCvPlugin& opencv_plugin();

}  // namespace etalon
