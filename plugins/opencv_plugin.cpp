// The plugin `opencv`: see core/image/opencv_plugin.h.
#include "core/image/opencv_plugin.h"

#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <opencv2/ximgproc/edge_drawing.hpp>

#include "plugins/plugin.h"

namespace etalon {
namespace {

cv::Mat decode(const cv::Mat& bytes) {
    // As the sensor has it: whichever way up a viewer is told to show it, a camera is one.
    return cv::imdecode(bytes,
                        cv::IMREAD_ANYDEPTH | cv::IMREAD_ANYCOLOR | cv::IMREAD_IGNORE_ORIENTATION);
}

std::vector<unsigned char> encode(const std::string& extension, const cv::Mat& picture) {
    std::vector<unsigned char> bytes;
    if (!cv::imencode(extension, picture, bytes))
        bytes.clear();
    return bytes;
}

bool read_film(const std::string& file, long every,
               const std::function<void(long, const cv::Mat&)>& use) {
    cv::VideoCapture capture(file);
    if (!capture.isOpened())
        return false;
    cv::Mat picture;
    for (long frame = 0; capture.grab(); ++frame)
        if (frame % every == 0 && capture.retrieve(picture) && !picture.empty())
            use(frame, picture);
    return true;
}

std::vector<std::vector<cv::Point>> edge_segments(const cv::Mat& image) {
    const auto drawing = cv::ximgproc::createEdgeDrawing();
    drawing->params.PFmode = true;
    drawing->detectEdges(image);
    return drawing->getSegments();
}

constexpr OpenCvPlugin table{decode, encode, read_film, edge_segments};

}  // namespace
}  // namespace etalon

ETALON_EXPORT_PLUGIN(etalon::table)
