// OpenCV's ArUco. Up to OpenCV 4.6 it is a contrib module with free functions, from 4.7 on a class
// in objdetect: the difference ends here.
#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "compare/detect/detector_adaptors.h"
#include "core/program/errors.h"
#include "sim/marker/tag_pattern.h"

#if __has_include(<opencv2/objdetect/aruco_detector.hpp>)
#include <opencv2/objdetect/aruco_detector.hpp>
#define ETALON_ARUCO_IN_OBJDETECT 1
#else
#include <opencv2/aruco.hpp>
#define ETALON_ARUCO_IN_OBJDETECT 0
#endif

namespace etalon {
namespace {

using Quad = std::vector<cv::Point2f>;

// Sub-pixel refinement is done here and not by the library: from 4.8 on it would change its window
// with the marker's size, and results would depend on OpenCV's version.
struct Refinement {
    const char* detector;
    int of_library;
    // Taken off the coordinates: the AprilTag quads count from the first pixel's corner, the others
    // from its centre, as we do.
    double offset_px;
};

// In the order of ArucoRefinement.
constexpr Refinement refinements[] = {
    {"aruco-none", cv::aruco::CORNER_REFINE_NONE, 0.0},
    {"aruco", cv::aruco::CORNER_REFINE_NONE, 0.0},
    {"aruco-contour", cv::aruco::CORNER_REFINE_CONTOUR, 0.0},
    {"aruco-apriltag", cv::aruco::CORNER_REFINE_APRILTAG, 0.5},
};

const Refinement& details(ArucoRefinement refinement) {
    return refinements[static_cast<std::size_t>(refinement)];
}

// The position in the list is OpenCV's number.
int dictionary_number(const std::string& name) {
    const auto& names = aruco_dictionaries();
    const auto found = std::ranges::find(names, name);
    if (found == names.end())
        throw ConfigError({}, "OpenCV has no ArUco dictionary '" + name + "'");
    return static_cast<int>(found - names.begin());
}

void find_markers(const cv::Mat& image, int dictionary, int refinement, std::vector<Quad>& quads,
                  std::vector<int>& ids) {
    const auto known = cv::aruco::getPredefinedDictionary(dictionary);
#if ETALON_ARUCO_IN_OBJDETECT
    cv::aruco::DetectorParameters parameters;
    parameters.cornerRefinementMethod = refinement;
    cv::aruco::ArucoDetector(known, parameters).detectMarkers(image, quads, ids);
#else
    const auto parameters = cv::aruco::DetectorParameters::create();
    parameters->cornerRefinementMethod = refinement;
    cv::aruco::detectMarkers(image, known, quads, ids, parameters);
#endif
}

void refine_to_subpixels(const cv::Mat& image, int half_window_px, DetectedCorners& tag) {
    const cv::TermCriteria stop(cv::TermCriteria::EPS + cv::TermCriteria::MAX_ITER, 100, 1e-3);
    Quad corners;
    for (const Eigen::Vector2d& corner : tag.pixels)
        corners.emplace_back(static_cast<float>(corner.x()), static_cast<float>(corner.y()));
    cv::cornerSubPix(image, corners, {half_window_px, half_window_px}, {-1, -1}, stop);
    for (std::size_t i = 0; i < corners.size(); ++i)
        tag.pixels[i] = {corners[i].x, corners[i].y};
}

int checked_half_window(const ArucoOptions& options, const std::string& place) {
    // Windows wider than 7x7 px reach the code's cells on small tags.
    constexpr int usual_px = 3, max_px = 30;
    const SourcePlace key{place, 0, "subpixel_half_window_px"};
    const int half_px = options.subpixel_half_window_px.value_or(usual_px);
    if (options.subpixel_half_window_px && options.refinement != ArucoRefinement::subpixel)
        throw ConfigError(key, fmt::format("belongs to the detector 'aruco', and this is '{}'",
                                           details(options.refinement).detector));
    if (half_px < 1 || half_px > max_px)
        throw ConfigError(key, fmt::format("{} is not in 1 to {} px", half_px, max_px));
    return half_px;
}

}  // namespace

std::vector<DetectedCorners> find_aruco_tags(const cv::Mat& image, const std::string& dictionary,
                                             ArucoRefinement refinement) {
    constexpr int min_tag = 8;  // px
    const auto [detector, of_library, offset_px] = details(refinement);
    const int number = dictionary_number(dictionary);
    if (image.cols < min_tag || image.rows < min_tag)
        return {};
    std::vector<Quad> quads;
    std::vector<int> ids;
    find_markers(image, number, of_library, quads, ids);
    std::vector<DetectedCorners> tags;
    for (std::size_t i = 0; i < ids.size(); ++i) {
        DetectedCorners& tag = tags.emplace_back(DetectedCorners{ids[i], {}});
        for (const cv::Point2f& corner : quads[i])  // in our order already
            tag.pixels.emplace_back(corner.x - offset_px, corner.y - offset_px);
    }
    return tags;
}

std::unique_ptr<Detector> make_aruco_detector(const Marker& marker, const std::string& place,
                                              const ArucoOptions& options) {
    if (marker.kind != Marker::Kind::aruco)
        throw ConfigError({place}, "the ArUco detector cannot see " + marker.spec);
    const ArucoRefinement refinement = options.refinement;
    const bool is_subpixel = refinement == ArucoRefinement::subpixel;
    const auto detect = [=, id = marker.id, dictionary = marker.family,
                         half_window_px = checked_half_window(options, place)](
                            const CodeImage& image) -> Detection {
        const cv::Mat pixels = as_8_bit(image);
        // cv::cornerSubPix throws for smaller images.
        if (is_subpixel && std::min(pixels.cols, pixels.rows) < 2 * half_window_px + 5)
            return only_one(id, {});
        auto found = find_aruco_tags(pixels, dictionary, refinement);
        for (DetectedCorners& tag : found)
            if (is_subpixel && tag.id == id)
                refine_to_subpixels(pixels, half_window_px, tag);
        return only_one(id, found);
    };
    return std::make_unique<Detector>(details(refinement).detector, detect,
                                      details(refinement).offset_px);
}

}  // namespace etalon
