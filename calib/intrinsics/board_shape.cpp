#include "calib/intrinsics/board_shape.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <cmath>

#include "calib/intrinsics/bundle_adjustment.h"
#include "core/program/errors.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

using Eigen::MatrixXd, Eigen::VectorXd, Eigen::Vector3d;
using OfBoardPoint = Eigen::Matrix<double, 2, 3>;

// The board's points by id, three coordinates each: the unknowns of its shape.
class DrawnBoard {
public:
    explicit DrawnBoard(std::span<const CalibrationView> views) {
        std::map<int, Vector3d> places;
        for (const CalibrationView& view : views)
            for (std::size_t i = 0; i < view.points_mm.size(); ++i) {
                const auto [known, is_new] = places.emplace(id_of(view, i), view.points_mm[i]);
                if (!is_new && known->second != view.points_mm[i])
                    throw NumericalError(
                        fmt::format("the point with id {} is in two places of the board, so "
                                    "nothing can be said of its shape",
                                    known->first));
            }
        for (const auto& [id, place] : places) {
            indices_[id] = std::ssize(points);
            ids.push_back(id);
            points.push_back(place);
        }
    }

    static int id_of(const CalibrationView& view, std::size_t point) {
        return view.ids.empty() ? static_cast<int>(point) : view.ids[point];
    }
    Eigen::Index index(const CalibrationView& view, std::size_t point) const {
        return indices_.at(id_of(view, point));
    }
    Eigen::Index unknowns() const { return 3 * std::ssize(points); }

    double extent_mm() const {
        Eigen::AlignedBox2d box;
        for (const Vector3d& point : points)
            box.extend(point.head<2>());
        return box.diagonal().norm();
    }

    // Columns 1, x, y, x^2, x y, y^2 at the points, about their mean.
    MatrixXd quadratics() const {
        Eigen::Vector2d mean = Eigen::Vector2d::Zero();
        for (const Vector3d& point : points)
            mean += point.head<2>() / static_cast<double>(points.size());
        MatrixXd columns(std::ssize(points), 6);
        for (Eigen::Index i = 0; i < columns.rows(); ++i) {
            const Eigen::Vector2d p = points[static_cast<std::size_t>(i)].head<2>() - mean;
            columns.row(i) << 1.0, p.x(), p.y(), p.x() * p.x(), p.x() * p.y(), p.y() * p.y();
        }
        return columns;
    }

    std::vector<int> ids;
    std::vector<Vector3d> points;

private:
    std::map<int, Eigen::Index> indices_;
};

// The bicubic B-splines of a field over the part of the image that the pixels reach.
class ImageField {
public:
    explicit ImageField(std::span<const CalibrationView> views) {
        for (const CalibrationView& view : views)
            for (const Eigen::Vector2d& pixel : view.pixels)
                box_.extend(pixel);
    }

    static constexpr Eigen::Index splines = 6, columns = 2 * splines * splines;

    // d displacement of this pixel / d coefficients.
    Eigen::Matrix<double, 2, columns> at(const Eigen::Vector2d& pixel) const {
        const Eigen::Vector2d place = (pixel - box_.min()).cwiseQuotient(box_.sizes());
        const auto x = weights(place.x()), y = weights(place.y());
        Eigen::Matrix<double, 2, columns> row = Eigen::Matrix<double, 2, columns>::Zero();
        for (Eigen::Index i = 0; i < splines; ++i)
            for (Eigen::Index k = 0; k < splines; ++k)
                row(0, 2 * (splines * i + k)) = row(1, 2 * (splines * i + k) + 1) = x[i] * y[k];
        return row;
    }

private:
    // Of cubic B-splines with equal knots at a place from 0 to 1.
    static Eigen::Matrix<double, splines, 1> weights(double place) {
        constexpr Eigen::Index intervals = splines - 3;
        const double t = place * intervals;
        const Eigen::Index first = std::clamp<Eigen::Index>(Eigen::Index(t), 0, intervals - 1);
        const double u = t - double(first), v = 1.0 - u;
        Eigen::Matrix<double, splines, 1> all = Eigen::Matrix<double, splines, 1>::Zero();
        all.segment<4>(first) << v * v * v / 6.0, (3 * u * u * u - 6 * u * u + 4) / 6.0,
            (3 * v * v * v - 6 * v * v + 4) / 6.0, u * u * u / 6.0;
        return all;
    }

