#include "compare/diagnosis/unlisted_error.h"

#include <Eigen/Dense>
#include <algorithm>

namespace etalon {
namespace {

using Moves = std::vector<Eigen::MatrixXd>;

constexpr double kept_variance = 1e-3;  // of a process' largest component
constexpr double rad_per_mm = 1e-2;     // the size of a turn beside that of a shift

// What an error follows: a row of coordinates a pose, from -1 to 1, and how far it reaches.
struct Followed {
    std::string text;
    Eigen::MatrixXd coordinates;
    std::vector<double> lengths;
    bool in_steps = false;  // covariance exp(-d), which allows steps; else exp(-d^2 / 2)
};

Eigen::MatrixXd factor_of(const Followed& followed, double length) {
    const Eigen::MatrixXd& at = followed.coordinates;
    Eigen::MatrixXd covariance(at.rows(), at.rows());
    for (Eigen::Index i = 0; i < at.rows(); ++i)
        for (Eigen::Index j = 0; j < at.rows(); ++j) {
            const double distance = (at.row(i) - at.row(j)).norm() / length;
            covariance(i, j) = std::exp(followed.in_steps ? -distance : -0.5 * distance * distance);
        }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(covariance);
    const Eigen::VectorXd& values = solver.eigenvalues();
    const Eigen::Index kept = (values.array() > kept_variance * values.maxCoeff()).count();
    return solver.eigenvectors().rightCols(kept) * values.tail(kept).cwiseSqrt().asDiagonal();
}

bool moves(const StageAxisMotion& axis) {
    const auto [low, high] = std::ranges::minmax(axis.position);
    return high > low;
}

// Of a rotary axis two: after a turn it is where it was.
Eigen::MatrixXd coordinates_of(const StageAxisMotion& axis) {
    if (axis.is_linear)
        return normalised(axis.position);
    const Eigen::Map<const Eigen::ArrayXd> angle(axis.position.data(), std::ssize(axis.position));
    Eigen::MatrixXd circle(angle.size(), 2);
    circle << angle.cos(), angle.sin();
    return circle;
}

Eigen::MatrixXd joined(const Eigen::MatrixXd& one, const Eigen::MatrixXd& other) {
    Eigen::MatrixXd both(one.rows(), one.cols() + other.cols());
    both << one, other;
    return both;
}

// Of the marker's middle, from -1 to 1 over the wider side.
Eigen::MatrixXd places_in_image(const SignatureChain& chain) {
    const CameraModel& camera = chain.projector.camera();
    Eigen::MatrixXd places(std::ssize(chain.poses), 2);
    for (Eigen::Index i = 0; i < places.rows(); ++i) {
        Eigen::Vector2d sum = Eigen::Vector2d::Zero();
        for (const Eigen::Vector2d& corner :
             projected(chain.projector, chain.points_mm,
                       chain.camera_from_marker(static_cast<std::size_t>(i))))
            sum += corner;
        places.row(i) = 2.0 / std::max(camera.width, camera.height) /
                        static_cast<double>(chain.points_mm.size()) * sum.transpose();
    }
    return places;
}

std::vector<Followed> all_followed(const CandidateRequest& request) {
    constexpr double apart = 1e3;  // the two sides of an axis have nothing in common
    std::vector<const StageAxisMotion*> axes;
    for (const StageAxisMotion& axis : request.axes)
        if (moves(axis))
            axes.push_back(&axis);
    std::vector<Followed> all;
    Eigen::MatrixXd volume(std::ssize(request.chain.poses), 0);
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const StageAxisMotion& axis = *axes[i];
        const Eigen::MatrixXd along = coordinates_of(axis);
        all.push_back({axis.name, along, {0.15, 0.4, 1.0}});
        if (axis.approach.size() == axis.position.size()) {
            const Eigen::VectorXd side =
                apart * Eigen::Map<const Eigen::VectorXi>(axis.approach.data(), along.rows())
                            .cast<double>();
            all.push_back(
                {axis.name + " and the side it came from", joined(along, side), {0.4, 1.0}});
        }
        for (std::size_t k = i + 1; k < axes.size(); ++k)
            all.push_back({axis.name + " and " + axes[k]->name,
                           joined(along, coordinates_of(*axes[k])),
                           {0.4, 1.0}});
        if (axis.is_linear)
            volume = joined(volume, along);
    }
    if (volume.cols() > 2)
        all.push_back({"the place in the volume", volume, {0.4, 1.0}});
    all.push_back({"the place in the image", places_in_image(request.chain), {0.15, 0.4}});
    if (request.times_s.size() == request.chain.poses.size()) {
        const Eigen::MatrixXd time = normalised(request.times_s);
        all.push_back({"time", time, {0.15, 0.4, 1.0}});
        all.push_back({"time in steps", time, {0.3, 2.0}, true});
    }
    return all;
}

struct NamedMoves {
    std::string text, unit;
    Moves perturbations;
};

std::vector<NamedMoves> all_moves(const CandidateRequest& request) {
    const SignatureChain& chain = request.chain;
    const Eigen::MatrixXd unit = Matrix6d::Identity();
    std::vector<NamedMoves> all{{"a shift", "mm", Moves(chain.poses.size(), unit.rightCols<3>())},
                                {"a turn", "rad", Moves(chain.poses.size(), unit.leftCols<3>())}};
    for (const StageAxisMotion& axis : request.axes) {
        if (!moves(axis))
            continue;
        const Eigen::VectorXd advance = sensitivity_px(request, axis) / axis.step;
        const Eigen::Index rows = advance.size() / std::ssize(chain.poses);
        all.push_back({"an error of " + axis.name, unit_of(axis), {}});
        NamedMoves& one = all.back();
        for (std::size_t i = 0; i < chain.poses.size(); ++i)
            one.perturbations.emplace_back(chain.pose_jacobian(i).colPivHouseholderQr().solve(
                Eigen::VectorXd(advance.segment(static_cast<Eigen::Index>(i) * rows, rows))));
    }
    return all;
}

// Products of an error's columns with each other and with the observed, in the directions in which
// the columns' square is diagonal.
struct Directions {
    Eigen::ArrayXd squares, seen2;

