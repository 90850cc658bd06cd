// OpenCV's ArUco behind the Detector interface.
#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>

#include "compare/detect/detector_adaptors.h"
#include "core/program/errors.h"

#if __has_include(<opencv2/objdetect/aruco_detector.hpp>)
#include <opencv2/objdetect/aruco_detector.hpp>
#define ETALON_ARUCO_IN_OBJDETECT 1
#else
#include <opencv2/aruco.hpp>
#define ETALON_ARUCO_IN_OBJDETECT 0
#endif

#include <algorithm>

#include "compare/detect/detector_adaptors.h"
#include "core/program/errors.h"
#include "sim/marker/tag_pattern.h"

namespace etalon {

// OpenCV's ArUco. Up to OpenCV 4.6 it is a contrib module with free functions, from 4.7 on a class
// in objdetect: the difference ends here.

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

namespace {

// A window of 7x7 px around each corner. Wider ones reach the code's cells on small tags: with a
// side of 60 px and 6 cells across, 10 px are left.
constexpr int default_half_window_px = 3;

void refine_to_subpixels(const cv::Mat& image, int half_window_px, FoundTag& tag) {
    const cv::TermCriteria stop(cv::TermCriteria::EPS + cv::TermCriteria::MAX_ITER, 100, 1e-3);
    std::vector<cv::Point2f> corners;
    for (const Eigen::Vector2d& corner : tag.corners)
        corners.emplace_back(static_cast<float>(corner.x()), static_cast<float>(corner.y()));
    cv::cornerSubPix(image, corners, {half_window_px, half_window_px}, {-1, -1}, stop);
    for (std::size_t i = 0; i < corners.size(); ++i)
        tag.corners[i] = {corners[i].x, corners[i].y};
}

std::string name_of(ArucoRefinement refinement) {
    switch (refinement) {
        case ArucoRefinement::none:
            return "aruco-none";
        case ArucoRefinement::contour:
            return "aruco-contour";
        case ArucoRefinement::apriltag:
            return "aruco-apriltag";
        case ArucoRefinement::subpixel:
            break;
    }
    return "aruco";
}

class ArucoDetector final : public Detector {
public:
    ArucoDetector(const Marker& marker, ArucoRefinement refinement, int half_window_px)
        : Detector(name_of(refinement), library_offset_px_of(refinement)),
          id_(marker.id),
          dictionary_(marker.family),
          refinement_(refinement),
          half_window_px_(half_window_px) {}

    Detection detect(const CodeImage& image) override {
        const cv::Mat pixels = as_8_bit(image);
        if (refinement_ == ArucoRefinement::subpixel && !holds_window(pixels))
            return only_one({});
        std::vector<DetectedCorners> own;
        for (FoundTag& tag : find_aruco_tags(pixels, dictionary_, refinement_)) {
            if (tag.id != id_)
                continue;
            if (refinement_ == ArucoRefinement::subpixel)
                refine_to_subpixels(pixels, half_window_px_, tag);
            own.push_back({id_, {tag.corners.begin(), tag.corners.end()}});
        }
        return only_one(own);
    }

private:
    // cv::cornerSubPix throws for smaller images.
    bool holds_window(const cv::Mat& pixels) const {
        return std::min(pixels.cols, pixels.rows) >= 2 * half_window_px_ + 5;
    }

    int id_;
    std::string dictionary_;
    ArucoRefinement refinement_;
    int half_window_px_;
};

int checked_half_window(const ArucoOptions& options, const std::string& place) {
    constexpr int max_px = 30;
    const SourcePlace key{place, 0, "subpixel_half_window_px"};
    const int half_px = options.subpixel_half_window_px.value_or(default_half_window_px);
    if (options.subpixel_half_window_px && options.refinement != ArucoRefinement::subpixel)
        throw ConfigError(key, "belongs to the detector 'aruco', and this is '" +
                                   name_of(options.refinement) + "'");
    if (half_px < 1 || half_px > max_px)
        throw ConfigError(key, fmt::format("{} is not in 1 to {} px", half_px, max_px));
    return half_px;
}

}  // namespace

std::unique_ptr<Detector> make_aruco_detector(const Marker& marker, const std::string& place,
                                              const ArucoOptions& options) {
    if (marker.kind != Marker::Kind::aruco)
        throw ConfigError({place}, "the ArUco detector cannot see " + marker.spec);
    return std::make_unique<ArucoDetector>(marker, options.refinement,
                                           checked_half_window(options, place));
}

}  // namespace etalon
