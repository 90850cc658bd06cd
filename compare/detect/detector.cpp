#include "compare/detect/detector.h"

#include <fmt/format.h>

#include "compare/detect/detector_adaptors.h"

namespace etalon {

std::vector<Eigen::Vector3d> seen_points_mm(const Marker& marker, const DetectedCorners& corners) {
    if (corners.is_whole())
        return marker.points_mm;
    std::vector<Eigen::Vector3d> seen;
    for (const int point : corners.points)
        seen.push_back(marker.points_mm.at(static_cast<std::size_t>(point)));
    return seen;
}

std::string drawn_otherwise(const std::string& shown_as) {
    return "the board that is seen is " + shown_as + ": name it so";
}

Detection only_one(const std::vector<DetectedCorners>& found) {
    if (found.empty())
        return {{}, "marker not found"};
    if (found.size() > 1)
        return {{}, fmt::format("marker {} is seen {} times", found[0].id, found.size()), found};
    return {found[0]};
}

cv::Mat as_8_bit(const CodeImage& image) {
    if (image.bits == 8 && image.pixels.type() == CV_8UC1)
        return image.pixels;
    cv::Mat scaled;
    image.pixels.convertTo(scaled, CV_8U, 255.0 / image.full_scale());
    return scaled;
}

}  // namespace etalon
