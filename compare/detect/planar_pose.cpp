// Pose of a planar target: the two closed-form solutions (Collins and Bartoli, "Infinitesimal
// plane-based pose estimation", IJCV 2014, through OpenCV) on undistorted points, each refined on
// the pixels themselves by Levenberg and Marquardt's method with the projector's own Jacobian.
//
// solvePnPGeneric's IPPE takes any point order; IPPE_SQUARE would silently return Z = 0 for an
// order that is not its own, and gains nothing over it.
#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <limits>
#include <opencv2/calib3d.hpp>

#include "compare/detect/detector.h"

namespace etalon {
namespace {

using Points = std::vector<Eigen::Vector3d>;
using Pixels = std::vector<Eigen::Vector2d>;

constexpr double infinity = std::numeric_limits<double>::infinity();

template <class Vectors>
bool all_finite(const Vectors& vectors) {
    return std::all_of(vectors.begin(), vectors.end(), [](const auto& v) { return v.allFinite(); });
}

// Spread of the points along their principal axes, largest first, mm.
Eigen::Vector3d principal_spreads(const Points& points) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& point : points)
        mean += point / static_cast<double>(points.size());
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (const Eigen::Vector3d& point : points)
        scatter += (point - mean) * (point - mean).transpose() / static_cast<double>(points.size());
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter, Eigen::EigenvaluesOnly);
    return solver.eigenvalues().reverse().cwiseMax(0.0).cwiseSqrt();
}

// In a plane, and not on a line. Spreads come from squares, so rounding alone reaches 1e-8.
bool span_a_plane(const Points& points) {
    const Eigen::Vector3d spread = principal_spreads(points);
    return spread[0] > 0 && spread[1] > 1e-4 * spread[0] && spread[2] < 1e-6 * spread[0];
}

// The closed-form solutions; empty when a pixel has no ray or the library gives up.
std::vector<Rigid> closed_form_poses(const Projector& projector, const Points& points,
                                     const Pixels& pixels) {
    std::vector<cv::Point3d> object;
    std::vector<cv::Point2d> image;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const auto ray = projector.unproject(pixels[i]);
        if (!ray)
            return {};
        object.emplace_back(points[i].x(), points[i].y(), points[i].z());
        image.emplace_back(ray->x(), ray->y());
    }
    std::vector<cv::Mat> rotations, translations;
    try {
        cv::solvePnPGeneric(object, image, cv::Matx33d::eye(), cv::noArray(), rotations,
                            translations, false, cv::SOLVEPNP_IPPE);
    } catch (const cv::Exception&) {
        return {};  // its own checks of a homography without rank
    }
    std::vector<Rigid> poses;
    for (std::size_t i = 0; i < rotations.size(); ++i) {
        const cv::Mat &r = rotations[i], &t = translations[i];
        Vector6d pose;
        pose << r.at<double>(0), r.at<double>(1), r.at<double>(2), t.at<double>(0), t.at<double>(1),
            t.at<double>(2);
        if (pose.allFinite())
            poses.push_back(rigid_from_vector(pose));
    }
    return poses;
}

// Normal equations of the pixel residuals for a left perturbation of the pose.
struct Linearised {
    Matrix6d information = Matrix6d::Zero();  // J^T J
    Vector6d gradient = Vector6d::Zero();     // J^T r
    double cost = infinity;                   // sum of squares, px^2; infinite: a point is unseen
};

Linearised linearise(const Projector& projector, const Points& points, const Pixels& pixels,
                     const Rigid& camera_from_marker) {
    Linearised result;
    double cost = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const Eigen::Vector3d arm = camera_from_marker.rotation * points[i];
        const auto seen = projector.project_with_jacobian(arm + camera_from_marker.translation);
        if (!seen)
            return {};
        Eigen::Matrix3d minus_cross;  // -[arm]_x: d (Exp(d) arm) / d d at 0
        minus_cross << 0, arm.z(), -arm.y(), -arm.z(), 0, arm.x(), arm.y(), -arm.x(), 0;
        Eigen::Matrix<double, 2, 6> jacobian;
        jacobian << seen->jacobian * minus_cross, seen->jacobian;
        const Eigen::Vector2d residual = seen->pixel - pixels[i];
        result.information += jacobian.transpose() * jacobian;
        result.gradient += jacobian.transpose() * residual;
        cost += residual.squaredNorm();
    }
    if (std::isfinite(cost))
        result.cost = cost;
    return result;
}

struct Refined {
    Rigid camera_from_marker;
    Linearised at;
};

Vector6d damped_step(const Linearised& at, double damping) {
    Matrix6d damped = at.information;
    damped.diagonal() *= 1.0 + damping;
    return -damped.ldlt().solve(at.gradient);
}

// Where a step leads; nothing when it is not finite or a point is not seen from there.
std::optional<Refined> moved(const Projector& projector, const Points& points, const Pixels& pixels,
                             const Rigid& from, const Vector6d& delta) {
    if (!delta.allFinite())
        return std::nullopt;
    const Rigid there = left_perturbed(from, delta);
    Refined state{there, linearise(projector, points, pixels, there)};
    return state.at.cost < infinity ? std::optional(state) : std::nullopt;
}

