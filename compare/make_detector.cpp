#include "compare/make_detector.h"

#include <fmt/format.h>

#include <algorithm>

#include "compare/detect/apriltag/apriltag_finder.h"
#include "compare/detect/detector_adaptors.h"
#include "compare/detect/stag/stag_detector.h"
#include "compare/detect/topotag/topotag_detector.h"
#include "core/file/text.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

struct Maker {
    const char* name;
    Marker::Kind kind;  // of the markers that it finds
    std::unique_ptr<Detector> (*make)(const Marker& marker, const std::string& place);
};

std::unique_ptr<Detector> make_apriltag(const Marker& marker, const std::string& place) {
    return make_apriltag_detector(marker, place);
}

template <ArucoRefinement refinement>
std::unique_ptr<Detector> make_aruco(const Marker& marker, const std::string& place) {
    return make_aruco_detector(marker, place, {refinement});
}

// The first of a kind is the one that "auto" takes.
constexpr Maker makers[] = {
    {"apriltag", Marker::Kind::apriltag, make_apriltag},
    {"aruco", Marker::Kind::aruco, make_aruco<ArucoRefinement::subpixel>},
    {"aruco-none", Marker::Kind::aruco, make_aruco<ArucoRefinement::none>},
    {"aruco-contour", Marker::Kind::aruco, make_aruco<ArucoRefinement::contour>},
    {"aruco-apriltag", Marker::Kind::aruco, make_aruco<ArucoRefinement::apriltag>},
    {"topotag", Marker::Kind::topotag, make_topotag_detector},
    {"chessboard", Marker::Kind::chessboard, make_chessboard_detector},
    {"charuco", Marker::Kind::charuco, make_board_detector},
    {"aprilgrid", Marker::Kind::aprilgrid, make_board_detector},
    {"circles", Marker::Kind::circles, make_board_detector},
    {"circles", Marker::Kind::acircles, make_board_detector},
    {"circles", Marker::Kind::hexcircles, make_board_detector},
    {"squares", Marker::Kind::squares, make_board_detector},
    {"stag", Marker::Kind::stag, make_stag_detector},
};

[[noreturn]] void refuse(const std::string& name, const std::string& place) {
    const std::string nearest = nearest_word(name, detector_names());
    throw ConfigError({place}, fmt::format("there is no detector '{}'{}", name,
                                           nearest.empty() ? "" : "; is it " + nearest + "?"));
}

}  // namespace

std::unique_ptr<Detector> make_detector(const std::string& name, const Marker& marker,
                                        const std::string& place) {
    const bool is_auto = name == "auto";
    const auto* maker = std::ranges::find_if(makers, [&](const Maker& one) {
        return is_auto ? one.kind == marker.kind : one.name == name;
    });
    if (maker == std::end(makers) && is_auto)
        throw ConfigError({place}, "no detector finds " + marker.spec + ": give its poses");
    if (maker == std::end(makers))
        refuse(name, place);
    auto detector = maker->make(marker, place);
    if (!is_auto && detector->name() != name)
        throw ConfigError({place}, fmt::format("the {} detector cannot see {}", name, marker.spec));
    return detector;
}

std::vector<std::string> detector_names() {
    std::vector<std::string> names = {"auto"};
    for (const Maker& maker : makers)
        if (std::ranges::count(names, maker.name) == 0)
            names.emplace_back(maker.name);
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
                               const std::vector<FoundTag>& tags) {
    std::vector<std::string> all;
    for (const FoundTag& tag : tags)
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
