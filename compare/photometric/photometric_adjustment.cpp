#include "compare/photometric/photometric_adjustment.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <cmath>
#include <optional>

#include "core/optimize/least_squares.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// Where a fit is: everything that a step changes, and the equations there.
struct Place {
    std::shared_ptr<const PhotometricCamera> camera;
    std::vector<PhotoState> photos;
    std::vector<PhotoEquations> equations;

    double loss() const {
        double sum = 0.0;
        for (const PhotoEquations& one : equations)
            sum += one.loss;
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
};

class Adjuster {
public:
    Adjuster(std::span<const PhotoOfMarker> photos, const PhotometricTerms& terms,
             const CalibrationModel& parameters)
        : photos_(photos), terms_(terms), parameters_(parameters) {}

    PhotometricAdjustment run(const std::shared_ptr<const PhotometricCamera>& camera,
                              std::span<const PhotoState> start) {
        constexpr int max_rounds = 3;
        constexpr double settled = 0.05;
        scales_.assign(photos_.size(), 1.0);
        Place place = at(camera, {start.begin(), start.end()});
        for (int round = 0; round < max_rounds; ++round) {
            if (rescale(place) < settled)
                break;
            place = at(place.camera, place.photos);
            minimise(place);
        }
        return {place.camera, std::move(place.photos), std::move(place.equations), iterations_,
                converged_};
    }

private:
    Eigen::Index parameter_count() const {
        return static_cast<Eigen::Index>(parameters_.parameters.size());
    }

    Place at(std::shared_ptr<const PhotometricCamera> camera,
             std::vector<PhotoState> states) const {
        Place place{std::move(camera), std::move(states), {}};
        place.equations.resize(photos_.size());
        tbb::parallel_for(std::size_t{0}, photos_.size(), [&](std::size_t i) {
            place.equations[i] = photo_equations(photos_[i], *place.camera, place.photos[i], terms_,
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
            const double scale =
                std::max(1.4826 * place.equations[i].median_size * scales_[i], least);
            const bool first = iterations_ == 0;
            change = std::max(change, first ? 1.0 : std::abs(scale / scales_[i] - 1.0));
            scales_[i] = scale;
        }
        return change;
    }

    AdjustmentStep step_at(const Place& place, double damping) const {
        std::vector<Damped> damped;
        Eigen::MatrixXd information = Eigen::MatrixXd::Zero(parameter_count(), parameter_count());
        Eigen::VectorXd score = Eigen::VectorXd::Zero(parameter_count());
        for (const PhotoEquations& equations : place.equations) {
            const Damped& one = damped.emplace_back(equations, parameter_count(), damping);
            information += one.camera - one.mixed.transpose() * one.own.solve(one.mixed);
            score += one.camera_score - one.mixed.transpose() * one.own.solve(one.own_score);
        }
        AdjustmentStep step;
        if (parameter_count() > 0) {
            const Eigen::VectorXd scale =
                information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
            const Eigen::MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
            step.camera = scale.cwiseProduct(
                Eigen::VectorXd(scaled.ldlt().solve(Eigen::VectorXd(scale.cwiseProduct(score)))));
        } else {
            step.camera.resize(0);
        }
        for (const Damped& one : damped) {
            const Eigen::VectorXd own = one.own.solve(one.own_score - one.mixed * step.camera);
            step.photos.push_back(one.scale.cwiseProduct(own));
            step.predicted_gain +=
                0.5 * (one.camera_score.dot(step.camera) + one.own_score.dot(own));
        }
        return step;
    }

    Place moved(const Place& place, const AdjustmentStep& step) const {
        std::vector<PhotoState> states;
        for (std::size_t i = 0; i < photos_.size(); ++i)
            states.push_back(stepped(place.photos[i], terms_, step.photos[i]));
        if (parameter_count() == 0)
            return at(place.camera, std::move(states));
        CameraModel camera = place.camera->model();
        set_parameters(camera, parameters_, parameters_of(camera, parameters_) + step.camera);
        return at(std::make_shared<const PhotometricCamera>(camera), std::move(states));
    }

    // A gain of 3e-4 by photograph is some hundredths of a standard deviation. A step that leads
    // where nothing can be rendered is no better than one that raises the loss.
    void minimise(Place& place) {
        const auto count = static_cast<double>(photos_.size());
        const DescentRule rule{.first_damping = 1e-3,
                               .max_damping = 1e6,
                               .max_tries = 60,
                               .enough_gain = 3e-4 * count};
        constexpr double rounding = 1e-2;  // by photograph: the renderer's own steps hide less
        const auto determined_step = [&](const Place& from, double damping) {
            AdjustmentStep step = step_at(from, damping);
            if (!std::isfinite(step.predicted_gain))
                throw NumericalError("the photographs do not determine pose and photometric model");
            return step;
        };
        const auto tried = [&](const Place& from, const AdjustmentStep& step) {
            return attempted([&] { return moved(from, step); }).value;
        };
        auto descent = levenberg_marquardt(std::move(place), rule, determined_step, tried);
        place = std::move(descent.place);
        iterations_ += descent.steps;
        converged_ = descent.converged || step_at(place, 0.0).predicted_gain < rounding * count;
    }

    std::span<const PhotoOfMarker> photos_;
    PhotometricTerms terms_;
    const CalibrationModel& parameters_;
    std::vector<double> scales_;
    int iterations_ = 0;
    bool converged_ = false;
};

}  // namespace

PhotometricAdjustment adjust_to_photos(std::span<const PhotoOfMarker> photos,
                                       std::shared_ptr<const PhotometricCamera> camera,
                                       std::span<const PhotoState> start,
                                       const PhotometricTerms& terms,
                                       const CalibrationModel& parameters) {
    if (photos.empty() || start.size() != photos.size())
        throw NumericalError(
            fmt::format("{} photographs with {} starts", photos.size(), start.size()));
    return Adjuster(photos, terms, parameters).run(camera, start);
}

ViewEquations camera_equations(const PhotoEquations& equations, std::size_t parameters) {
    const Damped one(equations, static_cast<Eigen::Index>(parameters), 0.0);
    const Eigen::MatrixXd information =
        one.camera - one.mixed.transpose() * one.own.solve(one.mixed);
    const Eigen::VectorXd score =
        one.camera_score - one.mixed.transpose() * one.own.solve(one.own_score);
    // A square root of the information, which one photograph need not determine fully, made
    // triangular. Scaled to a unit diagonal: the parameters' units differ by orders of magnitude.
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

}  // namespace etalon
