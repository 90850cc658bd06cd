// Photometric poses against the truth and against AprilTag's corners, on photographs made by the
// reference integrator and the sensor's noise: the renderer that is fitted has no part in them.
// Shared by tests/evidence/photometric_pose.cpp and
// tests/compare/photometric/photometric_poses_statistics_test.cpp.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "compare/make_detector.h"
#include "compare/photometric/photometric_detector.h"
#include "core/program/errors.h"
#include "core/time/clock.h"
#include "sim/render/reference_integrator.h"
#include "sim/render/renderer.h"
#include "sim/scene/pose_sampling.h"
#include "sim/sensor/sensor_model.h"
#include "tests/calib/cameras.h"

namespace etalon::test {

inline constexpr double exposure = 0.8;

// A webcam of 640x480 px with barrel distortion, of 5100 electrons full well; with the lens,
// focused at 1 m.
inline CameraModel webcam(bool with_lens) {
    CameraModel camera = camera_with(640, 480, {538.55, 536.2, 317.3, 241.8},
                                     {.k1 = -0.286, .k2 = 0.057, .k3 = 0.112});
    camera.sensor =
        Sensor{.pixel_pitch_um = 8.3, .black_dn = 5.0, .gain_e_per_dn = 20.0, .read_noise_e = 10.0};
    if (with_lens)
        camera.lens = Lens{.f_number = 2.8, .focus_distance_mm = 1000.0, .wavelength_nm = 650.0};
    return camera;
}

inline const Marker& tag() {
    static const Marker marker = parse_marker("apriltag:36h11:5@50mm", "study");
    return marker;
}

// 300 to 700 mm, tilts to 60 degrees every way, any turn, all of the tag in the image.
inline Rigid study_pose(const CameraModel& camera, std::uint64_t index) {
    const std::vector<double> u = HaltonSequence(6, 11).point(index + 1);
    const double z = 300.0 + 400.0 * u[0], tilt = u[1] * std::numbers::pi / 3.0;
    const double towards = 2.0 * std::numbers::pi * u[2], turn = 2.0 * std::numbers::pi * u[3];
    const Eigen::Vector3d axis(std::cos(towards), std::sin(towards), 0.0);
    const Eigen::Quaterniond rotation(Eigen::AngleAxisd(tilt, axis) *
                                      Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()));
    const Eigen::Vector2d pixel(120.0 + 400.0 * u[4], 110.0 + 260.0 * u[5]);
    const Eigen::Vector2d ray = Projector(camera).unproject(pixel).value();
    return {rotation, z * ray.homogeneous()};
}

struct Truth {
    Rigid camera_from_marker;
    Radiance radiance;  // exposed
};

// Some 16 `samples_per_scramble` samples a pixel; beyond the marker it is white.
inline Truth truth_at(const CameraModel& camera, const Rigid& pose, int samples_per_scramble,
                      double stop_at_gray) {
    const cv::Mat seen =
        pixel_uses(Projector(camera), pose, compared_area(tag(), {}, "study")) != pixel_outside;
    const cv::Rect region = cv::boundingRect(seen);
    Radiance radiance(camera.height, camera.width, CV_32FC1, cv::Scalar(1.0));
    integrate_reference(
        camera, {{{tag().grid, pose}}, 1.0}, region,
        {.samples_per_scramble = samples_per_scramble, .stop_at_gray = stop_at_gray})
        .mean.copyTo(radiance(region));
    return {pose, exposure * radiance};
}