    Eigen::AlignedBox2d box_;
};

// One view's linear model with its pose projected off: residual = common c + points d.
struct ViewDesign {
    MatrixXd common;                     // by the camera's parameters, then the field's
    MatrixXd pose;                       // an orthonormal basis of what the pose can do
    std::vector<OfBoardPoint> of_point;  // by the point's own displacement, pose not projected off
    std::vector<Eigen::Index> point;     // which
    VectorXd residual;
};

ViewDesign view_design(const CalibrationView& view, const DrawnBoard& board, const CameraFit& fit,
                       std::size_t index, const ImageField* field) {
    const CalibrationModel& model = fit.model;
    const PixelModel<double> pixel_model(fit.camera.projection, all_parameters(fit.camera));
    const Rigid& pose = fit.camera_from_target[index];
    const Eigen::Matrix3d rotation = pose.rotation.toRotationMatrix();
    const Eigen::Index free = std::ssize(model.parameters), rows = 2 * std::ssize(view.pixels);
    ViewDesign design;
    design.common.resize(rows, free + (field ? ImageField::columns : 0));
    design.residual.resize(rows);
    MatrixXd of_pose(rows, 6);
    PixelModel<double>::OfParameters of_parameters;
    Vector3d centre = Vector3d::Zero();
    for (std::size_t i = 0; i < view.points_mm.size(); ++i)
        centre += view.true_point_mm(i) / static_cast<double>(view.points_mm.size());
    for (std::size_t i = 0; i < view.pixels.size(); ++i) {
        const Vector3d p = pose * view.true_point_mm(i);
        const auto seen = pixel_model.with_derivatives(p, of_parameters);
        const double weight = 1.0 / view.sigma(i);
        const OfBoardPoint of_place = weight * seen.of;
        const Vector3d arm = rotation * (view.true_point_mm(i) - centre);
        const Eigen::Index row = 2 * static_cast<Eigen::Index>(i);
        of_pose.middleRows<2>(row) = pose_jacobian(of_place, arm);
        for (Eigen::Index k = 0; k < free; ++k)
            design.common.block<2, 1>(row, k) =
                weight * of_parameters.col(parameter_index(model.parameters[std::size_t(k)]));
        if (field)
            design.common.block<2, ImageField::columns>(row, free) = weight * field->at(seen.pixel);
        design.of_point.push_back(of_place * rotation);
        design.point.push_back(board.index(view, i));
        design.residual.segment<2>(row) = weight * (view.pixels[i] - seen.pixel);
    }
    const VectorXd scale = of_pose.colwise().norm().cwiseInverse().transpose();
    const Eigen::HouseholderQR<MatrixXd> qr(MatrixXd(of_pose * scale.asDiagonal()));
    design.pose = qr.householderQ() * MatrixXd::Identity(rows, 6);
    design.common -= design.pose * (design.pose.transpose() * design.common);
    design.residual -= design.pose * (design.pose.transpose() * design.residual);
    return design;
}

// The points' derivatives, transposed, times a matrix.
MatrixXd onto_points(const ViewDesign& design, const MatrixXd& matrix, Eigen::Index unknowns) {
    MatrixXd sum = MatrixXd::Zero(unknowns, matrix.cols());
    for (std::size_t i = 0; i < design.point.size(); ++i)
        sum.middleRows<3>(3 * design.point[i]) +=
            design.of_point[i].transpose() * matrix.middleRows<2>(2 * static_cast<Eigen::Index>(i));
    return sum;
}

// What the views say of the board once poses, camera and field are eliminated: for displacements d
// the squares are squares - 2 score d + d information d.
struct BoardSystem {
    MatrixXd information;
    VectorXd score;
    MatrixXd view_scores;  // a column each
    double squares = 0.0;
    double freedom = 0.0, observations = 0.0;  // freedom: of the squares
    MatrixXd camera_of_board;                  // d parameters of the model / d displacements, minus
};

