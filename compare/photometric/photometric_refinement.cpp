#include "compare/photometric/photometric_refinement.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <numeric>

#include "compare/photometric/photometric_detector.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

PhotometricTerms refinement_terms(const CameraModel& camera) {
    return {.level_terms = 6, .psf = !camera.lens, .tone = true};
}

// Where a fit is, with a photograph's own state in its equations.
struct Place {
    std::shared_ptr<const PhotometricCamera> camera;
    std::vector<PhotoEquations> photos;

    double loss() const {
        double sum = 0.0;
        for (const PhotoEquations& photo : photos)
            sum += photo.loss();
        return sum;
    }
};

struct AdjustmentStep {
    Eigen::VectorXd camera;
    std::vector<Eigen::VectorXd> photos;
    double predicted_gain = 0.0;  // half of score . step: how much the loss should fall
};

// The equations of one photograph with damping, split at the camera's parameters, and scaled so
// that rad, mm and gray compare.
struct Damped {
    Eigen::VectorXd scale;
    Eigen::MatrixXd camera, mixed;  // mixed: own x camera
    Eigen::LLT<Eigen::MatrixXd> own;
    Eigen::VectorXd camera_score, own_score;

    Damped(const PhotoEquations& equations, Eigen::Index parameters, double damping) {
        Eigen::MatrixXd information = equations.information;
        information.diagonal() *= 1.0 + damping;
        const Eigen::Index n = information.rows() - parameters;
        scale = information.diagonal().tail(n).cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
        camera = information.topLeftCorner(parameters, parameters);
        mixed = scale.asDiagonal() * information.bottomLeftCorner(n, parameters);
        own.compute(scale.asDiagonal() * information.bottomRightCorner(n, n) * scale.asDiagonal());
        camera_score = equations.score.head(parameters);
        own_score = scale.cwiseProduct(equations.score.tail(n));
    }

    // Of the camera's parameters, the photograph's own eliminated.
    Eigen::MatrixXd information() const { return camera - mixed.transpose() * own.solve(mixed); }
    Eigen::VectorXd score() const {
        return camera_score - mixed.transpose() * own.solve(own_score);
    }
};

class Adjuster {
public:
    Adjuster(std::span<const PhotoOfMarker> photos, const CalibrationModel& parameters)
        : photos_(photos), parameters_(parameters), scales_(photos.size(), 1.0) {}

    // Noise scales are found again until they no longer change. The same result for any number of
    // threads.
    Place run(const std::shared_ptr<const PhotometricCamera>& camera,
              const std::vector<PhotoState>& start) {
        constexpr int max_rounds = 3;
        constexpr double settled = 0.05;
        Place place = at(camera, start);
        for (int round = 0; round < max_rounds && !(rescale(place) < settled); ++round) {
            std::vector<PhotoState> states;
            for (const PhotoEquations& photo : place.photos)
                states.push_back(photo.state);
            place = at(place.camera, states);
            minimise(place);
        }
        return place;
    }

private:
    Place at(std::shared_ptr<const PhotometricCamera> camera,
             const std::vector<PhotoState>& states) const {
        Place place{std::move(camera), std::vector<PhotoEquations>(photos_.size())};
        const PhotometricTerms terms = refinement_terms(place.camera->model());
        tbb::parallel_for(std::size_t{0}, photos_.size(), [&](std::size_t i) {
            place.photos[i] = photo_equations(photos_[i], *place.camera, states[i], terms,
                                              parameters_, scales_[i]);
        });
        return place;
    }

    // New noise scales from the residuals; returns the largest relative change.
    double rescale(const Place& place) {
        constexpr double min_gray = 0.2;  // rounding to 8 bits: 1 / sqrt(12), and a little less
        double change = 0.0;
        for (std::size_t i = 0; i < photos_.size(); ++i) {
            const double least = place.camera->knows_noise() ? 1.0 : min_gray;
            const double scale = std::max(1.4826 * place.photos[i].median_size * scales_[i], least);
            change = std::max(change, steps_ == 0 ? 1.0 : std::abs(scale / scales_[i] - 1.0));
            scales_[i] = scale;
        }
        return change;
    }

