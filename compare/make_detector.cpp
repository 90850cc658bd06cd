#include "compare/make_detector.h"

#include <fmt/format.h>

#include <algorithm>

#include "compare/detect/detector_adaptors.h"
#include "compare/detect/stag/stag_detector.h"
#include "compare/detect/topotag/topotag_detector.h"
#include "core/file/text.h"

namespace etalon {
namespace {

struct Known {
    const char* name;
    Marker::Kind kind;  // of the markers that it finds
    ArucoRefinement refinement = {};
};

// The first of a kind is the one that "auto" takes.
constexpr Known detectors[] = {
    {"apriltag", Marker::Kind::apriltag},
    {"aruco", Marker::Kind::aruco, ArucoRefinement::subpixel},
    {"aruco-none", Marker::Kind::aruco, ArucoRefinement::none},
    {"aruco-contour", Marker::Kind::aruco, ArucoRefinement::contour},
    {"aruco-apriltag", Marker::Kind::aruco, ArucoRefinement::apriltag},
    {"topotag", Marker::Kind::topotag},
    {"chessboard", Marker::Kind::chessboard},
    {"charuco", Marker::Kind::charuco},
    {"aprilgrid", Marker::Kind::aprilgrid},
    {"circles", Marker::Kind::circles},
    {"circles", Marker::Kind::acircles},
    {"circles", Marker::Kind::hexcircles},
    {"squares", Marker::Kind::squares},
    {"stag", Marker::Kind::stag},
};

}  // namespace

std::unique_ptr<Detector> make_detector(const std::string& name, const Marker& marker,
                                        const std::string& place) {
    const auto* known = std::ranges::find_if(detectors, [&](const Known& one) {
        return one.kind == marker.kind && (name == "auto" || name == one.name);
    });
    if (known == std::end(detectors) && name == "auto")
        throw ConfigError({place}, "no detector finds " + marker.spec + ": give its poses");
    if (known == std::end(detectors) && std::ranges::count(detector_names(), name) == 0) {
        const std::string nearest = nearest_word(name, detector_names());
        throw ConfigError({place}, fmt::format("there is no detector '{}'{}", name,
                                               nearest.empty() ? "" : "; is it " + nearest + "?"));
    }
    if (known == std::end(detectors))
        throw ConfigError({place}, fmt::format("the {} detector cannot see {}", name, marker.spec));
    switch (marker.kind) {
        case Marker::Kind::apriltag:
            return make_apriltag_detector(marker, place);
        case Marker::Kind::aruco:
            return make_aruco_detector(marker, place, {known->refinement});
        case Marker::Kind::topotag:
            return make_topotag_detector(marker);
        case Marker::Kind::chessboard:
            return make_chessboard_detector(marker);
        case Marker::Kind::stag:
            return make_stag_detector(marker);
        default:
            return make_board_detector(known->name, marker, place);
    }
}

std::vector<std::string> detector_names() {
    std::vector<std::string> names = {"auto"};
    for (const Known& one : detectors)
        if (std::ranges::count(names, one.name) == 0)
            names.emplace_back(one.name);
    return names;
}

namespace {

// Of dictionaries that hold each other the smallest first.
constexpr const char* dictionaries[] = {
    "APRILTAG_36h11", "APRILTAG_36h10", "7X7_50",  "7X7_100", "7X7_250",
    "7X7_1000",       "6X6_50",         "6X6_100", "6X6_250", "6X6_1000",
    "APRILTAG_25h9",  "5X5_50",         "5X5_100", "5X5_250", "5X5_1000",
    "ARUCO_ORIGINAL", "4X4_50",         "4X4_100", "4X4_250", "4X4_1000",
    "APRILTAG_16h5"};

std::vector<std::string> names(const std::string& kind, const std::string& family,
                               const std::vector<DetectedCorners>& tags) {
    std::vector<std::string> all;
    for (const DetectedCorners& tag : tags)
        all.push_back(fmt::format("{}:{}:{}", kind, family, tag.id));
    return all;
}

std::vector<std::string> in_dictionary(const cv::Mat& pixels, const std::string& dictionary) {
    constexpr std::string_view of_apriltag = "APRILTAG_";
    const auto tags = find_aruco_tags(pixels, dictionary, ArucoRefinement::none);
    return dictionary.starts_with(of_apriltag)
               ? names("apriltag", dictionary.substr(of_apriltag.size()), tags)
               : names("aruco", dictionary, tags);
}

}  // namespace

std::vector<std::string> tags_in_view(const CodeImage& photo, const Marker& wanted) {
    const cv::Mat pixels = as_8_bit(photo);
    std::vector<std::string> seen;
    if (wanted.kind == Marker::Kind::apriltag)
        seen = names("apriltag", wanted.family, ApriltagFinder(wanted.family).find(pixels));
    else if (wanted.kind == Marker::Kind::aruco)
        seen = in_dictionary(pixels, wanted.family);
    for (const char* dictionary : dictionaries)
        if (seen.empty())
            seen = in_dictionary(pixels, dictionary);
    return seen;
}

}  // namespace etalon