    Directions(const Eigen::MatrixXd& columns, const ObservedPoses& observed) {
        const Eigen::MatrixXd lost = observed.absorbed.transpose() * columns;
        const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(
            Eigen::MatrixXd(columns.transpose() * columns - lost.transpose() * lost));
        squares = solver.eigenvalues().array().max(0.0);
        seen2 = (solver.eigenvectors().transpose() * (columns.transpose() * observed.values))
                    .array()
                    .square();
    }
};

// Up to a constant, with the rows' scatter at its best value from 1 up.
double log_probability(const ObservedPoses& observed, double explained, double log_determinant) {
    const double rest = std::max(0.0, observed.square - explained);
    const double enlarged = std::max(1.0, rest / observed.freedom);
    return -0.5 * (rest / enlarged + observed.freedom * std::log(enlarged) + log_determinant);
}

Eigen::MatrixXd seen(Eigen::MatrixXd columns, const std::vector<Matrix6d>& by) {
    for (std::size_t i = 0; i < by.size(); ++i) {
        auto block = columns.middleRows<6>(6 * static_cast<Eigen::Index>(i));
        block = (by[i] * block).eval();
    }
    return columns;
}

}  // namespace

Eigen::MatrixXd UnlistedError::perturbations() const {
    const Eigen::Index ways = moves->front().cols();
    Eigen::MatrixXd columns(6 * factor->rows(), ways * factor->cols());
    for (Eigen::Index i = 0; i < factor->rows(); ++i)
        for (Eigen::Index k = 0; k < factor->cols(); ++k)
            columns.block(6 * i, ways * k, 6, ways) =
                (*factor)(i, k) * (*moves)[static_cast<std::size_t>(i)];
    return columns;
}

Eigen::MatrixXd UnlistedError::corners_px(const SignatureChain& chain) const {
    const Eigen::MatrixXd moved = perturbations();
    const auto rows = static_cast<Eigen::Index>(2 * chain.points_mm.size());
    Eigen::MatrixXd columns(rows * factor->rows(), moved.cols());
    for (Eigen::Index i = 0; i < factor->rows(); ++i)
        columns.middleRows(i * rows, rows) =
            chain.pose_jacobian(static_cast<std::size_t>(i)) * moved.middleRows<6>(6 * i);
    return columns;
}

std::vector<UnlistedError> unlisted_errors(const CandidateRequest& request) {
    std::vector<std::pair<NamedMoves, std::shared_ptr<const Moves>>> by;
    for (NamedMoves& move : all_moves(request)) {
        auto perturbations = std::make_shared<const Moves>(std::move(move.perturbations));
        by.emplace_back(std::move(move), std::move(perturbations));
    }
    std::vector<UnlistedError> all;
    for (const Followed& followed : all_followed(request))
        for (const double length : followed.lengths) {
            const auto factor =
                std::make_shared<const Eigen::MatrixXd>(factor_of(followed, length));
            for (const auto& [move, perturbations] : by)
                all.push_back({move.text + " that follows " + followed.text, move.unit,
                               perturbations, factor});
        }
    return all;
}

UnlistedFit fit_unlisted(const std::vector<UnlistedError>& errors, const ObservedPoses& observed) {
    constexpr double smallest_mm = 1e-3;
    constexpr int sizes = 14;
    const double without = log_probability(observed, 0.0, 0.0);
    UnlistedFit fit{.best = -std::numeric_limits<double>::infinity()};
    std::vector<double> gains;
    for (std::size_t i = 0; i < errors.size(); ++i) {
        const Directions directions(seen(errors[i].perturbations(), observed.seen_by), observed);
        for (int k = 0; k < sizes; ++k) {
            const double size =
                std::ldexp(smallest_mm * (errors[i].unit == "rad" ? rad_per_mm : 1.0), k);
            const Eigen::ArrayXd grown = 1.0 + size * size * directions.squares;
            const double gained =
                log_probability(observed, size * size * (directions.seen2 / grown).sum(),
                                grown.log().sum()) -
                without;
            gains.push_back(gained);
            if (gained > fit.best) {
                fit.error = i;
                fit.size = size;
                fit.best = gained;
            }
        }
    }
    double sum = 0.0;
    for (const double gained : gains)
        sum += std::exp(gained - fit.best);
    fit.mean = fit.best + std::log(sum / static_cast<double>(gains.size()));
    return fit;
}

}  // namespace etalon
