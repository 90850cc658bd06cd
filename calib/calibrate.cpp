#include "calib/calibrate.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <opencv2/calib3d.hpp>

#include "calib/parameter_names.h"
#include "calib/projector.h"
#include "core/errors.h"

namespace etalon {
namespace {

constexpr int parameter_count = 9;
constexpr std::array<const char*, parameter_count> parameter_names{"fx", "fy", "cx", "cy", "k1",
                                                                   "k2", "p1", "p2", "k3"};
using Parameters = Eigen::Matrix<double, parameter_count, 1>;
using Information = Eigen::Matrix<double, parameter_count, parameter_count>;

std::vector<cv::Point3f> object_points(const CalibrationView& view) {
    std::vector<cv::Point3f> points;
    for (const Eigen::Vector3d& p : view.points_mm)
        points.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()), 0.0f);
    return points;
}

std::vector<cv::Point2f> image_points(const CalibrationView& view) {
    std::vector<cv::Point2f> pixels;
    for (const Eigen::Vector2d& q : view.pixels)
        pixels.emplace_back(static_cast<float>(q.x()), static_cast<float>(q.y()));
    return pixels;
}

Rigid rigid_from_opencv(const cv::Mat& rotation, const cv::Mat& translation) {
    Vector6d pose;
    for (int i = 0; i < 3; ++i) {
        pose[i] = rotation.at<double>(i);
        pose[3 + i] = translation.at<double>(i);
    }
    return rigid_from_vector(pose);
}

struct Fit {
    CameraModel camera;
    std::vector<Rigid> camera_from_target;
};

Fit fit_from_opencv(const cv::Mat& k, const cv::Mat& distortion, cv::Size size) {
    Fit fit;
    fit.camera.width = size.width;
    fit.camera.height = size.height;
    fit.camera.intrinsics = {.fx = k.at<double>(0, 0),
                             .fy = k.at<double>(1, 1),
                             .cx = k.at<double>(0, 2),
                             .cy = k.at<double>(1, 2)};
    std::array<double, 14> coefficients{};
    for (int i = 0; i < 5; ++i)
        coefficients[i] = distortion.at<double>(i);
    fit.camera.distortion = Distortion::from_opencv_order(coefficients);
    return fit;
}

// `skipped` is left out; views.size() leaves out none.
Fit fit_camera(const std::vector<CalibrationView>& views, cv::Size size, std::size_t skipped) {
    std::vector<std::vector<cv::Point3f>> points;
    std::vector<std::vector<cv::Point2f>> pixels;
    for (std::size_t i = 0; i < views.size(); ++i) {
        if (i == skipped)
            continue;
        points.push_back(object_points(views[i]));
        pixels.push_back(image_points(views[i]));
    }
    cv::Mat k, distortion;
    std::vector<cv::Mat> rotations, translations;
    try {
        cv::calibrateCamera(points, pixels, size, k, distortion, rotations, translations, 0,
                            {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 100, 1e-15});
    } catch (const cv::Exception& error) {
        throw NumericalError("no camera fits these views: " + error.err);
    }
    Fit fit = fit_from_opencv(k, distortion, size);
    for (std::size_t i = 0; i < rotations.size(); ++i)
        fit.camera_from_target.push_back(rigid_from_opencv(rotations[i], translations[i]));
    return fit;
}

Eigen::Vector2d residual(const Projector& projector, const Rigid& camera_from_target,
                         const CalibrationView& view, std::size_t point) {
    const auto pixel = projector.project(camera_from_target * view.points_mm[point]);
    if (!pixel)
        throw NumericalError(fmt::format(
            "the fitted distortion folds over inside the image: no ray near pixel ({:.1f}, {:.1f})",
            view.pixels[point].x(), view.pixels[point].y()));
    return view.pixels[point] - *pixel;
}

double sum_of_squares(const Projector& projector, const Rigid& camera_from_target,
                      const CalibrationView& view) {
    double sum = 0.0;
    for (std::size_t i = 0; i < view.pixels.size(); ++i)
        sum += residual(projector, camera_from_target, view, i).squaredNorm();
    return sum;
}

// d pixel / d (fx, fy, cx, cy, k1, k2, p1, p2, k3): the model is linear in all of them.
Eigen::Matrix<double, 2, parameter_count> parameter_jacobian(const CameraModel& camera,
                                                             const Eigen::Vector3d& p_camera) {
    const Eigen::Vector2d u = p_camera.head<2>() / p_camera.z();
    const Eigen::Vector2d d = distort(camera.distortion, u).point;
    const double s = u.squaredNorm(), xy2 = 2.0 * u.x() * u.y();
    Eigen::Matrix<double, 2, 5> of_distortion;
    of_distortion.col(0) = s * u;
    of_distortion.col(1) = s * s * u;
    of_distortion.col(2) << xy2, s + 2.0 * u.y() * u.y();
    of_distortion.col(3) << s + 2.0 * u.x() * u.x(), xy2;
    of_distortion.col(4) = s * s * s * u;
    const Intrinsics& i = camera.intrinsics;
    Eigen::Matrix<double, 2, parameter_count> jacobian;
    jacobian << d.x(), 0, 1, 0, i.fx * of_distortion.row(0),  //
        0, d.y(), 0, 1, i.fy * of_distortion.row(1);
    return jacobian;
}

