#include "compare/detect/detector.h"

#include <fmt/format.h>

#include <algorithm>

#include "compare/detect/detector_adaptors.h"
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
            return "charuco";
        case Marker::Kind::aprilgrid:
        case Marker::Kind::circles:
        case Marker::Kind::acircles:
            throw ConfigError({place}, marker.spec +
                                           " is a target for `etalon calibrate --target`; poses "
                                           "are found from single tags, chessboards and ChArUco "
                                           "boards");
        case Marker::Kind::bitmap:
            break;
    }
    throw ConfigError({place}, "no detector finds " + marker.spec + ": give its poses");
}

// An option that the detector does not have would change nothing, and nobody would notice.
void require_options_of(const std::string& chosen, const DetectorOptions& options,
                        const std::string& place) {
    const auto require = [&](bool is_given, const char* option, const char* owner) {
        if (is_given && chosen != owner)
            throw ConfigError(
                {place, 0, option},
                fmt::format("belongs to the detector '{}', and this is '{}'", owner, chosen));
    };
    require(options.subpixel_half_window_px.has_value(), "subpixel_half_window_px", "aruco");
    require(options.quad_decimate.has_value(), "quad_decimate", "apriltag");
    require(options.refine_edges.has_value(), "refine_edges", "apriltag");
}

}  // namespace

std::vector<Eigen::Vector3d> seen_points_mm(const Marker& marker, const DetectedCorners& corners) {
    if (corners.is_whole())
        return marker.points_mm;
    std::vector<Eigen::Vector3d> seen;
    for (const int point : corners.points)
        seen.push_back(marker.points_mm.at(static_cast<std::size_t>(point)));
    return seen;
}

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
                                        const std::string& place, const DetectorOptions& options) {
    static const std::vector<std::string> names = {
        "apriltag", "aruco",      "aruco-none", "aruco-contour", "aruco-apriltag",
        "topotag",  "chessboard", "charuco",    "stag",          "auto"};
    const std::string chosen = name == "auto" ? detector_of(marker, place) : name;
    if (std::find(names.begin(), names.end(), chosen) != names.end())
        require_options_of(chosen, options, place);
    if (chosen == "apriltag")
        return make_apriltag_detector(marker, place, options);
    if (chosen == "aruco")
        return make_aruco_detector(marker, ArucoRefinement::subpixel, place, options);
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
    if (chosen == "charuco")
        return make_charuco_detector(marker, place);
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
