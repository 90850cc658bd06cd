// OpenCV's ArUco behind the Detector interface. Up to OpenCV 4.6 it is a contrib module with free
// functions, from 4.7 on a class in objdetect: the difference ends at find_markers().
#if __has_include(<opencv2/objdetect/aruco_detector.hpp>)
#include <opencv2/objdetect/aruco_detector.hpp>
#define ETALON_ARUCO_IN_OBJDETECT 1
#else
#include <opencv2/aruco.hpp>
#define ETALON_ARUCO_IN_OBJDETECT 0
#endif
#include <opencv2/imgproc.hpp>

#include "compare/detector_adaptors.h"
#include "core/errors.h"

namespace etalon {
namespace {

using Quad = std::vector<cv::Point2f>;

struct DictionaryName {
    const char* name;
    int value;
};

constexpr DictionaryName dictionaries[] = {
    {"4X4_50", cv::aruco::DICT_4X4_50},
    {"4X4_100", cv::aruco::DICT_4X4_100},
    {"4X4_250", cv::aruco::DICT_4X4_250},
    {"4X4_1000", cv::aruco::DICT_4X4_1000},
    {"5X5_50", cv::aruco::DICT_5X5_50},
    {"5X5_100", cv::aruco::DICT_5X5_100},
    {"5X5_250", cv::aruco::DICT_5X5_250},
    {"5X5_1000", cv::aruco::DICT_5X5_1000},
    {"6X6_50", cv::aruco::DICT_6X6_50},
    {"6X6_100", cv::aruco::DICT_6X6_100},
    {"6X6_250", cv::aruco::DICT_6X6_250},
    {"6X6_1000", cv::aruco::DICT_6X6_1000},
    {"7X7_50", cv::aruco::DICT_7X7_50},
    {"7X7_100", cv::aruco::DICT_7X7_100},
    {"7X7_250", cv::aruco::DICT_7X7_250},
    {"7X7_1000", cv::aruco::DICT_7X7_1000},
    {"ARUCO_ORIGINAL", cv::aruco::DICT_ARUCO_ORIGINAL},
    {"APRILTAG_16h5", cv::aruco::DICT_APRILTAG_16h5},
    {"APRILTAG_25h9", cv::aruco::DICT_APRILTAG_25h9},
    {"APRILTAG_36h10", cv::aruco::DICT_APRILTAG_36h10},
    {"APRILTAG_36h11", cv::aruco::DICT_APRILTAG_36h11},
};

int dictionary_value(const std::string& family, const std::string& place) {
    for (const DictionaryName& dictionary : dictionaries)
        if (family == dictionary.name)
            return dictionary.value;
    throw ConfigError({place}, "OpenCV has no ArUco dictionary '" + family + "'");
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

// A window of 7x7 px around each corner. Wider ones reach the code's cells on small tags: with a
// side of 60 px and 6 cells across, 10 px are left.
void refine_to_subpixels(const cv::Mat& image, Quad& quad) {
    constexpr int half_window_px = 3;
    const cv::TermCriteria stop(cv::TermCriteria::EPS + cv::TermCriteria::MAX_ITER, 100, 1e-3);
    cv::cornerSubPix(image, quad, {half_window_px, half_window_px}, {-1, -1}, stop);
}

// Contour and sub-pixel corners count from the first pixel's centre, as ours do. The AprilTag quads
// count from its corner and OpenCV hands them on unchanged. The order is ours already.
std::vector<Eigen::Vector2d> corners_in_our_convention(const Quad& quad,
                                                       ArucoRefinement refinement) {
    const double origin = refinement == ArucoRefinement::apriltag ? 0.5 : 0.0;
    std::vector<Eigen::Vector2d> corners;
    for (const cv::Point2f& corner : quad)
        corners.emplace_back(corner.x - origin, corner.y - origin);
    return corners;
}

std::string name_of(ArucoRefinement refinement) {
    switch (refinement) {
        case ArucoRefinement::none:
            return "aruco-none";
        case ArucoRefinement::contour:
            return "aruco-contour";
        case ArucoRefinement::apriltag:
            return "aruco-apriltag";
        default:
            return "aruco";
    }
}

class ArucoDetector final : public Detector {
public:
    ArucoDetector(const Marker& marker, ArucoRefinement refinement, const std::string& place)
        : name_(name_of(refinement)),
          id_(marker.id),
          dictionary_(dictionary_value(marker.family, place)),
          refinement_(refinement) {}

    const std::string& name() const override { return name_; }

    std::optional<DetectedCorners> detect(const CodeImage& image) override {
        constexpr int smallest_tag = 8;  // px
        const cv::Mat pixels = as_8_bit(image);
        if (pixels.cols < smallest_tag || pixels.rows < smallest_tag)
            return not_found();
        std::vector<Quad> quads;
        std::vector<int> ids;
        find_markers(pixels, dictionary_, library_refinement(refinement_), quads, ids);
        std::vector<DetectedCorners> own;
        for (std::size_t i = 0; i < ids.size(); ++i) {
            if (ids[i] != id_)
                continue;
            if (refinement_ == ArucoRefinement::subpixel)
                refine_to_subpixels(pixels, quads[i]);
            own.push_back({id_, corners_in_our_convention(quads[i], refinement_)});
        }
        return only_one(own);
    }

private:
    const std::string name_;
    int id_;
    int dictionary_;
    ArucoRefinement refinement_;
};

}  // namespace

std::unique_ptr<Detector> make_aruco_detector(const Marker& marker, ArucoRefinement refinement,
                                              const std::string& place) {
    if (marker.kind != Marker::Kind::aruco)
        throw ConfigError({place}, "the ArUco detector cannot see " + marker.spec);
    return std::make_unique<ArucoDetector>(marker, refinement, place);
}

}  // namespace etalon
