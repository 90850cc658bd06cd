#include "compare/photometric/photometric_refinement.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <opencv2/core.hpp>

#include "compare/photometric/photometric_pose.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

using Indices = std::vector<std::size_t>;

// What is compared: all that stays the same for every fold.
struct Job {
    std::vector<cv::Mat> gray;
    std::span<const CalibrationView> views;
    const CellGrid& target;
    const ComparedArea& area;
    const CalibrationModel& model;
    cv::Size size;
};

// A camera from the corners of some photographs only, the poses in the same order.
CameraFit corner_fit(const Job& job, const Indices& photos, const CameraFit& all) {
    std::vector<CalibrationView> views;
    CameraStart start{all.camera, {}};
    for (const std::size_t i : photos) {
        views.push_back(job.views[i]);
        start.camera_from_target.push_back(all.camera_from_target[i]);
    }
    return fit_camera(views, job.size, job.model, {.start = start});
}

PhotoOfMarker photo_of(const Job& job, std::size_t photo, const cv::Mat& use, uchar fitted) {
    return {job.gray[photo], job.target, use, fitted, 1.0};
}

// Both halves of the squares train.
PhotoOfMarker training_photo(const Job& job, std::size_t photo, const PhotometricCamera& camera,
                             const Rigid& pose) {
    const cv::Mat use = pixel_uses(camera.projector(), pose, job.area) != pixel_outside;
    return photo_of(job, photo, use, 255);
}

PhotometricAdjustment refined_on_all(const Job& job, const CameraFit& corners) {
    const auto camera = std::make_shared<const PhotometricCamera>(corners.camera);
    const PhotometricTerms terms = refinement_terms(corners.camera);
    std::vector<PhotoOfMarker> photos;
    std::vector<PhotoState> start;
    for (std::size_t i = 0; i < job.gray.size(); ++i) {
        const Rigid& pose = corners.camera_from_target[i];
        photos.push_back(training_photo(job, i, *camera, pose));
        start.push_back(starting_state(photos.back(), *camera, pose, terms));
    }
    return adjust_to_photos(photos, camera, start, terms, job.model);
}

// From the corners' camera of the training photographs alone; the photometric models start where
// they were with all photographs, which saves time and decides nothing.
std::shared_ptr<const PhotometricCamera> refined_on(
    const Job& job, const Indices& training, const CameraFit& corners,
    const std::shared_ptr<const PhotometricCamera>& camera, const PhotometricAdjustment& all) {
    std::vector<PhotoOfMarker> photos;
    std::vector<PhotoState> start;
    for (std::size_t i = 0; i < training.size(); ++i) {
        const Rigid& pose = corners.camera_from_target[i];
        photos.push_back(training_photo(job, training[i], *camera, pose));
        start.push_back({pose, all.photos[training[i]].photometry});
    }
    return adjust_to_photos(photos, camera, start, refinement_terms(camera->model()), job.model)
        .camera;
}

// RMS residual on the squares that neither pose nor photometric model were fitted to.
double held_out_rms(const Job& job, std::size_t photo,
                    const std::shared_ptr<const PhotometricCamera>& camera,
                    const PhotometricModel& photometry) {
    const Rigid start = fit_view_pose(camera->model(), job.views[photo]);
    const cv::Mat use = pixel_uses(camera->projector(), start, job.area);
    const PhotometricPose pose =
        photometric_pose(photo_of(job, photo, use, pixel_fitted), camera, {start, photometry},
                         refinement_terms(camera->model()));
    return residual_rms_gray(photo_of(job, photo, use, pixel_scored), *camera,
                             {pose.camera_from_marker, pose.photometry});
}

void validate_fold(const Job& job, const CameraFit& corners, const PhotometricAdjustment& all,
                   std::size_t fold, std::vector<RefinedPhoto>& photos) {
    Indices training, held_out;
    for (std::size_t i = 0; i < photos.size(); ++i)
        (i % refinement_folds == fold ? held_out : training).push_back(i);
    const CameraFit without = corner_fit(job, training, corners);
    const auto from_corners = std::make_shared<const PhotometricCamera>(without.camera);
    const auto from_pixels = refined_on(job, training, without, from_corners, all);
    for (const std::size_t i : held_out) {
        const PhotometricModel& start = all.photos[i].photometry;
        photos[i].corners_rms_gray = held_out_rms(job, i, from_corners, start);
        photos[i].refined_rms_gray = held_out_rms(job, i, from_pixels, start);
    }
}

