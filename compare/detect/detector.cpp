#include "compare/detect/detector.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>

#include "compare/detect/detector_adaptors.h"
#include "core/optimize/least_squares.h"
#include "core/statistics/covariance.h"

namespace etalon {

ObjectPoints seen_points_mm(const Marker& marker, const DetectedCorners& corners) {
    if (corners.is_whole())
        return marker.points_mm;
    ObjectPoints seen;
    for (const int point : corners.points)
        seen.push_back(marker.points_mm.at(static_cast<std::size_t>(point)));
    return seen;
}

std::string drawn_otherwise(const std::string& shown_as) {
    return "the board that is seen is " + shown_as + ": name it so";
}

Detection only_one(int id, const std::vector<DetectedCorners>& found) {
    std::vector<DetectedCorners> own;
    std::ranges::copy_if(found, std::back_inserter(own),
                         [id](const DetectedCorners& corners) { return corners.id == id; });
    if (own.empty())
        return {{}, "marker not found"};
    if (own.size() > 1)
        return {{}, fmt::format("marker {} is seen {} times", id, own.size()), own};
    return {own[0]};
}

cv::Mat as_8_bit(const CodeImage& image) {
    if (image.bits == 8 && image.pixels.type() == CV_8UC1)
        return image.pixels;
    cv::Mat scaled;
    image.pixels.convertTo(scaled, CV_8U, 255.0 / image.full_scale());
    return scaled;
}

cv::Mat as_float(const CodeImage& image) {
    cv::Mat scaled;
    image.pixels.convertTo(scaled, CV_32F, 1.0 / image.full_scale());
    return scaled;
}

std::optional<Eigen::Matrix3d> homography(const std::vector<Eigen::Vector2d>& from,
                                          const std::vector<Eigen::Vector2d>& to) {
    std::vector<cv::Point2d> source, target;
    for (std::size_t i = 0; i < from.size(); ++i) {
        source.emplace_back(from[i].x(), from[i].y());
        target.emplace_back(to[i].x(), to[i].y());
    }
    const cv::Mat found = from.size() < 4 ? cv::Mat() : cv::findHomography(source, target, 0);
    if (found.empty())
        return std::nullopt;
    Eigen::Matrix3d result;
    cv::cv2eigen(found, result);
    return result;
}

Eigen::Vector2d seen_at(const Eigen::Matrix3d& homography, const Eigen::Vector2d& place) {
    return (homography * place.homogeneous()).hnormalized();
}

Eigen::Matrix2d jacobian_at(const Eigen::Matrix3d& homography, const Eigen::Vector2d& place) {
    const Eigen::Vector3d there = homography * place.homogeneous();
    return (homography.topLeftCorner<2, 2>() -
            there.hnormalized() * homography.bottomLeftCorner<1, 2>()) /
           there.z();
}

Eigen::Vector3d principal_spreads(const std::vector<Eigen::Vector3d>& points) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& point : points)
        mean += point / static_cast<double>(points.size());
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (const Eigen::Vector3d& point : points)
        scatter += (point - mean) * (point - mean).transpose() / static_cast<double>(points.size());
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(Eigen::MatrixXd(scatter),
                                                                Eigen::EigenvaluesOnly);
    return solver.eigenvalues().reverse().cwiseMax(0.0).cwiseSqrt();
}

