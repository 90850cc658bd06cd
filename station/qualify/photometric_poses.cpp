#include "station/qualify/photometric_poses.h"

#include <fmt/format.h>

#include "core/errors.h"

namespace etalon {
namespace {

constexpr double detector_error_px = 0.5;  // how far a detector's corners may be off
constexpr double min_log_likelihood = 3;   // below it the other planar solution is as good

// Of a pose's frames: they see the same, with noise that is independent.
PhotometricReading mean_of(const std::vector<PhotometricPose>& poses) {
    const auto n = static_cast<double>(poses.size());
    const Rigid& first = poses.front().camera_from_marker;
    Vector6d mean = Vector6d::Zero();
    Matrix6d covariance = Matrix6d::Zero();
    for (const PhotometricPose& pose : poses) {
        mean += left_difference(first, pose.camera_from_marker) / n;
        covariance += pose.covariance / (n * n);
    }
    return {left_perturbed(first, mean), covariance};
}

PhotometricPose unambiguous(const PhotometricPose& pose) {
    if (!pose.converged)
        throw NumericalError("the fit does not settle");
    if (pose.other && pose.other->log_likelihood_ratio < min_log_likelihood)
        throw NumericalError("both planar solutions match the photograph");
    return pose;
}

PhotometricReading photometric_reading(const QualifyResult& result,
                                       const PhotometricDetector& detector, const Pose& pose) {
    const auto start = estimate_pose(detector.camera()->projector(),
                                     result.station.marker.points_mm, pose.corners);
    if (!start)
        throw NumericalError("its corners determine no pose to start from");
    std::vector<PhotometricPose> poses;
    for (const FrameRecord& frame : pose.frames)
        if (!frame.file.empty())
            poses.push_back(unambiguous(detector.find(
                recorded_photo(result, frame), start->camera_from_marker, detector_error_px)));
    return mean_of(poses);
}

}  // namespace

PhotometricPoses::PhotometricPoses(const QualifyResult& result, std::stop_token stop)
    : run_(result),
      stop_(std::move(stop)),
      detector_(result.station.camera.model, result.station.marker, result.station.marker.spec) {}

PhotometricPoses::~PhotometricPoses() {
    tasks_.cancel();
    try {
        tasks_.wait();
    } catch (const std::exception&) {
        // nobody asks for them any more
    }
}

void PhotometricPoses::add(const Pose& pose) {
    if (!pose.hold_out || !pose.is_detected() || found_.contains(pose.index))
        return;
    tasks_.run([this, pose, &found = found_[pose.index]] {
        if (stop_.stop_requested())
            return;
        try {
            found.reading = photometric_reading(run_, detector_, pose);
        } catch (const NumericalError& error) {
            found.refusal = error.what();
        }
    });
}

void PhotometricPoses::set_in(QualifyResult& result) {
    for (const Pose& pose : result.poses)
        add(pose);
    tasks_.wait();
    if (stop_.stop_requested())
        throw Interrupted();
    for (Pose& pose : result.poses) {
        const auto found = found_.find(pose.index);
        if (found == found_.end())
            continue;
        pose.photometric = found->second.reading;
        if (!pose.photometric)
            result.remarks.push_back(fmt::format("pose {} has no photometric pose: {}", pose.index,
                                                 found->second.refusal));
    }
}

}  // namespace etalon