// Levenberg and Marquardt's method until a step promises less than 1e-14 of the cost, or none
// lowers it any more. Such a last step is taken in full and unseen: what it does to the cost is
// lost in rounding, but not what it does to the pose, which so does not depend on the start.
// Nothing when a point cannot be seen from the start.
std::optional<Refined> refine(const Projector& projector, const Points& points,
                              const Pixels& pixels, const Rigid& start) {
    constexpr int max_iterations = 200;
    constexpr double max_damping = 1e8;
    Refined state{start, linearise(projector, points, pixels, start)};
    if (state.at.cost == infinity)
        return std::nullopt;
    double damping = 1e-4;
    for (int i = 0; i < max_iterations && damping < max_damping; ++i) {
        const Vector6d delta = damped_step(state.at, damping);
        const bool is_last = -state.at.gradient.dot(delta) <= 1e-14 * state.at.cost;
        const auto next = moved(projector, points, pixels, state.camera_from_marker,
                                is_last ? damped_step(state.at, 0.0) : delta);
        const bool is_better = next && next->at.cost < state.at.cost;
        if (next && (is_last || is_better))
            state = *next;
        if (is_last)
            break;
        damping = is_better ? std::max(damping * 0.1, 1e-12) : damping * 10.0;
    }
    return state;
}

// (J^T J)^-1 with rows and columns scaled to unit diagonal first, so that rad and mm compare;
// nothing when a direction is unseen.
std::optional<Matrix6d> covariance_per_px2(const Matrix6d& information) {
    const Vector6d diagonal = information.diagonal();
    if (!diagonal.allFinite() || !(diagonal.array() > 0).all())
        return std::nullopt;
    const Vector6d scale = diagonal.cwiseSqrt().cwiseInverse();
    const Matrix6d scaled = scale.asDiagonal() * information * scale.asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(scaled);
    if (solver.info() != Eigen::Success || solver.eigenvalues()[0] < 1e-12)
        return std::nullopt;
    const Matrix6d inverse = solver.eigenvectors() *
                             solver.eigenvalues().cwiseInverse().asDiagonal() *
                             solver.eigenvectors().transpose();
    return scale.asDiagonal() * inverse * scale.asDiagonal();
}

bool usable(const Points& points_mm, const Pixels& pixels) {
    return points_mm.size() >= 4 && pixels.size() == points_mm.size() && all_finite(points_mm) &&
           all_finite(pixels) && span_a_plane(points_mm);
}

double rms_px(const Refined& pose, const Points& points) {
    return std::sqrt(pose.at.cost / static_cast<double>(points.size()));
}

// Without the other solution.
std::optional<PoseEstimate> estimate_of(const Refined& pose, const Points& points) {
    const auto covariance = covariance_per_px2(pose.at.information);
    if (!covariance)
        return std::nullopt;
    return PoseEstimate{pose.camera_from_marker, rms_px(pose, points), {}, 0.0, *covariance};
}

// Both starts can end in one minimum, for instance with strong perspective.
bool same_pose(const Rigid& a, const Rigid& b) {
    const Vector6d delta = left_difference(a, b);
    return delta.head<3>().norm() < 1e-6 &&
           delta.tail<3>().norm() < 1e-6 * (1.0 + a.translation.norm());
}

}  // namespace

std::optional<PoseEstimate> estimate_pose(const Projector& projector, const Points& points_mm,
                                          const Pixels& pixels) {
    require_perspective(projector.camera(), "estimating a marker's pose");
    if (!usable(points_mm, pixels))
        return std::nullopt;
    std::vector<Refined> found;
    for (const Rigid& start : closed_form_poses(projector, points_mm, pixels))
        if (const auto refined = refine(projector, points_mm, pixels, start))
            found.push_back(*refined);
    std::stable_sort(found.begin(), found.end(),
                     [](const Refined& a, const Refined& b) { return a.at.cost < b.at.cost; });
    if (found.empty())
        return std::nullopt;

    std::optional<PoseEstimate> estimate = estimate_of(found[0], points_mm);
    if (estimate && found.size() > 1 &&
        !same_pose(found[0].camera_from_marker, found[1].camera_from_marker)) {
        estimate->alternative = found[1].camera_from_marker;
        estimate->alternative_rms_px = rms_px(found[1], points_mm);
    }
    return estimate;
}

std::optional<PoseEstimate> estimate_pose_near(const Projector& projector, const Points& points_mm,
                                               const Pixels& pixels, const Rigid& start) {
    require_perspective(projector.camera(), "estimating a marker's pose");
    if (!usable(points_mm, pixels))
        return std::nullopt;
    const auto refined = refine(projector, points_mm, pixels, start);
    return refined ? estimate_of(*refined, points_mm) : std::nullopt;
}

}  // namespace etalon
