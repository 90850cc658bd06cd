#include "station/compare/photo_comparer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "core/program/errors.h"
#include "station/compare/comparison_pictures.h"

namespace etalon {
namespace {

void add_scored(const PhotoFit& fit, const Projector& projector, const Rigid& camera_from_marker,
                ResidualProfile& radius, ResidualProfile& depth) {
    const cv::Mat& use = fit.use;
    const cv::Rect box = cv::boundingRect(use);
    const PlaneSight sight(projector, camera_from_marker, box);
    const Eigen::Vector2d centre(0.5 * (use.cols - 1), 0.5 * (use.rows - 1));
    for (int y = box.y; y < box.br().y; ++y)
        for (int x = box.x; x < box.br().x; ++x) {
            if (use.at<uchar>(y, x) != pixel_scored)
                continue;
            const double residual = fit.residual.at<float>(y, x);
            radius.add((Eigen::Vector2d(x, y) - centre).norm(), residual);
            if (const auto met = sight.at(x, y))
                depth.add(met->z(), residual);
        }
}

ComparedFit without_images(const PhotoFit& matched) {
    ComparedFit fit;
    fit.camera_from_marker = matched.state.camera_from_marker;
    fit.model = matched.state.photometry;
    fit.fitted = matched.fitted;
    fit.scored = matched.scored;
    fit.noise_source = matched.noise_source;
    fit.noise_gray = matched.noise_gray;
    fit.parameters = matched.parameters;
    return fit;
}

void add_edges(const CodeImage& image, const CellGrid& marker, const PhotometricCamera& camera,
               const PhotoFit& matched, ComparedFit& fit) {
    const PhotoOfMarker photo{gray_of(image), marker, matched.use, pixel_fitted};
    fit.edges = edge_shifts(photo, camera, matched.state).edges;
    fit.edge_summary = edge_summary(edges_of(fit.edges, pixel_scored));
}

// Sharp edges and blurred ones alike: the widest blur decides how far beside an edge is looked.
DefocusProfile defocus_of(const CodeImage& image, const Marker& marker, const ComparedArea& area,
                          const PhotometricCamera& camera, const ComparedFit& fit) {
    const RenderedImage rendering =
        camera.renderer().render({{{marker.grid, fit.camera_from_marker}}, 1.0});
    EdgeSelection selection;
    const double beside = selection.half_width_px - selection.clearance_px;
    selection.clearance_px =
        std::max(selection.clearance_px, 1.5 + rendering.plan.max_blur_radius_px);
    selection.half_width_px = selection.clearance_px + beside;
    return defocus_profile(image, rendering.radiance, camera.projector(), marker,
                           fit.camera_from_marker, area, fit.edges, selection);
}

ResidualProfiles profiles_of(const CameraModel& camera, std::pair<double, double> depths_mm) {
    constexpr int steps = 12;
    const double corner = 0.5 * std::hypot(camera.width - 1, camera.height - 1);
    const ResidualProfile radius(0.0, corner, steps);
    const ResidualProfile depth(depths_mm.first, depths_mm.second, steps);
    return {radius, radius, depth, depth};
}

}  // namespace

PhotoComparer::PhotoComparer(const Marker& marker, const ComparedArea& area,
                             const CameraModel& camera, std::pair<double, double> depth_range_mm)
    : marker_(marker),
      area_(area),
      camera_(std::make_shared<const PhotometricCamera>(camera)),
      empty_profiles_(profiles_of(camera, depth_range_mm)) {}

void PhotoComparer::match(const CodeImage& image, const std::filesystem::path& folder,
                          std::size_t number, ComparedPhoto& photo,
                          ResidualProfiles& profiles) const {
    const Projector& projector = camera_->projector();
    photo.findings = examine_marker(image, marker_, area_, projector, photo.under_test);
    if (is_refused(photo.findings)) {
        photo.pictures = pictures_of_photo(image, photo.photo);
        return;
    }
    const PhotoMatch match = match_photo(image, marker_.grid, area_, camera_, photo.under_test);
    photo.calibrated = without_images(match.calibrated);
    photo.refined = without_images(match.refined);
    photo.photometric = match.pose;
    add_edges(image, marker_.grid, *camera_, match.calibrated, *photo.calibrated);
    add_edges(image, marker_.grid, *camera_, match.refined, *photo.refined);
    if (camera_->model().lens)
        photo.defocus = defocus_of(image, marker_, area_, *camera_, *photo.refined);
    photo.findings = examine_match(image, marker_, area_, *camera_, match);
    photo.pictures = make_pictures(folder, number, photo.photo, match.calibrated, &match.refined);
    add_scored(match.calibrated, projector, photo.under_test, profiles.radius, profiles.depth);
    add_scored(match.refined, projector, match.refined.state.camera_from_marker,
               profiles.refined_radius, profiles.refined_depth);
}

ResidualProfiles PhotoComparer::compare(const CodeImage& image, const std::filesystem::path& folder,
                                        std::size_t number, ComparedPhoto& photo) const {
    ResidualProfiles profiles = empty_profiles_;
    const auto matched = attempted([&] { match(image, folder, number, photo, profiles); });
    if (!matched)
        photo.failure = matched.cause;
    if (photo.has_figures())
        return profiles;
    // The pictures may show why; numbers would only be taken for some.
    photo.calibrated = photo.refined = std::nullopt;
    photo.photometric = std::nullopt;
    photo.defocus = std::nullopt;
    return empty_profiles_;
}

std::string PhotoComparer::rendering(const Rigid& camera_from_marker) const {
    return camera_->renderer().render({{{marker_.grid, camera_from_marker}}, 1.0}).plan.describe();
}

std::pair<double, double> depth_range(const std::vector<ComparedPhoto>& photos,
                                      const ComparedArea& area) {
    double low = std::numeric_limits<double>::infinity(), high = 0.0;
    for (const ComparedPhoto& photo : photos)
        for (const double x : {area.low_mm.x(), area.high_mm.x()})
            for (const double y : {area.low_mm.y(), area.high_mm.y()}) {
                if (!photo.failure.empty())
                    continue;
                const double z = (photo.under_test * Eigen::Vector3d(x, y, 0)).z();
                low = std::min(low, z);
                high = std::max(high, z);
            }
    return low <= high ? std::pair(low, high) : std::pair(0.0, 1.0);
}

}  // namespace etalon