// Columns of the field that do what the camera does, or nothing, are told apart by a trace of
// regularisation.
BoardSystem board_system(std::span<const ViewDesign> views, Eigen::Index unknowns,
                         const VectorXd& pull) {
    constexpr double least = 1e-10;
    const Eigen::Index size = views.front().common.cols();
    MatrixXd common = MatrixXd::Zero(size, size), cross = MatrixXd::Zero(unknowns, size);
    VectorXd rhs = VectorXd::Zero(size);
    BoardSystem system{MatrixXd::Zero(unknowns, unknowns), VectorXd::Zero(unknowns),
                       MatrixXd(unknowns, std::ssize(views))};
    for (const ViewDesign& view : views) {
        common += view.common.transpose() * view.common;
        rhs += view.common.transpose() * view.residual;
        cross += onto_points(view, view.common, unknowns);
        system.score += onto_points(view, view.residual, unknowns);
        for (std::size_t i = 0; i < view.point.size(); ++i)
            system.information.block<3, 3>(3 * view.point[i], 3 * view.point[i]) +=
                view.of_point[i].transpose() * view.of_point[i];
        const MatrixXd of_pose = onto_points(view, view.pose, unknowns);
        system.information.noalias() -= of_pose * of_pose.transpose();
        system.squares += view.residual.squaredNorm();
        system.observations += static_cast<double>(view.residual.size());
    }
    const VectorXd scale =
        common.diagonal().unaryExpr([](double d) { return d > 0.0 ? 1.0 / std::sqrt(d) : 1.0; });
    MatrixXd scaled = scale.asDiagonal() * common * scale.asDiagonal();
    scaled.diagonal() += scale.cwiseAbs2().cwiseProduct(pull);
    scaled.diagonal().array() += least;
    const Eigen::LDLT<MatrixXd> solver(scaled);
    const auto solve = [&](const MatrixXd& right) -> MatrixXd {
        return scale.asDiagonal() * solver.solve(scale.asDiagonal() * right);
    };
    system.camera_of_board = solve(cross.transpose());
    const VectorXd best = solve(rhs);
    system.information.noalias() -= cross * system.camera_of_board;
    system.score -= cross * best;
    system.squares -= rhs.dot(best);
    system.freedom =
        system.observations - 6.0 * static_cast<double>(views.size()) - solve(common).trace();
    for (std::size_t v = 0; v < views.size(); ++v) {
        const VectorXd left = views[v].residual - views[v].common * best;
        system.view_scores.col(static_cast<Eigen::Index>(v)) =
            onto_points(views[v], left, unknowns) -
            system.camera_of_board.transpose() * (views[v].common.transpose() * left);
    }
    return system;
}

BoardSystem board_system(std::span<const CalibrationView> views, const DrawnBoard& board,
                         const CameraFit& fit, const ImageField* field) {
    std::vector<ViewDesign> designs;
    for (std::size_t v = 0; v < views.size(); ++v)
        designs.push_back(view_design(views[v], board, fit, v, field));
    VectorXd pull = VectorXd::Zero(designs.front().common.cols());
    const auto& parameters = fit.model.parameters;
    for (std::size_t i = 0; i < parameters.size(); ++i)
        pull[static_cast<Eigen::Index>(i)] =
            std::pow(fit.pull[parameter_index(parameters[i])], 2) * double(views.size());
    return board_system(designs, board.unknowns(), pull);
}

// The inverse of the prior's covariance: of every coordinate its width, but for the three bows.
class PriorPrecision {
public:
    explicit PriorPrecision(const DrawnBoard& board)
        : extent_mm_(board.extent_mm()), bow_(bows(board)) {}

    MatrixXd of(const BoardPrior& prior) const {
        const Eigen::Index points = bow_.rows();
        const double in_plane = 1.0 / (prior.in_plane_mm * prior.in_plane_mm),
                     out_of_plane = 1.0 / (prior.out_of_plane_mm * prior.out_of_plane_mm),
                     bow = 1.0 / (1.0 / out_of_plane +
                                  std::pow(prior_bow_per_extent * extent_mm_, 2) * double(points));
        MatrixXd precision = Vector3d(in_plane, in_plane, out_of_plane)
                                 .replicate(points, 1)
                                 .asDiagonal()
                                 .toDenseMatrix();
        const MatrixXd of_bow = (bow - out_of_plane) * bow_ * bow_.transpose();
        for (Eigen::Index i = 0; i < points; ++i)
            for (Eigen::Index k = 0; k < points; ++k)
                precision(3 * i + 2, 3 * k + 2) += of_bow(i, k);
        return precision;
    }