    AdjustmentStep step_at(const Place& place, double damping) const {
        const auto count = static_cast<Eigen::Index>(parameters_.parameters.size());
        std::vector<Damped> damped;
        Eigen::MatrixXd information = Eigen::MatrixXd::Zero(count, count);
        Eigen::VectorXd score = Eigen::VectorXd::Zero(count);
        for (const PhotoEquations& photo : place.photos) {
            const Damped& one = damped.emplace_back(photo, count, damping);
            information += one.information();
            score += one.score();
        }
        AdjustmentStep step;
        const Eigen::VectorXd scale =
            information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
        const Eigen::MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
        step.camera = scale.cwiseProduct(
            Eigen::VectorXd(scaled.ldlt().solve(Eigen::VectorXd(scale.cwiseProduct(score)))));
        for (const Damped& one : damped) {
            const Eigen::VectorXd own = one.own.solve(one.own_score - one.mixed * step.camera);
            step.photos.push_back(one.scale.cwiseProduct(own));
            step.predicted_gain +=
                0.5 * (one.camera_score.dot(step.camera) + one.own_score.dot(own));
        }
        if (!std::isfinite(step.predicted_gain))
            throw NumericalError("the photographs do not determine pose and photometric model");
        return step;
    }

    Place moved(const Place& place, const AdjustmentStep& step) const {
        const PhotometricTerms terms = refinement_terms(place.camera->model());
        std::vector<PhotoState> states;
        for (std::size_t i = 0; i < photos_.size(); ++i)
            states.push_back(stepped(place.photos[i].state, terms, step.photos[i]));
        CameraModel camera = place.camera->model();
        set_parameters(camera, parameters_, parameters_of(camera, parameters_) + step.camera);
        return at(std::make_shared<const PhotometricCamera>(camera), states);
    }

    // A gain of 3e-4 by photograph is some hundredths of a standard deviation. A step that leads
    // where nothing can be rendered is no better than one that raises the loss.
    void minimise(Place& place) {
        const DescentRule rule{.first_damping = 1e-3,
                               .max_damping = 1e6,
                               .max_tries = 60,
                               .enough_gain = 3e-4 * static_cast<double>(photos_.size())};
        auto descent = levenberg_marquardt(
            std::move(place), rule,
            [&](const Place& from, double damping) { return step_at(from, damping); },
            [&](const Place& from, const AdjustmentStep& step) {
                return attempted([&] { return moved(from, step); }).value;
            });
        place = std::move(descent.place);
        steps_ += descent.steps;
    }

    std::span<const PhotoOfMarker> photos_;
    const CalibrationModel& parameters_;
    std::vector<double> scales_;
    int steps_ = 0;
};

// What a photograph says of the camera's parameters; `rest` is not set.
ViewEquations camera_equations(const PhotoEquations& equations, std::size_t parameters) {
    const Damped one(equations, static_cast<Eigen::Index>(parameters), 0.0);
    const Eigen::MatrixXd information = one.information();
    const Eigen::VectorXd score = one.score();
    // A triangular square root of the information, scaled to a unit diagonal.
    constexpr double rounding = 1e-12;
    const Eigen::VectorXd scale = information.diagonal().cwiseMax(1e-300).cwiseSqrt();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(Eigen::MatrixXd(
        scale.cwiseInverse().asDiagonal() * information * scale.cwiseInverse().asDiagonal()));
    const Eigen::VectorXd roots = solver.eigenvalues().cwiseMax(0.0).cwiseSqrt();
    const Eigen::VectorXd inverse_roots =
        roots.unaryExpr([](double root) { return root > std::sqrt(rounding) ? 1.0 / root : 0.0; });
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(
        roots.asDiagonal() * solver.eigenvectors().transpose() * scale.asDiagonal());
    ViewEquations result;
    result.triangle = qr.matrixQR().triangularView<Eigen::Upper>();
    result.rhs = qr.householderQ().transpose() *
                 (inverse_roots.asDiagonal() * solver.eigenvectors().transpose() *
                  scale.cwiseInverse().cwiseProduct(score));
    return result;
}

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