namespace {

template <class Vectors>
bool all_finite(const Vectors& vectors) {
    return std::ranges::all_of(vectors, [](const auto& v) { return v.allFinite(); });
}

// The closed-form solutions (Collins and Bartoli, "Infinitesimal plane-based pose estimation", IJCV
// 2014) on undistorted points, of a wide lens from a camera along the points' mean ray; empty when
// a pixel has no ray or the library gives up. Not IPPE_SQUARE: it returns Z = 0 for another order.
std::vector<Rigid> closed_form_poses(const Projector& projector, const ObjectPoints& points,
                                     const ImagePoints& pixels) {
    std::vector<Eigen::Vector3d> rays;
    for (const Eigen::Vector2d& pixel : pixels) {
        const auto ray = projector.ray(pixel);
        if (!ray)
            return {};
        rays.push_back(*ray);
    }
    const bool is_flat = projector.camera().projection.is_flat();
    const Eigen::Quaterniond turn =
        is_flat ? Eigen::Quaterniond::Identity() : rotation_to_mean_direction(rays);
    const VisibleProjection seen = seen_across(turn, rays);
    std::vector<cv::Point3d> object;
    std::vector<cv::Point2d> image;
    for (std::size_t i = 0; i < seen.kept.size(); ++i) {
        const Eigen::Vector3d& point = points[seen.kept[i]];
        object.emplace_back(point.x(), point.y(), point.z());
        image.emplace_back(seen.points[i].x(), seen.points[i].y());
    }
    std::vector<cv::Mat> rotations, translations;
    try {
        cv::solvePnPGeneric(object, image, cv::Matx33d::eye(), cv::noArray(), rotations,
                            translations, false, cv::SOLVEPNP_IPPE);
    } catch (const cv::Exception&) {
        return {};  // its own checks: fewer than four points, a homography without rank
    }
    std::vector<Rigid> poses;
    for (std::size_t i = 0; i < rotations.size(); ++i) {
        const Vector6d pose((Vector6d() << Eigen::Vector3d(rotations[i].ptr<double>()),
                             Eigen::Vector3d(translations[i].ptr<double>()))
                                .finished());
        if (pose.allFinite())
            poses.push_back(Rigid{turn.conjugate(), Eigen::Vector3d::Zero()} *
                            rigid_from_vector(pose));
    }
    return poses;
}

// The pixels' residuals, px, for a left perturbation of the pose; nothing when one is unseen.
std::optional<ResidualsAndJacobian> linearised(const Projector& projector,
                                               const ObjectPoints& points,
                                               const ImagePoints& pixels,
                                               const Rigid& camera_from_marker) {
    ResidualsAndJacobian all{Eigen::VectorXd(2 * std::ssize(points)),
                             Eigen::MatrixXd(2 * std::ssize(points), 6)};
    for (std::size_t i = 0; i < points.size(); ++i) {
        const Eigen::Vector3d arm = camera_from_marker.rotation * points[i];
        const auto seen = projector.project_with_jacobian(arm + camera_from_marker.translation);
        if (!seen)
            return std::nullopt;
        const auto row = 2 * static_cast<Eigen::Index>(i);
        all.residuals.segment<2>(row) = seen->pixel - pixels[i];
        all.jacobian.middleRows<2>(row) << -seen->jacobian * cross_matrix(arm), seen->jacobian;
    }
    return all.residuals.allFinite() ? std::optional(all) : std::nullopt;
}

using Refined = Fitted<Rigid>;

// Nothing when a point cannot be seen from the start. The last step is taken in full and unseen: it
// changes the loss by less than rounding, and makes the pose independent of the start.
std::optional<Refined> refine(const Projector& projector, const ObjectPoints& points,
                              const ImagePoints& pixels, const Rigid& start,
                              const LeastSquaresRule& rule = {}) {
    const auto equations = [&](const Rigid& at) {
        return linearised(projector, points, pixels, at);
    };
    const auto moved = [](const Rigid& from, const Eigen::VectorXd& step) {
        return std::optional(left_perturbed(from, step));
    };
    const auto found = least_squares(start, rule, equations, moved);
    if (!found)
        return std::nullopt;
    const Refined& place = found->place;
    const Eigen::VectorXd last = damped_step(place.at, 0.0, rule).step;
    if (!found->converged || !last.allFinite())
        return place;
    const Rigid end = left_perturbed(place.unknowns, last);
    const auto there = equations(end);
    return there ? Refined{end, *there, robust_loss(*there, rule)} : place;
}

bool usable(const Projector& projector, const ObjectPoints& points_mm, const ImagePoints& pixels) {
    require_point_of_view(projector.camera(), "estimating a marker's pose");
    if (points_mm.size() < 4 || pixels.size() != points_mm.size() || !all_finite(points_mm) ||
        !all_finite(pixels))
        return false;
    // In a plane, and not on a line. Spreads come from squares, so rounding alone reaches 1e-8.
    const Eigen::Vector3d spread = principal_spreads(points_mm);
    return spread[0] > 0 && spread[1] > 1e-4 * spread[0] && spread[2] < 1e-6 * spread[0];
}

double rms_px(const Refined& pose, const ObjectPoints& points) {
    return std::sqrt(2.0 * pose.loss() / static_cast<double>(points.size()));
}

// Without the other solution.
std::optional<PoseEstimate> estimate_of(const Refined& pose, const ObjectPoints& points) {
    const auto covariance =
        covariance_from_information(pose.at.jacobian.transpose() * pose.at.jacobian);
    if (!covariance)
        return std::nullopt;
    return PoseEstimate{pose.unknowns, rms_px(pose, points), {}, 0.0, *covariance};
}

// Both starts can end in one minimum, for instance with strong perspective.
bool same_pose(const Rigid& a, const Rigid& b) {
    const Vector6d delta = left_difference(a, b);
    return delta.head<3>().norm() < 1e-6 &&
           delta.tail<3>().norm() < 1e-6 * (1.0 + a.translation.norm());
}

}  // namespace

std::optional<PoseEstimate> estimate_pose(const Projector& projector, const ObjectPoints& points_mm,
                                          const ImagePoints& pixels) {
    if (!usable(projector, points_mm, pixels))
        return std::nullopt;
    std::vector<Refined> found;
    for (const Rigid& start : closed_form_poses(projector, points_mm, pixels))
        if (const auto refined = refine(projector, points_mm, pixels, start))
            found.push_back(*refined);
    std::ranges::stable_sort(found, {}, &Refined::robust_loss);
    if (found.empty())
        return std::nullopt;

    std::optional<PoseEstimate> estimate = estimate_of(found[0], points_mm);
    if (estimate && found.size() > 1 && !same_pose(found[0].unknowns, found[1].unknowns)) {
        estimate->alternative = found[1].unknowns;
        estimate->alternative_rms_px = rms_px(found[1], points_mm);
    }
    return estimate;
}

std::optional<PoseEstimate> estimate_pose_near(const Projector& projector,
                                               const ObjectPoints& points_mm,
                                               const ImagePoints& pixels, const Rigid& start) {
    if (!usable(projector, points_mm, pixels))
        return std::nullopt;
    LeastSquaresRule rule;
    rule.descent.first_damping = 1e-9;  // from near by, Gauss and Newton's step is the shorter way
    const auto refined = refine(projector, points_mm, pixels, start, rule);
    return refined ? estimate_of(*refined, points_mm) : std::nullopt;
}

}  // namespace etalon
