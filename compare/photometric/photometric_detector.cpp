#include "compare/photometric/photometric_detector.h"

#include <fmt/format.h>

#include <opencv2/imgproc.hpp>

#include "compare/photometric/photometric_equations.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// The photograph behind a Gaussian, where the marker is.
cv::Mat blurred_around(const cv::Mat& gray, const cv::Rect& region, double sigma_px) {
    cv::Mat result = gray.clone();
    blurred(gray(region), sigma_px).copyTo(result(region));
    return result;
}

// Least squares until it no longer helps.
PhotoState all_the_way(PhotometricSteps& steps, PhotoState state) {
    constexpr int max_rounds = 6;
    constexpr double no_gain = 0.97;
    double before = std::numeric_limits<double>::infinity();
    for (int round = 0; round < max_rounds; ++round) {
        const PhotoPlace place = approached(steps, state);
        state = place.state;
        const double left =
            place.noise_scale * std::sqrt(place.equations.squares / place.equations.pixels);
        if (left > no_gain * before)
            break;
        before = left;
    }
    return state;
}

// Of two images over the pixels that count.
double correlation(const cv::Mat& a, const cv::Mat& b, const cv::Mat& counted) {
    cv::Scalar mean_a, mean_b, deviation_a, deviation_b;
    cv::meanStdDev(a, mean_a, deviation_a, counted);
    cv::meanStdDev(b, mean_b, deviation_b, counted);
    const double both = cv::mean(a.mul(b), counted)[0] - mean_a[0] * mean_b[0];
    return both / (deviation_a[0] * deviation_b[0]);
}

// By how many px the rendering must be moved to correlate best with the photograph, up to `reach`
// each way. Both blurred, as the marker may be turned and scaled a little.
Eigen::Vector2d best_shift(const cv::Mat& gray, const Radiance& expected, const cv::Rect& region,
                           int reach) {
    constexpr double sigma_px = 2.0;
    const cv::Rect inner = cv::Rect(region.x + reach, region.y + reach, region.width - 2 * reach,
                                    region.height - 2 * reach);
    if (inner.width < reach || inner.height < reach)
        return {0.0, 0.0};
    cv::Mat score;
    cv::matchTemplate(blurred(gray(region), sigma_px),
                      blurred(expected, sigma_px)(inner - region.tl()), score,
                      cv::TM_CCOEFF_NORMED);
    cv::Point best;
    cv::minMaxLoc(score, nullptr, nullptr, nullptr, &best);
    return {best.x - reach, best.y - reach};
}

// The marker moved across the line of sight to its middle, so that its image moves by so much.
Rigid moved_in_image(const Projector& projector, const Rigid& camera_from_marker,
                     const CellGrid& grid, const Eigen::Vector2d& shift_px) {
    const Eigen::Vector3d middle =
        camera_from_marker * grid.point_mm(0.5 * grid.columns(), 0.5 * grid.rows());
    const auto pixel = projector.project(middle);
    const auto there = pixel ? projector.ray(*pixel + shift_px) : std::nullopt;
    if (!there)
        throw NumericalError("the start does not put the marker's middle into the image");
    Rigid moved = camera_from_marker;
    moved.translation += middle.norm() * there->normalized() - middle;
    return moved;
}

}  // namespace

PhotometricTerms detector_terms(const CameraModel& camera) {
    PhotometricTerms terms;
    terms.level_terms = 3;
    terms.psf = !camera.lens;
    terms.tone = !camera.sensor;
    return terms;
}

ComparedArea detector_area(const Marker& marker, const std::string& place) {
    ComparedArea area = compared_area(marker, {}, place);
    if (marker.kind != Marker::Kind::chessboard) {
        area.low_mm += 0.5 * area.cell_mm;
        area.high_mm -= 0.5 * area.cell_mm;
    }
    return area;
}

PhotometricDetector::PhotometricDetector(const CameraModel& camera, const Marker& marker,
                                         const std::string& place, double background)
    : camera_(std::make_shared<const PhotometricCamera>(camera)),
      grid_(marker.grid),
      area_(detector_area(marker, place)),
      background_(background) {
    require_point_of_view(camera, "the photometric pose");
}

PhotoOfMarker PhotometricDetector::photo_at(const cv::Mat& gray,
                                            const Rigid& camera_from_marker) const {
    constexpr uchar yes = 255;
    const cv::Mat use = pixel_uses(camera_->projector(), camera_from_marker, area_);
    PhotoOfMarker photo{gray, grid_, use != pixel_outside, yes, background_};
    if (cv::countNonZero(use) == 0)
        throw NumericalError("the start does not put the marker into the image");
    return photo;
}

Rigid PhotometricDetector::from_afar(const cv::Mat& gray, const Rigid& start,
                                     double start_error_px) const {
    const PhotoOfMarker at_start = photo_at(gray, start);
    const cv::Rect around = fitted_region(at_start, *camera_);
    const Radiance expected =
        camera_->at_sensor({{{grid_, start}}, at_start.background}, around, 1.0);
    const Eigen::Vector2d shift_px =
        best_shift(gray, expected, around, static_cast<int>(std::ceil(start_error_px)) + 1);
    Rigid pose = moved_in_image(camera_->projector(), start, grid_, shift_px);
    PhotometricTerms terms;
    terms.level_terms = 1;
    terms.psf = false;
    for (const double sigma_px : {max_psf_sigma_px, 0.5 * max_psf_sigma_px}) {
        PhotoOfMarker photo = photo_at(gray, pose);
        const cv::Rect region = fitted_region(photo, *camera_);
        photo.gray = blurred_around(gray, region, sigma_px);
        PhotoState state = starting_state(photo, *camera_, pose, terms);
        state.photometry.psf_sigma_px = sigma_px;
        PhotometricSteps steps(photo, *camera_, terms, state);
        pose = all_the_way(steps, state).camera_from_marker;
    }
    return pose;
}

void PhotometricDetector::require_shown(const PhotoOfMarker& photo,
                                        const Rigid& camera_from_marker) const {
    constexpr double least = 0.7;
    const cv::Rect region = fitted_region(photo, *camera_, 0);
    const Radiance expected = camera_->at_sensor({{{grid_, camera_from_marker}}, photo.background},
                                                 region, PhotometricCamera::rough_tolerance_gray);
    const double found = correlation(photo.gray(region), expected, photo.use(region));
    if (!(found >= least))
        throw NumericalError(
            fmt::format("the marker is not there: correlation of photograph and rendering {:.2f}, "
                        "of which {:.1f} is the least",
                        found, least));
}

PhotometricPose PhotometricDetector::find(const CodeImage& image, const Rigid& start,
                                          double start_error_px) const {
    constexpr double blur_width_px = 1.0;
    const cv::Mat gray = gray_of(image);
    const Rigid near =
        start_error_px > blur_width_px ? from_afar(gray, start, start_error_px) : start;
    const PhotoOfMarker photo = photo_at(gray, near);
    const PhotometricTerms terms = detector_terms(camera_->model());
    const PhotometricPose pose =
        photometric_pose(photo, camera_, starting_state(photo, *camera_, near, terms), terms);
    require_shown(photo, pose.camera_from_marker);
    return pose;
}

}  // namespace etalon
