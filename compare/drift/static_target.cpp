#include "compare/drift/static_target.h"

#include "compare/detect/board/calibration_target.h"
#include "compare/make_detector.h"

namespace etalon {
namespace {

TargetPoints by_id(const std::vector<Eigen::Vector2d>& pixels, const std::vector<int>& ids) {
    TargetPoints points;
    for (std::size_t i = 0; i < pixels.size(); ++i)
        points[ids.empty() ? static_cast<int>(i) : ids[i]] = pixels[i];
    return points;
}

TargetFinder tag_finder(const Marker& tag, const std::string& place) {
    const std::shared_ptr<Detector> detector = make_detector("auto", tag, place);
    return [detector](const CodeImage& image) {
        const auto found = detector->detect(image).corners;
        return found ? by_id(found->pixels, found->points) : TargetPoints{};
    };
}

}  // namespace

TargetFinder make_target_finder(const std::string& spec, const std::string& place) {
    const Marker marker = parse_marker(spec, place);
    if (marker.kind == Marker::Kind::apriltag || marker.kind == Marker::Kind::aruco ||
        marker.kind == Marker::Kind::stag || marker.kind == Marker::Kind::topotag)
        return tag_finder(marker, place);
    return [target = parse_calibration_target(spec, place)](const CodeImage& image) {
        const auto view = observe(target, image).view;
        return view ? by_id(view->pixels, view->ids) : TargetPoints{};
    };
}

}  // namespace etalon
