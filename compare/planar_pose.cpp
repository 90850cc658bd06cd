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

#include "compare/detector.h"

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

// One damped step; true if the cost went down.
bool step(const Projector& projector, const Points& points, const Pixels& pixels, double damping,
          Refined& state) {
    Matrix6d damped = state.at.information;
    damped.diagonal() *= 1.0 + damping;
    const Vector6d delta = -damped.ldlt().solve(state.at.gradient);
    if (!delta.allFinite())
        return false;
    const Rigid candidate = left_perturbed(state.camera_from_marker, delta);
    const Linearised there = linearise(projector, points, pixels, candidate);
    if (!(there.cost < state.at.cost))
        return false;
    state = {candidate, there};
    return true;
}

// Levenberg and Marquardt's method until no step lowers the cost any more (to rounding) or the
// gain is below 1e-14 of it. Nothing when a point cannot be seen from the start.
std::optional<Refined> refine(const Projector& projector, const Points& points,
                              const Pixels& pixels, const Rigid& start) {
    constexpr int max_iterations = 200;
    constexpr double max_damping = 1e8;
    Refined state{start, linearise(projector, points, pixels, start)};
    if (state.at.cost == infinity)
        return std::nullopt;
    double damping = 1e-4;
    for (int i = 0; i < max_iterations && damping < max_damping; ++i) {
        const double before = state.at.cost;
        if (!step(projector, points, pixels, damping, state)) {
            damping *= 10.0;
            continue;
        }
        damping = std::max(damping * 0.1, 1e-12);
        if (before - state.at.cost <= 1e-14 * before)
            break;
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
    const std::size_t count = points_mm.size();
    if (count < 4 || pixels.size() != count || !all_finite(points_mm) || !all_finite(pixels) ||
        !span_a_plane(points_mm))
        return std::nullopt;
    std::vector<Refined> found;
    for (const Rigid& start : closed_form_poses(projector, points_mm, pixels))
        if (const auto refined = refine(projector, points_mm, pixels, start))
            found.push_back(*refined);
    std::stable_sort(found.begin(), found.end(),
                     [](const Refined& a, const Refined& b) { return a.at.cost < b.at.cost; });
    if (found.empty())
        return std::nullopt;

    const auto covariance = covariance_per_px2(found[0].at.information);
    if (!covariance)
        return std::nullopt;
    const auto rms = [&](const Refined& pose) {
        return std::sqrt(pose.at.cost / static_cast<double>(count));
    };
    PoseEstimate estimate{found[0].camera_from_marker, rms(found[0]), {}, 0.0, *covariance};
    if (found.size() > 1 && !same_pose(found[0].camera_from_marker, found[1].camera_from_marker)) {
        estimate.alternative = found[1].camera_from_marker;
        estimate.alternative_rms_px = rms(found[1]);
    }
    return estimate;
}

}  // namespace etalon
