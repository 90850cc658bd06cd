#include "calib/intrinsics/bundle_adjustment.h"

#include <Eigen/QR>
#include <limits>

#include "calib/camera/pixel_model.h"

namespace etalon {
namespace {

constexpr int pose_size = 6;

template <typename Scalar>
using Matrix = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;
template <typename Scalar>
using Vector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;
template <typename Scalar>
using Vector2 = Eigen::Matrix<Scalar, 2, 1>;
template <typename Scalar>
using Vector3 = Eigen::Matrix<Scalar, 3, 1>;

// A step is one vector: the changes of the free parameters, then of each pose.
template <typename Scalar>
auto pose_part(Vector<Scalar>& step, Eigen::Index free, std::size_t view) {
    return step.template segment<pose_size>(free + pose_size * static_cast<Eigen::Index>(view));
}
template <typename Scalar>
auto pose_part(const Vector<Scalar>& step, Eigen::Index free, std::size_t view) {
    return step.template segment<pose_size>(free + pose_size * static_cast<Eigen::Index>(view));
}

// The upper triangle after QR, with zeros below; as many rows as columns.
template <typename Scalar>
Matrix<Scalar> triangle_of(const Matrix<Scalar>& matrix) {
    const Eigen::Index size = matrix.cols();
    if (matrix.rows() < size) {
        Matrix<Scalar> padded = Matrix<Scalar>::Zero(size, size);
        padded.topRows(matrix.rows()) = matrix;
        return triangle_of(padded);
    }
    const Eigen::HouseholderQR<Matrix<Scalar>> qr(matrix);
    return qr.matrixQR().topRows(size).template triangularView<Eigen::Upper>();
}

// What the pixels do not depend on at all, at first order, stays as it is: the distance from a
// telecentric camera, and the tilt of a plane that it sees flat on. One more row for each holds it;
// elimination would otherwise use up a row of the view for a column of zeros.
template <typename Scalar>
void hold_what_has_no_effect(Matrix<Scalar>& rows) {
    for (Eigen::Index k = 0; k < pose_size; ++k) {
        if ((rows.col(k).array() != Scalar(0)).any())
            continue;
        rows.conservativeResize(rows.rows() + 1, Eigen::NoChange);
        rows.row(rows.rows() - 1).setZero();
        rows(rows.rows() - 1, k) = 1;
    }
}

template <typename Scalar>
Scalar huber_cost(Scalar distance, double threshold) {
    if (threshold == 0.0 || distance <= threshold)
        return distance * distance;
    return threshold * (2 * distance - threshold);
}

// The square root of the weight with which squares stand in for Huber's function.
template <typename Scalar>
Scalar huber_weight(Scalar distance, double threshold) {
    using std::sqrt;
    return threshold == 0.0 || distance <= threshold ? Scalar(1) : sqrt(threshold / distance);
}

// Nothing where the model is not regular.
template <typename Scalar>
std::optional<Scalar> view_cost(const BundleView<Scalar>& view, const PixelModel<Scalar>& model,
                                const BundlePose<Scalar>& pose, double huber) {
    const Eigen::Matrix<Scalar, 3, 3> rotation = pose.rotation.toRotationMatrix();
    Scalar cost = 0;
    for (Eigen::Index i = 0; i < view.points_mm.cols(); ++i) {
        const Vector3<Scalar> p = rotation * view.points_mm.col(i) + pose.translation;
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

// d pixel / d left perturbation of the pose, of a point at `turned` + translation, of d pixel / d
// that point.
template <typename Scalar>
Eigen::Matrix<Scalar, 2, pose_size> pose_jacobian(const Eigen::Matrix<Scalar, 2, 3>& of_point,
                                                  const Vector3<Scalar>& turned) {
    Eigen::Matrix<Scalar, 3, 3> of_turn;
    of_turn << 0, turned.z(), -turned.y(), -turned.z(), 0, turned.x(), turned.y(), -turned.x(), 0;
    Eigen::Matrix<Scalar, 2, pose_size> jacobian;
    jacobian << of_point * of_turn, of_point;
    return jacobian;
}

// Lengths of the Jacobian's columns: damping is relative to them.
template <typename Scalar>
struct Scales {
    Vector<Scalar> camera;
    std::vector<Eigen::Matrix<Scalar, pose_size, 1>> poses;
};

template <typename Scalar>
Scales<Scalar> scales_of(const std::vector<Matrix<Scalar>>& triangles) {
    const Eigen::Index free = triangles.front().cols() - pose_size - 1;
    Scales<Scalar> scales{Vector<Scalar>::Zero(free), {}};
    const auto or_one = [](Scalar length) { return length > 0 ? length : Scalar(1); };
    for (const Matrix<Scalar>& triangle : triangles) {
        const Vector<Scalar> lengths = triangle.colwise().norm().transpose();
        scales.camera += lengths.segment(pose_size, free).cwiseAbs2();
        scales.poses.push_back(lengths.template head<pose_size>().unaryExpr(or_one));
    }
    scales.camera = scales.camera.cwiseSqrt().unaryExpr(or_one).eval();
    return scales;
}

template <typename Scalar>
Matrix<Scalar> with_damped_pose(const Matrix<Scalar>& triangle,
                                const Eigen::Matrix<Scalar, pose_size, 1>& damping) {
    Matrix<Scalar> stack = Matrix<Scalar>::Zero(triangle.rows() + pose_size, triangle.cols());
    stack.topRows(triangle.rows()) = triangle;
    stack.bottomLeftCorner(pose_size, pose_size) = damping.asDiagonal();
    return triangle_of(stack);
}

// The least-squares step with the rows sqrt(lambda) * scale added below the Jacobian.
template <typename Scalar>
Vector<Scalar> solve(std::vector<Matrix<Scalar>> triangles, const Scales<Scalar>& scales,
                     Scalar lambda) {
    using std::sqrt;
    const Eigen::Index free = scales.camera.size();
    const Eigen::Index views = static_cast<Eigen::Index>(triangles.size());
    Matrix<Scalar> common = Matrix<Scalar>::Zero((views + 1) * free, free + 1);
    for (Eigen::Index v = 0; v < views; ++v) {
        if (lambda > 0)
            triangles[v] = with_damped_pose<Scalar>(triangles[v], sqrt(lambda) * scales.poses[v]);
        common.middleRows(v * free, free) =
            triangles[v].block(pose_size, pose_size, free, free + 1);
    }
    common.bottomLeftCorner(free, free) = (sqrt(lambda) * scales.camera).asDiagonal();
    const Matrix<Scalar> reduced = triangle_of(common);
    Vector<Scalar> step(free + pose_size * views);
    step.head(free) = reduced.topLeftCorner(free, free)
                          .template triangularView<Eigen::Upper>()
                          .solve(reduced.col(free).head(free));
    for (std::size_t v = 0; v < triangles.size(); ++v) {
        const auto top = triangles[v].template topRows<pose_size>();
        pose_part(step, free, v) =
            top.template leftCols<pose_size>().template triangularView<Eigen::Upper>().solve(
                top.col(pose_size + free) - top.middleCols(pose_size, free) * step.head(free));
    }
    return step;
}

// How far a step moves the weighted pixels by the linear model, and their residuals, both times the
// orthogonal matrices that made the triangles.
template <typename Scalar>
Vector<Scalar> motion_of(const std::vector<Matrix<Scalar>>& triangles, const Vector<Scalar>& step) {
    const Eigen::Index rows = triangles.front().rows(), free = rows - pose_size - 1;
    Vector<Scalar> motion(rows * static_cast<Eigen::Index>(triangles.size()));
    for (std::size_t v = 0; v < triangles.size(); ++v)
        motion.segment(static_cast<Eigen::Index>(v) * rows, rows) =
            triangles[v].template leftCols<pose_size>() * pose_part(step, free, v) +
            triangles[v].middleCols(pose_size, free) * step.head(free);
    return motion;
}
template <typename Scalar>
Vector<Scalar> residuals_of(const std::vector<Matrix<Scalar>>& triangles) {
    const Eigen::Index rows = triangles.front().rows();
    Vector<Scalar> residuals(rows * static_cast<Eigen::Index>(triangles.size()));
    for (std::size_t v = 0; v < triangles.size(); ++v)
        residuals.segment(static_cast<Eigen::Index>(v) * rows, rows) = triangles[v].col(rows - 1);
    return residuals;
}

template <typename Scalar>
Eigen::Quaternion<Scalar> turn_by(const Vector3<Scalar>& rotation_vector) {
    using std::sin, std::cos;
    const Scalar angle = rotation_vector.norm();
    const Scalar half_sinc = angle > 0 ? sin(angle / 2) / angle : Scalar(0.5);
    Eigen::Quaternion<Scalar> turn;
    turn.w() = cos(angle / 2);
    turn.vec() = half_sinc * rotation_vector;
    return turn;
}

template <typename Scalar>
Bundle<Scalar> moved_by(const Bundle<Scalar>& bundle, const Vector<Scalar>& step,
                        const std::vector<int>& free) {
    const Eigen::Index count = static_cast<Eigen::Index>(free.size());
    Bundle<Scalar> moved = bundle;
    for (Eigen::Index i = 0; i < count; ++i)
        moved.camera[free[i]] += step[i];
    for (std::size_t v = 0; v < bundle.poses.size(); ++v) {
        BundlePose<Scalar>& pose = moved.poses[v];
        const auto of_pose = pose_part(step, count, v);
        pose.rotation = (turn_by<Scalar>(of_pose.template head<3>()) * pose.rotation).normalized();
        pose.translation += of_pose.template tail<3>();
    }
    return moved;
}

// Squared motion of the weighted pixels below which a step is none: 1e-8 standard deviations of the
// estimate, and what rounding of the pixels does.
template <typename Scalar>
Scalar least_motion(const std::vector<BundleView<Scalar>>& views, Scalar cost, std::size_t free) {
    constexpr Scalar part = 1e-8;
    const Scalar rounding = 32 * std::numeric_limits<Scalar>::epsilon();
    Scalar observations = 0, pixels = 0;
    for (const BundleView<Scalar>& view : views) {
        observations += static_cast<Scalar>(2 * view.pixels.cols());
        pixels += (view.pixels * view.weights.asDiagonal()).squaredNorm();
    }
    const Scalar freedom = observations - static_cast<Scalar>(free + pose_size * views.size());
    return part * part * cost / std::max(freedom, Scalar(1)) + rounding * rounding * pixels;
}

// Gauss-Newton steps approach a minimum with residuals only linearly, slowly where the model bends
// within its uncertainty. Anderson's acceleration (J. ACM 12, 1965) takes the combination of the
// last steps that the pixels would least notice; Walker and Ni (SIAM J. Numer. Anal. 49, 2011).
template <typename Scalar>
class Acceleration {
public:
    // The step to take in place of the plain one.
    Vector<Scalar> step(const std::vector<Matrix<Scalar>>& triangles, const Vector<Scalar>& plain) {
        if (last_plain_.size() == plain.size() && last_taken_.size() == plain.size())
            remember(plain - last_plain_, last_taken_);
        last_plain_ = plain;
        if (changes_.empty())
            return plain;
        const Vector<Scalar> motion = motion_of(triangles, plain);
        Matrix<Scalar> motions(motion.size(), static_cast<Eigen::Index>(changes_.size()));
        for (std::size_t i = 0; i < changes_.size(); ++i)
            motions.col(static_cast<Eigen::Index>(i)) = motion_of(triangles, changes_[i]);
        const Vector<Scalar> shares = motions.colPivHouseholderQr().solve(motion);
        Vector<Scalar> step = plain;
        for (std::size_t i = 0; i < changes_.size(); ++i)
            step -= shares[static_cast<Eigen::Index>(i)] * (taken_[i] + changes_[i]);
        return step;
    }

    void took(const Vector<Scalar>& step) { last_taken_ = step; }
    void forget() { *this = {}; }

private:
    static constexpr std::size_t depth = 5;

    void remember(const Vector<Scalar>& change, const Vector<Scalar>& taken) {
        changes_.push_back(change);
        taken_.push_back(taken);
        if (changes_.size() > depth) {
            changes_.erase(changes_.begin());
            taken_.erase(taken_.begin());
        }
    }

    Vector<Scalar> last_plain_, last_taken_;
    std::vector<Vector<Scalar>> changes_, taken_;  // of the plain step; the step between
};

template <typename Scalar>
class Minimiser {
public:
    Minimiser(const std::vector<BundleView<Scalar>>& views, const BundleOptions& options)
        : views_(views), options_(options) {}

    // One iteration; false when it was the last.
    bool improve(BundleSolution<Scalar>& at) {
        const std::vector<Matrix<Scalar>> triangles = linearised(at.bundle);
        const Scales<Scalar> scales = scales_of(triangles);
        const Vector<Scalar> plain = solve(triangles, scales, Scalar(0));
        if (plain.allFinite()) {
            const Scalar motion = motion_of(triangles, plain).squaredNorm();
            at.converged = motion <= least_motion(views_, at.cost, options_.free.size());
            const Vector<Scalar> faster = acceleration_.step(triangles, plain);
            if (!at.converged && take(at, faster, motion))
                return true;
            if (take(at, plain, motion) || at.converged)
                return !at.converged;
        }
        return improve_damped(at, triangles, scales);
    }

private:
    static constexpr Scalar min_lambda = 1e-6, max_lambda = 1e12;

    bool improve_damped(BundleSolution<Scalar>& at, const std::vector<Matrix<Scalar>>& triangles,
                        const Scales<Scalar>& scales) {
        acceleration_.forget();
        for (; lambda_ < max_lambda; lambda_ *= 10) {
            const Vector<Scalar> step = solve(triangles, scales, lambda_);
            const Vector<Scalar> motion = motion_of(triangles, step);
            const Scalar promised = 2 * residuals_of(triangles).dot(motion) - motion.squaredNorm();
            if (take(at, step, promised)) {
                lambda_ = std::max(min_lambda, lambda_ / 10);
                return true;
            }
        }
        return false;
    }

    // Takes a step that brings a quarter of the promised decrease. Below its own rounding nothing
    // can be told from the cost, and the step is taken as it is.
    bool take(BundleSolution<Scalar>& at, const Vector<Scalar>& step, Scalar promised) {
        constexpr Scalar min_gain = 0.25, told = 1e3 * std::numeric_limits<Scalar>::epsilon();
        const Bundle<Scalar> moved = moved_by(at.bundle, step, options_.free);
        const auto cost = bundle_cost(views_, moved, options_);
        if (!cost || (promised > told * at.cost && !(at.cost - *cost > min_gain * promised)))
            return false;
        at.bundle = moved;
        at.cost = *cost;
        acceleration_.took(step);
        return true;
    }

    std::vector<Matrix<Scalar>> linearised(const Bundle<Scalar>& bundle) const {
        const PixelModel<Scalar> model = bundle.model();
        std::vector<Matrix<Scalar>> triangles;
        for (std::size_t v = 0; v < views_.size(); ++v)
            triangles.push_back(view_triangle(views_[v], model, bundle.poses[v], options_));
        return triangles;
    }

    const std::vector<BundleView<Scalar>>& views_;
    const BundleOptions& options_;
    Acceleration<Scalar> acceleration_;
    Scalar lambda_ = 1e-4;
};

}  // namespace

template <typename Scalar>
BundleView<Scalar> bundle_view(const CalibrationView& view) {
    const Eigen::Index points = static_cast<Eigen::Index>(view.points_mm.size());
    BundleView<Scalar> result;
    result.centre_mm.setZero();
    for (const Eigen::Vector3d& point : view.points_mm)
        result.centre_mm += point / static_cast<double>(points);
    result.points_mm.resize(3, points);
    result.pixels.resize(2, points);
    result.weights.resize(points);
    for (Eigen::Index i = 0; i < points; ++i) {
        result.points_mm.col(i) =
            view.true_point_mm(i).cast<Scalar>() - result.centre_mm.template cast<Scalar>();
        result.pixels.col(i) = view.pixels[i].cast<Scalar>();
        result.weights[i] = 1 / static_cast<Scalar>(view.sigma(i));
    }
    return result;
}

template <typename Scalar>
BundlePose<Scalar> bundle_pose(const Rigid& camera_from_target, const Eigen::Vector3d& centre_mm) {
    const Eigen::Quaternion<Scalar> rotation =
        camera_from_target.rotation.cast<Scalar>().normalized();
    return {rotation,
            rotation * centre_mm.cast<Scalar>() + camera_from_target.translation.cast<Scalar>()};
}

template <typename Scalar>
Rigid rigid_from(const BundlePose<Scalar>& pose, const Eigen::Vector3d& centre_mm) {
    const Vector3<Scalar> translation = pose.translation - pose.rotation * centre_mm.cast<Scalar>();
    return {pose.rotation.template cast<double>(), translation.template cast<double>()};
}

template <typename Scalar>
std::optional<Scalar> bundle_cost(const std::vector<BundleView<Scalar>>& views,
                                  const Bundle<Scalar>& bundle, const BundleOptions& options) {
    const PixelModel<Scalar> model = bundle.model();
    Scalar total = 0;
    for (std::size_t v = 0; v < views.size(); ++v) {
        const auto cost = view_cost(views[v], model, bundle.poses[v], options.huber);
        if (!cost)
            return std::nullopt;
        total += *cost;
    }
    for (const Eigen::Index column : pulled(options)) {
        const int index = options.free[column];
        const Scalar row = options.pull[index] * bundle.camera[index];
        total += static_cast<Scalar>(views.size()) * row * row;
    }
    return total;
}

template <typename Scalar>
std::optional<BundleSolution<Scalar>> adjust_bundle(const std::vector<BundleView<Scalar>>& views,
                                                    const Bundle<Scalar>& start,
                                                    const BundleOptions& options) {
    const auto cost = bundle_cost(views, start, options);
    if (!cost)
        return std::nullopt;
    BundleSolution<Scalar> solution{start, *cost, 0, false};
    Minimiser<Scalar> minimiser(views, options);
    do
        ++solution.iterations;
    while (minimiser.improve(solution) && solution.iterations < options.most_iterations);
    return solution;
}

template <typename Scalar>
Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic> view_triangle(const BundleView<Scalar>& view,
                                                                    const PixelModel<Scalar>& model,
                                                                    const BundlePose<Scalar>& pose,
                                                                    const BundleOptions& options) {
    const Eigen::Index points = view.points_mm.cols();
    const Eigen::Index free = static_cast<Eigen::Index>(options.free.size());
    const Eigen::Matrix<Scalar, 3, 3> rotation = pose.rotation.toRotationMatrix();
    typename PixelModel<Scalar>::OfParameters of_parameters;
    const std::vector<Eigen::Index> held = pulled(options);
    Matrix<Scalar> rows = Matrix<Scalar>::Zero(2 * points + std::ssize(held), pose_size + free + 1);
    for (Eigen::Index i = 0; i < points; ++i) {
        const Vector3<Scalar> turned = rotation * view.points_mm.col(i);
        const Vector3<Scalar> p = turned + pose.translation;
        const auto seen = model.with_derivatives(p, of_parameters);
        const Vector2<Scalar> residual = view.weights[i] * (view.pixels.col(i) - seen.pixel);
        const Scalar huber = huber_weight(residual.norm(), options.huber);
        const Scalar weight = huber * view.weights[i];
        auto of_point = rows.template middleRows<2>(2 * i);
        of_point.template leftCols<pose_size>() = weight * pose_jacobian<Scalar>(seen.of, turned);
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
    return triangle_of(rows);
}

#define ETALON_INSTANTIATE(Scalar)                                                            \
    template BundleView<Scalar> bundle_view(const CalibrationView&);                          \
    template BundlePose<Scalar> bundle_pose(const Rigid&, const Eigen::Vector3d&);            \
    template Rigid rigid_from(const BundlePose<Scalar>&, const Eigen::Vector3d&);             \
    template std::optional<Scalar> bundle_cost(const std::vector<BundleView<Scalar>>&,        \
                                               const Bundle<Scalar>&, const BundleOptions&);  \
    template std::optional<BundleSolution<Scalar>> adjust_bundle(                             \
        const std::vector<BundleView<Scalar>>&, const Bundle<Scalar>&, const BundleOptions&); \
    template Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic> view_triangle(             \
        const BundleView<Scalar>&, const PixelModel<Scalar>&, const BundlePose<Scalar>&,      \
        const BundleOptions&);

ETALON_INSTANTIATE(double)
ETALON_INSTANTIATE(long double)

}  // namespace etalon
