#include "compare/detector.h"

#include <fmt/format.h>

#include "compare/detector_adaptors.h"
#include "core/errors.h"
#include "core/text.h"

namespace etalon {
namespace {

std::string detector_of(const Marker& marker, const std::string& place) {
    switch (marker.kind) {
        case Marker::Kind::apriltag:
            return "apriltag";
        case Marker::Kind::aruco:
            return "aruco";
        case Marker::Kind::topotag:
            return "topotag";
        case Marker::Kind::chessboard:
            return "chessboard";
        case Marker::Kind::stag:
            return "stag";
        case Marker::Kind::charuco:
        case Marker::Kind::aprilgrid:
        case Marker::Kind::circles:
        case Marker::Kind::acircles:
            throw ConfigError({place}, marker.spec +
                                           " is a target for `etalon calibrate --target`; poses "
                                           "are found from single tags and chessboards");
        case Marker::Kind::bitmap:
            break;
    }
    throw ConfigError({place}, "no detector finds " + marker.spec + ": give its poses");
}

}  // namespace

std::optional<DetectedCorners> Detector::failed(const std::string& why) {
    failure_ = why;
    return std::nullopt;
}

std::optional<DetectedCorners> Detector::not_found() {
    return failed("marker not found");
}

std::optional<DetectedCorners> Detector::only_one(const std::vector<DetectedCorners>& found) {
    if (found.empty())
        return not_found();
    if (found.size() > 1)
        return failed(fmt::format("marker {} is seen {} times", found[0].id, found.size()));
    failure_.clear();
    return found[0];
}

std::unique_ptr<Detector> make_detector(const std::string& name, const Marker& marker,
                                        const std::string& place) {
    static const std::vector<std::string> names = {"apriltag",      "aruco",          "aruco-none",
                                                   "aruco-contour", "aruco-apriltag", "topotag",
                                                   "chessboard",    "stag",           "auto"};
    const std::string chosen = name == "auto" ? detector_of(marker, place) : name;
    if (chosen == "apriltag")
        return make_apriltag_detector(marker, place);
    if (chosen == "aruco")
        return make_aruco_detector(marker, ArucoRefinement::subpixel, place);
    if (chosen == "aruco-none")
        return make_aruco_detector(marker, ArucoRefinement::none, place);
    if (chosen == "aruco-contour")
        return make_aruco_detector(marker, ArucoRefinement::contour, place);
    if (chosen == "aruco-apriltag")
        return make_aruco_detector(marker, ArucoRefinement::apriltag, place);
    if (chosen == "topotag")
        return make_topotag_detector(marker, place);
    if (chosen == "chessboard")
        return make_chessboard_detector(marker, place);
    if (chosen == "stag")
        return make_stag_detector(marker, place);
    const std::string nearest = nearest_word(name, names);
    throw ConfigError({place}, fmt::format("there is no detector '{}'{}", name,
                                           nearest.empty() ? "" : "; is it " + nearest + "?"));
}

cv::Mat as_8_bit(const CodeImage& image) {
    if (image.bits == 8 && image.pixels.type() == CV_8UC1)
        return image.pixels;
    cv::Mat scaled;
    image.pixels.convertTo(scaled, CV_8U, 255.0 / image.full_scale());
    return scaled;
}

}  // namespace etalon