// The smallest covariance that an unbiased estimate can have (Cramer and Rao), six levels and, of
// a camera without lens, the blur's variance marginalised. From central differences of closed-form
// renderings and the sensor's own noise formula; nothing of what is tested takes part.
inline Matrix6d cramer_rao_bound(const CameraModel& camera, const Renderer& renderer,
                                 const Rigid& pose) {
    const cv::Mat use =
        pixel_uses(Projector(camera), pose, detector_area(tag(), "study")) != pixel_outside;
    const auto rendered = [&](const Rigid& at) {
        return renderer.render({{{tag().grid, at}}, 1.0}, {.tolerance_gray = 0.02}).radiance;
    };
    const Radiance middle = rendered(pose);
    const double half_tag_mm = 31.0, z = pose.translation.z();
    const double shift = 0.1 * z / camera.intrinsics.fx;
    Vector6d steps;  // each moves edges by about 0.1 px at most
    steps << 1.5 * shift / half_tag_mm, 1.5 * shift / half_tag_mm, shift / half_tag_mm, shift,
        shift, shift * z / (half_tag_mm + pose.translation.head<2>().norm());
    std::vector<cv::Mat> columns;
    for (int i = 0; i < 6; ++i) {
        const Vector6d delta = steps[i] * Vector6d::Unit(i);
        columns.push_back(
            (rendered(left_perturbed(pose, delta)) - rendered(left_perturbed(pose, -delta))) /
            (2.0 * steps[i]));
    }
    if (!camera.lens) {
        constexpr double sigma = 0.2;
        columns.push_back((blurred(middle, sigma) - middle) / (sigma * sigma));
    }
    const Sensor& sensor = *camera.sensor;
    const double range = 255.0 - sensor.black_dn;
    const auto geometric = static_cast<Eigen::Index>(columns.size());
    Eigen::VectorXd row(geometric + 6);
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(row.size(), row.size());
    for (int y = 0; y < use.rows; ++y)
        for (int x = 0; x < use.cols; ++x) {
            if (!use.at<uchar>(y, x))
                continue;
            const double seen = middle.at<float>(y, x), signal = range * exposure * seen;
            const double variance = signal / sensor.gain_e_per_dn +
                                    std::pow(sensor.read_noise_e / sensor.gain_e_per_dn, 2) +
                                    1.0 / 12.0;
            for (Eigen::Index i = 0; i < geometric; ++i)
                row[i] = range * exposure * columns[static_cast<std::size_t>(i)].at<float>(y, x);
            const Eigen::Vector3d plane(1.0, x / 640.0 - 0.5, y / 480.0 - 0.5);
            row.tail<6>() << (1.0 - seen) * plane, seen * plane;
            information += row * row.transpose() / variance;
        }
    const Eigen::VectorXd scale = information.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd inverse =
        (scale.asDiagonal() * information * scale.asDiagonal()).eval().inverse();
    return (scale.asDiagonal() * inverse * scale.asDiagonal()).topLeftCorner<6, 6>();
}

struct FoundPose {
    bool detected = false;  // by AprilTag; without, nothing else is set
    bool failed = false;    // refused by the photometric detector
    bool flipped = false;   // the photometric pose is the other planar solution
    bool converged = false;
    Vector6d error, corner_error;  // photometric; of the better solution from AprilTag's corners
    double chi_square = 0.0;       // per pixel, at the known noise
    double mahalanobis = 0.0;      // squared, of the error with the stated covariance
    double photometric_ms = 0.0, apriltag_ms = 0.0;
};

class Study {
public:
    explicit Study(const CameraModel& camera)
        : camera_(camera),
          sensor_(camera),
          photometric_(camera, tag(), "study"),
          apriltag_(make_detector("apriltag", tag(), "study")) {}

    FoundPose run(const Truth& truth, const NoiseKey& noise) {
        const CodeImage photo = sensor_.expose(truth.radiance, noise);
        FoundPose outcome;
        const double before = process_cpu_ms();
        const auto corners = apriltag_->detect(photo).corners;
        outcome.apriltag_ms = process_cpu_ms() - before;
        const auto start =
            corners ? estimate_pose(projector(), tag().points_mm, corners->pixels) : std::nullopt;
        if (!start)
            return outcome;
        outcome.detected = true;
        outcome.corner_error = nearer_error(truth.camera_from_marker, *start);
        const double after = process_cpu_ms();
        try {
            const PhotometricPose pose = photometric_.find(photo, start->camera_from_marker, 0.5);
            outcome.photometric_ms = process_cpu_ms() - after;
            judge(truth.camera_from_marker, pose, outcome);
        } catch (const NumericalError&) {
            outcome.failed = true;
        }
        return outcome;
    }

private:
    const Projector& projector() const { return photometric_.camera()->projector(); }

    // Of the two planar solutions the one nearer to the truth: corners are given every chance.
    static Vector6d nearer_error(const Rigid& truth, const PoseEstimate& estimate) {
        const Vector6d error = left_difference(truth, estimate.camera_from_marker);
        if (!estimate.alternative)
            return error;
        const Vector6d other = left_difference(truth, *estimate.alternative);
        return error.head<3>().norm() < other.head<3>().norm() ? error : other;
    }

    static void judge(const Rigid& truth, const PhotometricPose& pose, FoundPose& outcome) {
        outcome.error = left_difference(truth, pose.camera_from_marker);
        outcome.converged = pose.converged;
        outcome.chi_square = pose.reduced_squares * pose.noise_scale * pose.noise_scale;
        outcome.mahalanobis = outcome.error.dot(pose.covariance.ldlt().solve(outcome.error));
        outcome.flipped =
            pose.other && left_difference(truth, pose.other->camera_from_marker).head<3>().norm() <
                              outcome.error.head<3>().norm();
    }

    CameraModel camera_;
    SensorModel sensor_;
    PhotometricDetector photometric_;
    std::unique_ptr<Detector> apriltag_;
};

}  // namespace etalon::test