    // The prior's own widths are told by what is no bow.
    const MatrixXd& bow() const { return bow_; }
    double extent_mm() const { return extent_mm_; }

private:
    // Orthonormal, and orthogonal to what moves and tilts the board.
    static MatrixXd bows(const DrawnBoard& board) {
        const MatrixXd columns = board.quadratics();
        const VectorXd scale = columns.colwise().norm().cwiseInverse().transpose();
        const Eigen::HouseholderQR<MatrixXd> qr(MatrixXd(columns * scale.asDiagonal()));
        const MatrixXd q = qr.householderQ() * MatrixXd::Identity(columns.rows(), 6);
        return q.rightCols(3);
    }

    double extent_mm_;
    MatrixXd bow_;
};

using Coordinates = Eigen::Map<const Eigen::Matrix3Xd>;

struct BoardEstimate {
    VectorXd displacements;
    MatrixXd covariance;
    BoardPrior prior;
    double variance = 0.0;
    double parameters = 0.0;
    double squares = 0.0;  // that are left
};

// The displacements from the linear model about `at` for given widths and variance.
BoardEstimate estimated(const BoardSystem& system, const PriorPrecision& precision,
                        const VectorXd& at, const BoardPrior& prior, double variance) {
    const MatrixXd of_prior = precision.of(prior);
    const Eigen::LLT<MatrixXd> solver(MatrixXd(system.information / variance + of_prior));
    BoardEstimate estimate;
    estimate.displacements = solver.solve((system.score + system.information * at) / variance);
    estimate.covariance = solver.solve(MatrixXd::Identity(at.size(), at.size()));
    estimate.parameters =
        static_cast<double>(at.size()) - of_prior.cwiseProduct(estimate.covariance).sum();
    const VectorXd step = estimate.displacements - at;
    estimate.squares =
        system.squares - 2.0 * system.score.dot(step) + step.dot(system.information * step);
    estimate.prior = prior;
    estimate.variance = variance;
    return estimate;
}

// MacKay's rule: a width's square is that of the displacements over how many the photos determine.
BoardPrior told_prior(const BoardEstimate& estimate, const PriorPrecision& precision) {
    constexpr double least = 1e-6;  // of the extent
    const MatrixXd& bow = precision.bow();
    const Eigen::Index points = bow.rows();
    const Coordinates d(estimate.displacements.data(), 3, points);
    VectorXd height = d.row(2).transpose();
    height -= bow * (bow.transpose() * height);
    MatrixXd of_height(points, points);
    double of_plane = 0.0;
    for (Eigen::Index i = 0; i < points; ++i) {
        of_plane += estimate.covariance.diagonal().segment<2>(3 * i).sum();
        for (Eigen::Index k = 0; k < points; ++k)
            of_height(i, k) = estimate.covariance(3 * i + 2, 3 * k + 2);
    }
    const double trace = of_height.trace() - (bow.transpose() * of_height * bow).trace();
    const auto width = [&](double squares, double count, double trace_of, double before) {
        const double determined = count - trace_of / (before * before);
        const double told = determined > 0.0 ? std::sqrt(squares / determined) : before;
        return std::clamp(told, least * precision.extent_mm(),
                          prior_bow_per_extent * precision.extent_mm());
    };
    const double n = static_cast<double>(points);
    return {width(d.topRows<2>().squaredNorm(), 2.0 * n, of_plane, estimate.prior.in_plane_mm),
            width(height.squaredNorm(), n - 3.0, trace, estimate.prior.out_of_plane_mm)};
}