// d pixel / d left perturbation of the pose.
Eigen::Matrix<double, 2, 6> pose_jacobian(const Projector& projector, const Rigid& transform,
                                          const Eigen::Vector3d& p_target) {
    const Eigen::Vector3d turned = transform.rotation * p_target;
    const auto projected = projector.project_with_jacobian(turned + transform.translation);
    Eigen::Matrix<double, 3, 6> moved;
    moved << 0, turned.z(), -turned.y(), 1, 0, 0,  //
        -turned.z(), 0, turned.x(), 0, 1, 0,       //
        turned.y(), -turned.x(), 0, 0, 0, 1;
    return projected->jacobian * moved;
}

// What one view says about the camera once its own pose is eliminated (Schur complement).
struct ViewInformation {
    Information information;
    Parameters score;  // J^T r of the parameters, pose eliminated
};

ViewInformation view_information(const Projector& projector, const Rigid& transform,
                                 const CalibrationView& view) {
    Information camera = Information::Zero();
    Matrix6d pose = Matrix6d::Zero();
    Eigen::Matrix<double, 6, parameter_count> mixed;
    mixed.setZero();
    Parameters camera_score = Parameters::Zero();
    Vector6d pose_score = Vector6d::Zero();
    for (std::size_t i = 0; i < view.pixels.size(); ++i) {
        const Eigen::Vector2d r = residual(projector, transform, view, i);
        const auto of_camera =
            parameter_jacobian(projector.camera(), transform * view.points_mm[i]);
        const auto of_pose = pose_jacobian(projector, transform, view.points_mm[i]);
        camera += of_camera.transpose() * of_camera;
        pose += of_pose.transpose() * of_pose;
        mixed += of_pose.transpose() * of_camera;
        camera_score += of_camera.transpose() * r;
        pose_score += of_pose.transpose() * r;
    }
    const Eigen::LDLT<Matrix6d> solver(pose);
    return {camera - mixed.transpose() * solver.solve(mixed),
            camera_score - mixed.transpose() * solver.solve(pose_score)};
}

// Scaled to a unit diagonal first: the parameters' units differ by many orders of magnitude.
Information inverted(const Information& information) {
    const Parameters scale = information.diagonal().cwiseSqrt().cwiseInverse();
    const Information scaled = scale.asDiagonal() * information * scale.asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Information> eigen(scaled);
    if (!scaled.allFinite() || eigen.info() != Eigen::Success ||
        !(eigen.eigenvalues()[0] > 1e-11 * eigen.eigenvalues()[parameter_count - 1]))
        throw NumericalError(fmt::format(
            "these views do not determine the camera: rank of {} parameters lost (smallest "
            "eigenvalue {:.2g}); views of different tilt are needed",
            parameter_count, eigen.eigenvalues()[0]));
    const Information inverse = eigen.eigenvectors() *
                                eigen.eigenvalues().cwiseInverse().asDiagonal() *
                                eigen.eigenvectors().transpose();
    return scale.asDiagonal() * inverse * scale.asDiagonal();
}

// Pose of one view for a known camera: OpenCV's start, refined on the pixels.
Rigid fit_pose(const CameraModel& camera, const CalibrationView& view) {
    const Intrinsics& i = camera.intrinsics;
    const cv::Matx33d k(i.fx, 0, i.cx, 0, i.fy, i.cy, 0, 0, 1);
    const auto c = camera.distortion.in_opencv_order();
    const std::vector<double> coefficients(c.begin(), c.begin() + 5);
    const auto points = object_points(view);
    const auto pixels = image_points(view);
    cv::Mat rotation, translation;
    try {
        cv::solvePnP(points, pixels, k, coefficients, rotation, translation);
        cv::solvePnPRefineLM(points, pixels, k, coefficients, rotation, translation,
                             {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 100, 1e-15});
    } catch (const cv::Exception& error) {
        throw NumericalError("no pose fits the left-out view: " + error.err);
    }
    return rigid_from_opencv(rotation, translation);
}

Parameters parameters_of(const CameraModel& camera) {
    const Intrinsics& i = camera.intrinsics;
    const Distortion& d = camera.distortion;
    Parameters parameters;
    parameters << i.fx, i.fy, i.cx, i.cy, d.k1, d.k2, d.p1, d.p2, d.k3;
    return parameters;
}

struct LeftOut {
    Parameters parameters;
    double squares = 0.0;
    std::string failure;  // empty: none
};

LeftOut leave_out(const std::vector<CalibrationView>& views, cv::Size size, std::size_t view) {
    LeftOut left_out;
    try {
        const CameraModel camera = fit_camera(views, size, view).camera;
        left_out.parameters = parameters_of(camera);
        left_out.squares =
            sum_of_squares(Projector(camera), fit_pose(camera, views[view]), views[view]);
    } catch (const NumericalError& error) {
        left_out.failure = error.what();
    }
    return left_out;
}

