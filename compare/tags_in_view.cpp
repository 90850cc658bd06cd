#include "compare/tags_in_view.h"

#include <fmt/format.h>

#include "compare/detect/apriltag/apriltag_finder.h"
#include "compare/detect/detector_adaptors.h"
#include "compare/detect/found_tag.h"

namespace etalon {
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
