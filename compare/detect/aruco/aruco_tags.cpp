// OpenCV's ArUco. Up to OpenCV 4.6 it is a contrib module with free functions, from 4.7 on a class
// in objdetect: the difference ends here.
#if __has_include(<opencv2/objdetect/aruco_detector.hpp>)
#include <opencv2/objdetect/aruco_detector.hpp>
#define ETALON_ARUCO_IN_OBJDETECT 1
#else
#include <opencv2/aruco.hpp>
#define ETALON_ARUCO_IN_OBJDETECT 0
#endif

#include <algorithm>

#include "compare/detect/found_tag.h"
#include "core/program/errors.h"
#include "sim/marker/tag_pattern.h"

namespace etalon {
namespace {

using Quad = std::vector<cv::Point2f>;

// The position in the list is OpenCV's number.
int dictionary_number(const std::string& name) {
    const auto& names = aruco_dictionaries();
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end())
        throw ConfigError({}, "OpenCV has no ArUco dictionary '" + name + "'");
    return static_cast<int>(found - names.begin());
}

// Sub-pixel refinement is done here and not by the library: from 4.8 on it would change its window
// with the marker's size, and results would depend on OpenCV's version.
int library_refinement(ArucoRefinement refinement) {
    switch (refinement) {
        case ArucoRefinement::contour:
            return cv::aruco::CORNER_REFINE_CONTOUR;
        case ArucoRefinement::apriltag:
            return cv::aruco::CORNER_REFINE_APRILTAG;
        default:
            return cv::aruco::CORNER_REFINE_NONE;
    }
}

#if ETALON_ARUCO_IN_OBJDETECT
void find_markers(const cv::Mat& image, int dictionary, int refinement, std::vector<Quad>& quads,
                  std::vector<int>& ids) {
    cv::aruco::DetectorParameters parameters;
    parameters.cornerRefinementMethod = refinement;
    const cv::aruco::ArucoDetector detector(cv::aruco::getPredefinedDictionary(dictionary),
                                            parameters);
    detector.detectMarkers(image, quads, ids);
}
#else
void find_markers(const cv::Mat& image, int dictionary, int refinement, std::vector<Quad>& quads,
                  std::vector<int>& ids) {
    const auto parameters = cv::aruco::DetectorParameters::create();
    parameters->cornerRefinementMethod = refinement;
    cv::aruco::detectMarkers(image, cv::aruco::getPredefinedDictionary(dictionary), quads, ids,
                             parameters);
}
#endif

// The order is ours already.
std::array<Eigen::Vector2d, 4> corners_in_our_convention(const Quad& quad,
                                                         ArucoRefinement refinement) {
    const double offset = library_offset_px_of(refinement);
    std::array<Eigen::Vector2d, 4> corners;
    for (std::size_t i = 0; i < corners.size(); ++i)
        corners[i] = {quad[i].x - offset, quad[i].y - offset};
    return corners;
}

}  // namespace

double library_offset_px_of(ArucoRefinement refinement) {
    return refinement == ArucoRefinement::apriltag ? 0.5 : 0.0;
}

std::vector<FoundTag> find_aruco_tags(const cv::Mat& image, const std::string& dictionary,
                                      ArucoRefinement refinement) {
    constexpr int min_tag = 8;  // px
    const int number = dictionary_number(dictionary);
    if (image.cols < min_tag || image.rows < min_tag)
        return {};
    std::vector<Quad> quads;
    std::vector<int> ids;
    find_markers(image, number, library_refinement(refinement), quads, ids);
    std::vector<FoundTag> tags;
    for (std::size_t i = 0; i < ids.size(); ++i)
        tags.push_back({ids[i], corners_in_our_convention(quads[i], refinement)});
    return tags;
}

}  // namespace etalon
