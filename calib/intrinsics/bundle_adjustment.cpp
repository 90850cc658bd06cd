#include "calib/intrinsics/bundle_adjustment.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <cmath>

namespace etalon {
namespace {

constexpr int pose_size = 6;

// A step is one vector: the changes of the free parameters, then of each pose.
auto pose_part(auto& step, Eigen::Index free, std::size_t view) {
    return step.template segment<pose_size>(free + pose_size * static_cast<Eigen::Index>(view));
}

// The upper triangle after QR, with zeros below; as many rows as columns.
Eigen::MatrixXd triangle_of(const Eigen::MatrixXd& matrix) {
    const Eigen::Index size = matrix.cols();
    if (matrix.rows() < size) {
        Eigen::MatrixXd padded = Eigen::MatrixXd::Zero(size, size);
        padded.topRows(matrix.rows()) = matrix;
        return triangle_of(padded);
    }
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(matrix);
    return qr.matrixQR().topRows(size).triangularView<Eigen::Upper>();
}

// What no pixel depends on at first order stays (a telecentric camera's distance, the tilt of a
// plane seen flat on): one more row holds each.
void hold_what_has_no_effect(Eigen::MatrixXd& rows) {
    for (Eigen::Index k = 0; k < pose_size; ++k) {
        if ((rows.col(k).array() != 0.0).any())
            continue;
        rows.conservativeResize(rows.rows() + 1, Eigen::NoChange);
        rows.row(rows.rows() - 1).setZero();
        rows(rows.rows() - 1, k) = 1;
    }
}

double huber_cost(double distance, double threshold) {
    if (threshold == 0.0 || distance <= threshold)
        return distance * distance;
    return threshold * (2 * distance - threshold);
}

// The square root of the weight with which squares stand in for Huber's function.
double huber_weight(double distance, double threshold) {
    return threshold == 0.0 || distance <= threshold ? 1.0 : std::sqrt(threshold / distance);
}

// Nothing where the model is not regular.
std::optional<double> view_cost(const BundleView& view, const PixelModel<double>& model,
                                const BundlePose& pose, double huber) {
    const Eigen::Matrix3d rotation = pose.rotation.toRotationMatrix();
    double cost = 0;
    for (Eigen::Index i = 0; i < view.points_mm.cols(); ++i) {
        const Eigen::Vector3d p = rotation * view.points_mm.col(i) + pose.translation;
        const auto seen = model(p);
        if (!seen.is_regular)
            return std::nullopt;
        cost += huber_cost(view.weights[i] * (view.pixels.col(i) - seen.pixel).norm(), huber);
    }
    return cost;
}

// Which of the free parameters are pulled towards zero.
std::vector<Eigen::Index> pulled(const BundleOptions& options) {
    std::vector<Eigen::Index> columns;
    for (std::size_t i = 0; i < options.free.size(); ++i)
        if (options.pull[options.free[i]] > 0.0)
            columns.push_back(static_cast<Eigen::Index>(i));
    return columns;
}

// Weighted: of each point two, of each pull one; 6 columns of the pose, the free parameters, the
// residual.
Eigen::MatrixXd view_rows(const BundleView& view, const PixelModel<double>& model,
                          const BundlePose& pose, const BundleOptions& options) {
    const Eigen::Index points = view.points_mm.cols();
    const Eigen::Index free = static_cast<Eigen::Index>(options.free.size());
    const Eigen::Matrix3d rotation = pose.rotation.toRotationMatrix();
    PixelModel<double>::OfParameters of_parameters;
    const std::vector<Eigen::Index> held = pulled(options);
    Eigen::MatrixXd rows =
        Eigen::MatrixXd::Zero(2 * points + std::ssize(held), pose_size + free + 1);
    for (Eigen::Index i = 0; i < points; ++i) {
        const Eigen::Vector3d turned = rotation * view.points_mm.col(i);
        const Eigen::Vector3d p = turned + pose.translation;
        const auto seen = model.with_derivatives(p, of_parameters);
        const Eigen::Vector2d residual = view.weights[i] * (view.pixels.col(i) - seen.pixel);
        const double huber = huber_weight(residual.norm(), options.huber);
        const double weight = huber * view.weights[i];
        auto of_point = rows.middleRows<2>(2 * i);
        of_point.leftCols<pose_size>() = weight * pose_jacobian(seen.of, turned);
        for (Eigen::Index k = 0; k < free; ++k)
            of_point.col(pose_size + k) = weight * of_parameters.col(options.free[k]);
        of_point.col(pose_size + free) = huber * residual;
    }
    for (Eigen::Index i = 0; i < std::ssize(held); ++i) {
        const int index = options.free[held[i]];
        rows(2 * points + i, pose_size + held[i]) = options.pull[index];
        rows(2 * points + i, pose_size + free) = -options.pull[index] * model.parameters()[index];
    }
    hold_what_has_no_effect(rows);
    return rows;
}

// A telecentric camera sees a tilt t about x and y at second order when a plane lies flat on: a
// point p moves by t x (t x p) / 2. Where the residuals pull against that motion they add to the
// curvature of the cost, and Gauss-Newton steps, which leave it out, go too far or turn back and
// forth. Two rows below the Jacobian add it; directions in which they pull the other way get none.
// `rows`: view_rows() of this view and pose.
Eigen::Matrix2d curvature_of_tilt(const BundleView& view, const BundlePose& pose,
                                  const Eigen::MatrixXd& rows) {
    const Eigen::Matrix3d rotation = pose.rotation.toRotationMatrix();
    Eigen::Matrix2d curvature = Eigen::Matrix2d::Zero();
    for (Eigen::Index i = 0; i < view.points_mm.cols(); ++i) {
        const Eigen::Vector3d p = rotation * view.points_mm.col(i);
        const auto of_point = rows.middleRows<2>(2 * i);
        const Eigen::Vector2d pull =
            of_point.middleCols<2>(3).transpose() * of_point.rightCols<1>();
        curvature(0, 0) += pull.y() * p.y();
        curvature(1, 1) += pull.x() * p.x();
        curvature(1, 0) -= 0.5 * (pull.x() * p.y() + pull.y() * p.x());
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> parts(curvature);
    return parts.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal() *
           parts.eigenvectors().transpose();
}

// Lengths of the Jacobian's columns: damping is relative to them.
struct Scales {
    Eigen::VectorXd camera;
    std::vector<Eigen::Matrix<double, pose_size, 1>> poses;
};

Scales scales_of(const std::vector<Eigen::MatrixXd>& triangles) {
    const Eigen::Index free = triangles.front().cols() - pose_size - 1;
    Scales scales{Eigen::VectorXd::Zero(free), {}};
    const auto or_one = [](double length) { return length > 0 ? length : 1.0; };
    for (const Eigen::MatrixXd& triangle : triangles) {
        const Eigen::VectorXd lengths = triangle.colwise().norm().transpose();
        scales.camera += lengths.segment(pose_size, free).cwiseAbs2();
        scales.poses.push_back(lengths.head<pose_size>().unaryExpr(or_one));
    }
    scales.camera = scales.camera.cwiseSqrt().unaryExpr(or_one).eval();
    return scales;
}

// The triangle with more rows of the first parameters of a pose, whose residuals are zero.
Eigen::MatrixXd with_pose_rows(const Eigen::MatrixXd& rows, const Eigen::MatrixXd& more) {
    Eigen::MatrixXd stack = Eigen::MatrixXd::Zero(rows.rows() + more.rows(), rows.cols());
    stack.topRows(rows.rows()) = rows;
    stack.bottomLeftCorner(more.rows(), more.cols()) = more;
    return triangle_of(stack);
}

// The least-squares step with the rows sqrt(lambda) * scale added below the Jacobian.
Eigen::VectorXd solve(std::vector<Eigen::MatrixXd> triangles, const Scales& scales, double lambda) {
    const Eigen::Index free = scales.camera.size();
    const Eigen::Index views = static_cast<Eigen::Index>(triangles.size());
    Eigen::MatrixXd common = Eigen::MatrixXd::Zero((views + 1) * free, free + 1);
    for (Eigen::Index v = 0; v < views; ++v) {
        if (lambda > 0)
            triangles[v] =
                with_pose_rows(triangles[v], (std::sqrt(lambda) * scales.poses[v]).asDiagonal());
        common.middleRows(v * free, free) =
            triangles[v].block(pose_size, pose_size, free, free + 1);
    }
    common.bottomLeftCorner(free, free) = (std::sqrt(lambda) * scales.camera).asDiagonal();
    const Eigen::MatrixXd reduced = triangle_of(common);
    Eigen::VectorXd step(free + pose_size * views);
    step.head(free) = reduced.topLeftCorner(free, free)
                          .triangularView<Eigen::Upper>()
                          .solve(reduced.col(free).head(free));
    for (std::size_t v = 0; v < triangles.size(); ++v) {
        const auto top = triangles[v].topRows<pose_size>();
        pose_part(step, free, v) = top.leftCols<pose_size>().triangularView<Eigen::Upper>().solve(
            top.col(pose_size + free) - top.middleCols(pose_size, free) * step.head(free));
    }
    return step;
}

// How far a step moves the weighted pixels by the linear model, times the orthogonal matrices that
// made the triangles.
Eigen::VectorXd motion_of(const std::vector<Eigen::MatrixXd>& triangles,
                          const Eigen::VectorXd& step) {
    const Eigen::Index rows = triangles.front().rows(), free = rows - pose_size - 1;
    Eigen::VectorXd motion(rows * static_cast<Eigen::Index>(triangles.size()));
    for (std::size_t v = 0; v < triangles.size(); ++v)
        motion.segment(static_cast<Eigen::Index>(v) * rows, rows) =
            triangles[v].leftCols<pose_size>() * pose_part(step, free, v) +
            triangles[v].middleCols(pose_size, free) * step.head(free);
    return motion;
}

// Their residuals, times the same matrices.
Eigen::VectorXd residuals_of(const std::vector<Eigen::MatrixXd>& triangles) {
    const Eigen::Index rows = triangles.front().rows();
    Eigen::VectorXd residuals(rows * static_cast<Eigen::Index>(triangles.size()));
    for (std::size_t v = 0; v < triangles.size(); ++v)
        residuals.segment(static_cast<Eigen::Index>(v) * rows, rows) = triangles[v].col(rows - 1);
    return residuals;
}

Eigen::Quaterniond turn_by(const Eigen::Vector3d& rotation_vector) {
    const double angle = rotation_vector.norm();
    const double half_sinc = angle > 0 ? std::sin(angle / 2) / angle : 0.5;
    Eigen::Quaterniond turn;
    turn.w() = std::cos(angle / 2);
    turn.vec() = half_sinc * rotation_vector;
    return turn;
}

Bundle moved_by(const Bundle& bundle, const Eigen::VectorXd& step, const std::vector<int>& free) {
    const Eigen::Index count = static_cast<Eigen::Index>(free.size());
    Bundle moved = bundle;
    for (Eigen::Index i = 0; i < count; ++i)
        moved.camera[free[i]] += step[i];
    for (std::size_t v = 0; v < bundle.poses.size(); ++v) {
        BundlePose& pose = moved.poses[v];
        const auto of_pose = pose_part(step, count, v);
        pose.rotation = (turn_by(of_pose.head<3>()) * pose.rotation).normalized();
        pose.translation += of_pose.tail<3>();
    }
    return moved;
}

// Squared motion of the weighted pixels below which a step is none: 1e-8 standard deviations of the
// estimate, and what rounding of the pixels does.
double least_motion(const std::vector<BundleView>& views, double cost, std::size_t free) {
    constexpr double part = 1e-8;
    const double rounding = 32 * std::numeric_limits<double>::epsilon();
    double observations = 0, pixels = 0;
    for (const BundleView& view : views) {
        observations += static_cast<double>(2 * view.pixels.cols());
        pixels += (view.pixels * view.weights.asDiagonal()).squaredNorm();
    }
    const double freedom = observations - static_cast<double>(free + pose_size * views.size());
    return part * part * cost / std::max(freedom, 1.0) + rounding * rounding * pixels;
}

// Gauss-Newton steps approach a minimum with residuals only linearly. Anderson's acceleration (J.
// ACM 12, 1965; Walker and Ni, SIAM J. Numer. Anal. 49, 2011) combines the last steps.
class Acceleration {
public:
    // The step to take in place of the plain one.
    Eigen::VectorXd step(const std::vector<Eigen::MatrixXd>& triangles,
                         const Eigen::VectorXd& plain) {
        if (last_plain_.size() == plain.size() && last_taken_.size() == plain.size())
            remember(plain - last_plain_, last_taken_);
        last_plain_ = plain;
        if (changes_.empty())
            return plain;
        const Eigen::VectorXd motion = motion_of(triangles, plain);
        Eigen::MatrixXd motions(motion.size(), static_cast<Eigen::Index>(changes_.size()));
        for (std::size_t i = 0; i < changes_.size(); ++i)
            motions.col(static_cast<Eigen::Index>(i)) = motion_of(triangles, changes_[i]);
        const Eigen::VectorXd shares = motions.colPivHouseholderQr().solve(motion);
        Eigen::VectorXd step = plain;
        for (std::size_t i = 0; i < changes_.size(); ++i)
            step -= shares[static_cast<Eigen::Index>(i)] * (taken_[i] + changes_[i]);
        return step;
    }

    void took(const Eigen::VectorXd& step) { last_taken_ = step; }
    void forget() { *this = {}; }

private:
    static constexpr std::size_t depth = 5;

    void remember(const Eigen::VectorXd& change, const Eigen::VectorXd& taken) {
        changes_.push_back(change);
        taken_.push_back(taken);
        if (changes_.size() > depth) {
            changes_.erase(changes_.begin());
            taken_.erase(taken_.begin());
        }
    }

    Eigen::VectorXd last_plain_, last_taken_;
    std::vector<Eigen::VectorXd> changes_, taken_;  // of the plain step; the step between
};

class Minimiser {
public:
    Minimiser(const std::vector<BundleView>& views, const BundleOptions& options)
        : views_(views), options_(options) {}

    // One iteration; false when it was the last.
    bool improve(BundleSolution& at) {
        const std::vector<Eigen::MatrixXd> triangles = linearised(at.bundle);
        const Scales scales = scales_of(triangles);
        const Eigen::VectorXd plain = solve(triangles, scales, 0.0);
        if (plain.allFinite()) {
            const double motion = motion_of(triangles, plain).squaredNorm();
            at.converged = motion <= least_motion(views_, at.cost, options_.free.size());
            const Eigen::VectorXd faster = acceleration_.step(triangles, plain);
            if (!at.converged && take(at, faster, motion))
                return true;
            if (take(at, plain, motion) || at.converged)
                return !at.converged;
        }
        return improve_damped(at, triangles, scales);
    }

private:
    static constexpr double min_lambda = 1e-6, max_lambda = 1e12;

    bool improve_damped(BundleSolution& at, const std::vector<Eigen::MatrixXd>& triangles,
                        const Scales& scales) {
        acceleration_.forget();
        for (; lambda_ < max_lambda; lambda_ *= 10) {
            const Eigen::VectorXd step = solve(triangles, scales, lambda_);
            const Eigen::VectorXd motion = motion_of(triangles, step);
            const double promised = 2 * residuals_of(triangles).dot(motion) - motion.squaredNorm();
            if (take(at, step, promised)) {
                lambda_ = std::max(min_lambda, lambda_ / 10);
                return true;
            }
        }
        return false;
    }

    // Takes a step that brings a quarter of the promised decrease. Below its own rounding nothing
    // can be told from the cost, and the step is taken as it is.
    bool take(BundleSolution& at, const Eigen::VectorXd& step, double promised) {
        constexpr double min_gain = 0.25, told = 1e3 * std::numeric_limits<double>::epsilon();
        const Bundle moved = moved_by(at.bundle, step, options_.free);
        const auto cost = bundle_cost(views_, moved, options_);
        if (!cost || (promised > told * at.cost && !(at.cost - *cost > min_gain * promised)))
            return false;
        at.bundle = moved;
        at.cost = *cost;
        acceleration_.took(step);
        return true;
    }

    std::vector<Eigen::MatrixXd> linearised(const Bundle& bundle) const {
        const PixelModel<double> model = bundle.model();
        std::vector<Eigen::MatrixXd> triangles;
        for (std::size_t v = 0; v < views_.size(); ++v) {
            const Eigen::MatrixXd rows = view_rows(views_[v], model, bundle.poses[v], options_);
            triangles.push_back(
                bundle.projection.kind == Projection::telecentric
                    ? with_pose_rows(rows, curvature_of_tilt(views_[v], bundle.poses[v], rows))
                    : triangle_of(rows));
        }
        return triangles;
    }

    const std::vector<BundleView>& views_;
    const BundleOptions& options_;
    Acceleration acceleration_;
    double lambda_ = 1e-4;
};

}  // namespace

BundleView bundle_view(const CalibrationView& view) {
    const Eigen::Index points = static_cast<Eigen::Index>(view.points_mm.size());
    BundleView result;
    result.centre_mm.setZero();
    for (const Eigen::Vector3d& point : view.points_mm)
        result.centre_mm += point / static_cast<double>(points);
    result.points_mm.resize(3, points);
    result.pixels.resize(2, points);
    result.weights.resize(points);
    for (Eigen::Index i = 0; i < points; ++i) {
        result.points_mm.col(i) = view.true_point_mm(i) - result.centre_mm;
        result.pixels.col(i) = view.pixels[i];
        result.weights[i] = 1 / static_cast<double>(view.sigma(i));
    }
    return result;
}

std::vector<BundleView> bundle_views(std::span<const CalibrationView> views) {
    std::vector<BundleView> all;
    for (const CalibrationView& view : views)
        all.push_back(bundle_view(view));
    return all;
}

Bundle bundle_of(const CameraModel& camera, std::span<const Rigid> camera_from_target,
                 const std::vector<BundleView>& views) {
    Bundle bundle{camera.projection, all_parameters(camera), {}};
    for (std::size_t i = 0; i < views.size(); ++i)
        bundle.poses.push_back(bundle_pose(camera_from_target[i], views[i].centre_mm));
    return bundle;
}

std::vector<Rigid> poses_of(const Bundle& bundle, const std::vector<BundleView>& views) {
    std::vector<Rigid> poses;
    for (std::size_t i = 0; i < views.size(); ++i)
        poses.push_back(rigid_from(bundle.poses[i], views[i].centre_mm));
    return poses;
}

CameraFit fit_from(const BundleSolution& solution, const CalibrationModel& model,
                   std::span<const CalibrationView> views,
                   const std::vector<BundleView>& bundle_views, CameraModel camera) {
    set_all_parameters(camera, solution.bundle.camera);
    camera.covariance.reset();
    CameraFit fit{model, camera, poses_of(solution.bundle, bundle_views)};
    for (std::size_t i = 0; i < views.size(); ++i)
        fit.residuals_px.push_back(view_residuals(camera, fit.camera_from_target[i], views[i]));
    fit.iterations = solution.iterations;
    fit.converged = solution.converged;
    return fit;
}

BundlePose bundle_pose(const Rigid& camera_from_target, const Eigen::Vector3d& centre_mm) {
    const Eigen::Quaterniond rotation = camera_from_target.rotation.normalized();
    return {rotation, rotation * centre_mm + camera_from_target.translation};
}

Rigid rigid_from(const BundlePose& pose, const Eigen::Vector3d& centre_mm) {
    const Eigen::Vector3d translation = pose.translation - pose.rotation * centre_mm;
    return {pose.rotation, translation};
}

std::optional<double> bundle_cost(const std::vector<BundleView>& views, const Bundle& bundle,
                                  const BundleOptions& options) {
    const PixelModel<double> model = bundle.model();
    double total = 0;
    for (std::size_t v = 0; v < views.size(); ++v) {
        const auto cost = view_cost(views[v], model, bundle.poses[v], options.huber);
        if (!cost)
            return std::nullopt;
        total += *cost;
    }
    for (const Eigen::Index column : pulled(options)) {
        const int index = options.free[column];
        const double row = options.pull[index] * bundle.camera[index];
        total += static_cast<double>(views.size()) * row * row;
    }
    return total;
}

std::optional<BundleSolution> adjust_bundle(const std::vector<BundleView>& views,
                                            const Bundle& start, const BundleOptions& options) {
    const auto cost = bundle_cost(views, start, options);
    if (!cost)
        return std::nullopt;
    BundleSolution solution{start, *cost, 0, false};
    Minimiser minimiser(views, options);
    do
        ++solution.iterations;
    while (minimiser.improve(solution) && solution.iterations < options.most_iterations);
    return solution;
}

Eigen::Matrix<double, 2, pose_size> pose_jacobian(const Eigen::Matrix<double, 2, 3>& of_point,
                                                  const Eigen::Vector3d& turned) {
    Eigen::Matrix<double, 2, pose_size> jacobian;
    jacobian << of_point * -cross_matrix(turned), of_point;
    return jacobian;
}

Eigen::MatrixXd view_triangle(const BundleView& view, const PixelModel<double>& model,
                              const BundlePose& pose, const BundleOptions& options) {
    return triangle_of(view_rows(view, model, pose, options));
}

}  // namespace etalon