// With widths and variance as the photos tell them.
BoardEstimate told_estimate(const BoardSystem& system, const PriorPrecision& precision,
                            const VectorXd& at, BoardEstimate start) {
    constexpr int most_rounds = 50;
    constexpr double settled = 0.01;
    BoardEstimate estimate;
    for (int round = 0; round < most_rounds; ++round) {
        estimate = estimated(system, precision, at, start.prior, start.variance);
        start.prior = told_prior(estimate, precision);
        start.variance = estimate.squares / (system.freedom - estimate.parameters);
        const auto alike = [](double a, double b) { return std::abs(a - b) <= settled * b; };
        if (alike(start.prior.in_plane_mm, estimate.prior.in_plane_mm) &&
            alike(start.prior.out_of_plane_mm, estimate.prior.out_of_plane_mm) &&
            alike(start.variance, estimate.variance))
            break;
    }
    return estimate;
}

// The start: displacements of a ten thousandth of the board (0.02 of 200 mm), bows of any size.
BoardPrior first_prior(double extent_mm) {
    return {1e-4 * extent_mm, 1e-4 * extent_mm};
}

DisplacementSize size_of(const BoardEstimate& estimate) {
    const Eigen::Index points = estimate.displacements.size() / 3;
    const Coordinates d(estimate.displacements.data(), 3, points);
    const double norm = estimate.displacements.norm(), root = std::sqrt(double(points));
    const VectorXd direction = estimate.displacements / std::max(norm, 1e-300);
    return {norm / root, std::sqrt(direction.dot(estimate.covariance * direction)) / root,
            d.colwise().norm().maxCoeff()};
}

// How many of the sign changes explain as much as none.
double chance_of_signs(const MatrixXd& gram, double null_scale) {
    constexpr int most_patterns = 4096;
    const Eigen::Index views = gram.rows();
    const bool is_all = views <= 13;
    const int patterns = is_all ? 1 << (views - 1) : most_patterns;
    const double seen = gram.sum();
    RandomStream random(1, 1);
    int as_much = 1;
    VectorXd signs = VectorXd::Ones(views);
    for (int pattern = 1; pattern < patterns; ++pattern) {
        for (Eigen::Index v = 1; v < views; ++v)
            signs[v] = (is_all ? pattern >> (v - 1) & 1 : random.uniform() < 0.5) ? -1.0 : 1.0;
        as_much += null_scale * signs.dot(gram * signs) >= seen;
    }
    return double(as_much) / patterns;
}

void set_displacements(std::vector<CalibrationView>& views, const DrawnBoard& board,
                       const VectorXd& displacements) {
    for (CalibrationView& view : views) {
        view.displacements_mm.clear();
        for (std::size_t i = 0; i < view.points_mm.size(); ++i)
            view.displacements_mm.push_back(displacements.segment<3>(3 * board.index(view, i)));
    }
}

void set_curvature(BoardShape& shape, const DrawnBoard& board, const BoardEstimate& estimate) {
    const MatrixXd columns = board.quadratics();
    const VectorXd scale = columns.colwise().norm().cwiseInverse().transpose();
    const MatrixXd scaled = columns * scale.asDiagonal();
    const MatrixXd inverse =
        scale.asDiagonal() * MatrixXd(scaled.completeOrthogonalDecomposition().pseudoInverse());
    MatrixXd of_height = MatrixXd::Zero(3, board.unknowns());
    for (Eigen::Index i = 0; i < columns.rows(); ++i)
        of_height.col(3 * i + 2) = inverse.col(i).tail<3>().cwiseProduct(Vector3d(2.0, 1.0, 2.0));
    shape.curvature_per_mm = of_height * estimate.displacements;
    shape.curvature_deviation_per_mm =
        (of_height * estimate.covariance * of_height.transpose()).diagonal().cwiseSqrt();
}

BoardShape shape_of(const DrawnBoard& board, const BoardEstimate& estimate,
                    const MatrixXd& camera_of_board) {
    BoardShape shape{size_of(estimate)};
    for (std::size_t i = 0; i < board.ids.size(); ++i) {
        const Eigen::Index at = 3 * static_cast<Eigen::Index>(i);
        shape.points.push_back({board.ids[i], board.points[i],
                                estimate.displacements.segment<3>(at),
                                estimate.covariance.diagonal().segment<3>(at).cwiseSqrt()});
    }
    set_curvature(shape, board, estimate);
    shape.prior = estimate.prior;
    shape.variance = estimate.variance;
    shape.parameters = estimate.parameters;
    shape.camera_covariance = camera_of_board * estimate.covariance * camera_of_board.transpose();
    return shape;
}