// Every view is left out on its own, so that the number of threads cannot change the result.
std::vector<LeftOut> leave_each_out(const std::vector<CalibrationView>& views, cv::Size size) {
    std::vector<LeftOut> all(views.size());
    cv::parallel_for_(cv::Range(0, static_cast<int>(views.size())), [&](const cv::Range& range) {
        for (int i = range.start; i < range.end; ++i)
            all[i] = leave_out(views, size, i);
    });
    for (std::size_t i = 0; i < all.size(); ++i)
        if (!all[i].failure.empty())
            throw NumericalError(fmt::format("without view {}: {}", i, all[i].failure));
    return all;
}

void report_left_out(const std::vector<CalibrationView>& views, const std::vector<LeftOut>& all,
                     CameraCalibration& calibration) {
    double squares = 0.0;
    Parameters mean = Parameters::Zero(), variance = Parameters::Zero();
    const double n = static_cast<double>(views.size());
    for (std::size_t i = 0; i < views.size(); ++i) {
        squares += all[i].squares;
        mean += all[i].parameters / n;
        calibration.views[i].left_out_rms_px =
            std::sqrt(all[i].squares / static_cast<double>(views[i].pixels.size()));
    }
    calibration.leave_one_out_rms_px = std::sqrt(squares / static_cast<double>(point_count(views)));
    for (const LeftOut& left_out : all)
        variance += (n - 1.0) / n * (left_out.parameters - mean).cwiseAbs2();
    for (int i = 0; i < parameter_count; ++i)
        calibration.deviations[i].jackknife = std::sqrt(variance[i]);
}

// Fills in RMS values and deviations; returns the formal covariance.
Information evaluate(const std::vector<CalibrationView>& views, const Fit& fit,
                     CameraCalibration& calibration) {
    const Projector projector(fit.camera);
    Information information = Information::Zero(), scores = Information::Zero();
    double squares = 0.0;
    for (std::size_t i = 0; i < views.size(); ++i) {
        const double of_view = sum_of_squares(projector, fit.camera_from_target[i], views[i]);
        squares += of_view;
        calibration.views.push_back(
            {fit.camera_from_target[i],
             std::sqrt(of_view / static_cast<double>(views[i].pixels.size())), std::nullopt});
        const auto view = view_information(projector, fit.camera_from_target[i], views[i]);
        information += view.information;
        scores += view.score * view.score.transpose();
    }
    const double n = static_cast<double>(views.size());
    const double points = static_cast<double>(point_count(views));
    calibration.rms_px = std::sqrt(squares / points);
    const Information inverse = inverted(information);
    Information formal = squares / (2.0 * points - parameter_count - 6.0 * n) * inverse;
    const Information robust = n / (n - 1.0) * inverse * scores * inverse;
    for (int i = 0; i < parameter_count; ++i)
        calibration.deviations.push_back({parameter_names[i], std::sqrt(formal(i, i)),
                                          std::sqrt(std::max(0.0, robust(i, i))), std::nullopt});
    return formal;
}

ParameterCovariance largest_covariance(const Information& formal,
                                       const std::vector<ParameterDeviation>& deviations) {
    Parameters scale;
    for (int i = 0; i < parameter_count; ++i)
        scale[i] =
            deviations[i].formal > 0.0 ? deviations[i].largest() / deviations[i].formal : 1.0;
    return {{parameter_names.begin(), parameter_names.end()},
            scale.asDiagonal() * formal * scale.asDiagonal()};
}

// Exact views of bad geometry have no residuals to tell of it: corners are taken to be no better
// than 0.1 px.
void check_determined(const CameraCalibration& calibration, double fx) {
    constexpr double least_noise_px = 0.1, largest_share = 0.1;
    const double formal = calibration.deviations[0].formal;
    const double with_noise =
        formal * std::max(1.0, least_noise_px / std::max(calibration.rms_px, 1e-9));
    if (!(with_noise < largest_share * fx))
        throw NumericalError(
            fmt::format("these views do not determine the focal length: fx {:.1f} with a standard "
                        "deviation of {:.1f} px; views of different tilt are needed",
                        fx, with_noise));
}

}  // namespace

double ParameterDeviation::largest() const {
    return std::max({formal, cluster_robust, jackknife.value_or(0.0)});
}

CameraCalibration calibrate_camera(const std::vector<CalibrationView>& views, cv::Size image_size,
                                   const CalibrationOptions& options) {
    if (views.size() < 3)
        throw NumericalError(fmt::format("{} views, three are needed", views.size()));
    for (std::size_t i = 0; i < views.size(); ++i)
        check_view(views[i], i, 6);
    const Fit fit = fit_camera(views, image_size, views.size());
    CameraCalibration calibration;
    const Information formal = evaluate(views, fit, calibration);
    check_determined(calibration, fit.camera.intrinsics.fx);
    if (options.leave_one_out && views.size() >= 4)
        report_left_out(views, leave_each_out(views, image_size), calibration);
    calibration.camera = fit.camera;
    calibration.camera.covariance = largest_covariance(formal, calibration.deviations);
    return calibration;
}

}  // namespace etalon