// The photometric models start where they were with all photographs, if given, to save time.
Place refined_on(const Job& job, const Indices& training, const CameraFit& corners,
                 const std::shared_ptr<const PhotometricCamera>& camera, const Place* all) {
    std::vector<PhotoOfMarker> photos;
    std::vector<PhotoState> start;
    for (std::size_t i = 0; i < training.size(); ++i) {
        const Rigid& pose = corners.camera_from_target[i];
        photos.push_back(training_photo(job, training[i], *camera, pose));
        start.push_back(
            all ? PhotoState{pose, all->photos[training[i]].state.photometry}
                : starting_state(photos.back(), *camera, pose, refinement_terms(corners.camera)));
    }
    return Adjuster(photos, job.model).run(camera, start);
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
    const cv::Mat scored = use == pixel_scored;
    const cv::Mat predicted = predicted_at(photo_of(job, photo, use, pixel_scored), *camera,
                                           {pose.camera_from_marker, pose.photometry});
    return cv::norm(job.gray[photo], predicted, cv::NORM_L2, scored) /
           std::sqrt(cv::countNonZero(scored));
}

void validate_fold(const Job& job, const CameraFit& corners, const Place& all, std::size_t fold,
                   std::vector<RefinedPhoto>& photos) {
    Indices training, held_out;
    for (std::size_t i = 0; i < photos.size(); ++i)
        (i % PhotometricRefinement::folds == fold ? held_out : training).push_back(i);
    const CameraFit without = corner_fit(job, training, corners);
    const auto from_corners = std::make_shared<const PhotometricCamera>(without.camera);
    const auto from_pixels = refined_on(job, training, without, from_corners, &all).camera;
    for (const std::size_t i : held_out) {
        const PhotometricModel& start = all.photos[i].state.photometry;
        photos[i].corners_rms_gray = held_out_rms(job, i, from_corners, start);
        photos[i].refined_rms_gray = held_out_rms(job, i, from_pixels, start);
    }
}

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

void state_covariance(const Place& fit, const CalibrationModel& model,
                      PhotometricRefinement& result) {
    std::vector<ViewEquations> equations;
    double squares = 0.0, freedom = -static_cast<double>(model.parameters.size());
    for (const PhotoEquations& photo : fit.photos) {
        equations.push_back(camera_equations(photo, model.parameters.size()));
        squares += photo.squares;
        freedom += photo.pixels - static_cast<double>(photo.score.size()) +
                   static_cast<double>(model.parameters.size());
    }
    const CalibrationCovariances covariances = covariances_of(equations, model, squares / freedom);
    result.deviations = deviations_of(model, covariances);
    result.camera.covariance = ParameterCovariance{model.parameters, covariances.stated};
}

}  // namespace

PhotometricRefinement refine_photometrically(std::span<const CodeImage> photos,
                                             std::span<const CalibrationView> views,
                                             const CellGrid& target, const ComparedArea& area,
                                             const CameraFit& corners,
                                             const CalibrationModel& model) {
    if (photos.size() != views.size() || corners.camera_from_target.size() != views.size())
        throw NumericalError(fmt::format("{} photographs, {} views and {} poses do not match",
                                         photos.size(), views.size(),
                                         corners.camera_from_target.size()));
    constexpr std::size_t min_photos = 6;
    if (photos.size() < min_photos)
        throw NumericalError(fmt::format("photometric refinement needs {} photographs, not {}",
                                         min_photos, photos.size()));
    Job job{{}, views, target, area, model, {corners.camera.width, corners.camera.height}};
    for (const CodeImage& photo : photos)
        job.gray.push_back(gray_of(photo));

    Indices all(photos.size());
    std::iota(all.begin(), all.end(), std::size_t{0});
    const Place fit = refined_on(
        job, all, corners, std::make_shared<const PhotometricCamera>(corners.camera), nullptr);
    PhotometricRefinement result;
    result.camera = fit.camera->model();
    for (const PhotoEquations& photo : fit.photos)
        result.photos.push_back({0.0, 0.0, photo.state.camera_from_marker});
    state_covariance(fit, model, result);
    for (std::size_t fold = 0; fold < PhotometricRefinement::folds; ++fold)
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