VectorXd displacements_of(const BoardShape& shape, const DrawnBoard& board) {
    VectorXd displacements = VectorXd::Zero(board.unknowns());
    for (const ShapedPoint& point : shape.points) {
        const auto at = std::ranges::lower_bound(board.ids, point.id);
        if (at != board.ids.end() && *at == point.id)
            displacements.segment<3>(3 * (at - board.ids.begin())) = point.displacement_mm;
    }
    return displacements;
}

}  // namespace

CalibrationView BoardShape::shaped(CalibrationView view) const {
    view.displacements_mm.assign(view.points_mm.size(), Vector3d::Zero());
    for (std::size_t i = 0; i < view.points_mm.size(); ++i) {
        const auto at =
            std::ranges::lower_bound(points, DrawnBoard::id_of(view, i), {}, &ShapedPoint::id);
        if (at != points.end() && at->id == DrawnBoard::id_of(view, i))
            view.displacements_mm[i] = at->displacement_mm;
    }
    return view;
}

BoardShape fit_board_shape(std::span<const CalibrationView> given, const CameraFit& first,
                           const std::optional<BoardShape>& start) {
    constexpr int most_rounds = 30;
    constexpr double settled = 1e-3;  // standard deviations, RMS over the coordinates
    if (first.model.projection == Projection::telecentric)
        throw NumericalError(
            "the board's shape is not to be had with a telecentric camera, which does not tell a "
            "height, or a tilt, from its opposite");
    const DrawnBoard board(given);
    const PriorPrecision precision(board);
    std::vector<CalibrationView> views(given.begin(), given.end());
    BoardEstimate estimate;
    estimate.prior = start ? start->prior : first_prior(precision.extent_mm());
    estimate.variance = start ? start->variance : first.variance;
    VectorXd at = start ? displacements_of(*start, board) : VectorXd::Zero(board.unknowns());
    CameraFit fit = first;
    BoardShape shape;
    for (int round = 0; round < most_rounds && !shape.converged; ++round) {
        set_displacements(views, board, at);
        fit = refit_camera(views, fit, fit.camera_from_target);
        const BoardSystem system = board_system(views, board, fit, nullptr);
        estimate = start ? estimated(system, precision, at, start->prior, start->variance)
                         : told_estimate(system, precision, at, estimate);
        const VectorXd change =
            (estimate.displacements - at).cwiseQuotient(estimate.covariance.diagonal().cwiseSqrt());
        at = estimate.displacements;
        shape = shape_of(board, estimate, system.camera_of_board);
        shape.converged = change.norm() <= settled * std::sqrt(double(change.size()));
    }
    return shape;
}

std::optional<BoardFlatness> check_board(std::span<const CalibrationView> views,
                                         const CameraFit& fit) {
    if (views.size() < min_board_views || fit.model.projection == Projection::telecentric)
        return std::nullopt;
    const DrawnBoard board(views);
    const ImageField field(views);
    const PriorPrecision precision(board);
    const BoardSystem system = board_system(views, board, fit, &field);
    if (!(system.freedom > 0.0) || !(system.squares > 0.0))
        return std::nullopt;
    const double variance = system.squares / system.freedom;
    const BoardPrior prior = first_prior(precision.extent_mm());
    const Eigen::LLT<MatrixXd> solver(
        MatrixXd(system.information / variance + precision.of(prior)));
    const MatrixXd explained = solver.matrixL().solve(system.view_scores);
    const BoardEstimate estimate =
        told_estimate(system, precision, VectorXd::Zero(board.unknowns()),
                      {.prior = prior, .variance = variance});
    BoardFlatness flatness{size_of(estimate)};
    flatness.chance =
        chance_of_signs(explained.transpose() * explained, system.observations / system.freedom);
    const double left = estimate.squares / (system.freedom - estimate.parameters);
    flatness.share = std::max(0.0, 1.0 - left / variance);
    return flatness;
}

}  // namespace etalon