// The paired comparison.
void judge(PhotometricRefinement& result) {
    const double n = static_cast<double>(result.photos.size());
    double squares = 0.0;
    for (const RefinedPhoto& photo : result.photos) {
        result.corners_rms_gray += photo.corners_rms_gray / n;
        result.refined_rms_gray += photo.refined_rms_gray / n;
    }
    result.gain_gray = result.corners_rms_gray - result.refined_rms_gray;
    for (const RefinedPhoto& photo : result.photos) {
        const double gain = photo.corners_rms_gray - photo.refined_rms_gray;
        squares += (gain - result.gain_gray) * (gain - result.gain_gray);
    }
    result.gain_error_gray = std::sqrt(squares / (n - 1.0) / n);
    const double quantile = student_t_quantile(0.05, static_cast<int>(result.photos.size()) - 1);
    result.least_gain_gray = result.gain_gray - quantile * result.gain_error_gray;
    result.accepted = result.least_gain_gray > 0.0;
}

void state_covariance(const PhotometricAdjustment& fit, const CalibrationModel& model,
                      PhotometricRefinement& result) {
    std::vector<ViewEquations> equations;
    double squares = 0.0, freedom = -static_cast<double>(model.parameters.size());
    for (const PhotoEquations& photo : fit.equations) {
        equations.push_back(camera_equations(photo, model.parameters.size()));
        squares += photo.squares;
        freedom += photo.pixels - static_cast<double>(photo.score.size()) +
                   static_cast<double>(model.parameters.size());
    }
    const Eigen::MatrixXd formal = formal_covariance(equations, model, squares / freedom),
                          robust = cluster_robust_covariance(equations, model),
                          stated = stated_covariance(equations, model, squares / freedom);
    for (Eigen::Index i = 0; i < formal.rows(); ++i)
        result.deviations.push_back({model.parameters[static_cast<std::size_t>(i)],
                                     std::sqrt(formal(i, i)),
                                     std::sqrt(robust(i, i)),
                                     {},
                                     std::sqrt(stated(i, i))});
    result.camera.covariance = ParameterCovariance{model.parameters, stated};
}

void require_usable(std::span<const CodeImage> photos, std::span<const CalibrationView> views,
                    const CameraFit& corners) {
    if (photos.size() != views.size() || corners.camera_from_target.size() != views.size())
        throw NumericalError(fmt::format("{} photographs, {} views and {} poses do not match",
                                         photos.size(), views.size(),
                                         corners.camera_from_target.size()));
    if (photos.size() < min_refinement_photos)
        throw NumericalError(fmt::format("photometric refinement needs {} photographs, not {}",
                                         min_refinement_photos, photos.size()));
}

}  // namespace

PhotometricTerms refinement_terms(const CameraModel& camera) {
    return {.level_terms = 6, .psf = !camera.lens, .tone = true};
}

PhotometricRefinement refine_photometrically(std::span<const CodeImage> photos,
                                             std::span<const CalibrationView> views,
                                             const CellGrid& target, const ComparedArea& area,
                                             const CameraFit& corners,
                                             const CalibrationModel& model) {
    require_usable(photos, views, corners);
    Job job{{}, views, target, area, model, {corners.camera.width, corners.camera.height}};
    for (const CodeImage& photo : photos)
        job.gray.push_back(gray_of(photo));

    const PhotometricAdjustment fit = refined_on_all(job, corners);
    PhotometricRefinement result;
    result.camera = fit.camera->model();
    result.folds = refinement_folds;
    for (const PhotoState& state : fit.photos)
        result.photos.push_back({0.0, 0.0, state.camera_from_marker});
    state_covariance(fit, model, result);
    for (std::size_t fold = 0; fold < refinement_folds; ++fold)
        validate_fold(job, corners, fit, fold, result.photos);
    judge(result);
    return result;
}

std::string PhotometricRefinement::in_words() const {
    return fmt::format(
        "held-out residual {:.3f} -> {:.3f} gray over {} photos, gain {:.3f} +- {:.3f}, at 95 % at "
        "least {:.3f}: {}",
        corners_rms_gray, refined_rms_gray, photos.size(), gain_gray, gain_error_gray,
        least_gain_gray, accepted ? "accepted" : "refused");
}

}  // namespace etalon
