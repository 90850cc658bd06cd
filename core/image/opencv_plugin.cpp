#include "core/image/opencv_plugin.h"

#include <fmt/format.h>

#include <cstdlib>

#include "core/image/picture_codec.h"
#include "core/program/plugin.h"

namespace etalon {

const OpenCvPlugin& opencv_plugin() {
    static const OpenCvPlugin& opencv = []() -> const OpenCvPlugin& {
        // OpenCV's own limit, which it takes from there when its library is loaded.
        setenv("OPENCV_IO_MAX_IMAGE_PIXELS", fmt::format("{}", most_picture_pixels).c_str(), 0);
        return plugin<OpenCvPlugin>("opencv");
    }();
    return opencv;
}

}  // namespace etalon
