#include "station/qualify/measured_poses.h"

#include <fmt/format.h>

#include "compare/photometric/photometric_detector.h"
#include "core/errors.h"

namespace etalon {
namespace {

constexpr double detector_error_px = 0.5;   // how far a detector's corners may be off
constexpr double least_log_likelihood = 3;  // below it the other planar solution is as good

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
    if (pose.other && pose.other->log_likelihood_ratio < least_log_likelihood)
        throw NumericalError("both planar solutions match the photograph");
    return pose;
}

class PhotometricReader {
public:
    explicit PhotometricReader(const QualifyResult& result)
        : result_(result),
          detector_(result.station.camera.model, result.station.marker,
                    result.station.marker.spec) {}

    PhotometricReading read(const PoseRecord& pose) const {
        const auto start = estimate_pose(detector_.camera()->projector(),
                                         result_.station.marker.points_mm, pose.corners);
        if (!start)
            throw NumericalError("its corners determine no pose to start from");
        std::vector<PhotometricPose> poses;
        for (const FrameRecord& frame : pose.frames)
            if (!frame.file.empty())
                poses.push_back(unambiguous(
                    detector_.find(photo(frame), start->camera_from_marker, detector_error_px)));
        return mean_of(poses);
    }

private:
    CodeImage photo(const FrameRecord& frame) const {
        CodeImage image = read_image(result_.folder / frame.file);
        image.bits = result_.settings.bits;
        return image;
    }

    const QualifyResult& result_;
    PhotometricDetector detector_;
};

}  // namespace

std::optional<CornerNoise> corner_noise(const PoseRecord& pose) {
    if (pose.detections < 2)
        return std::nullopt;
    double squares = 0.0;
    for (const FrameRecord& frame : pose.frames)
        for (std::size_t i = 0; i < frame.corners.size(); ++i)
            squares += (frame.corners[i] - pose.corners[i]).squaredNorm();
    constexpr double alike_px2 = 1e-12;
    if (squares < alike_px2)
        return std::nullopt;
    const double coordinates = 2.0 * static_cast<double>(pose.corners.size());
    const double freedom = (pose.detections - 1) * coordinates;
    return CornerNoise{squares / freedom / pose.detections, freedom};
}

std::vector<QualificationPose> measured_poses(const QualifyResult& result,
                                              std::vector<std::string>& remarks,
                                              const std::stop_token& stop) {
    const PhotometricReader reader(result);
    std::vector<QualificationPose> poses;
    for (std::size_t i = 0; i < result.poses.size(); ++i) {
        if (stop.stop_requested())
            throw Interrupted();
        const PoseRecord& record = result.poses[i];
        QualificationPose pose{record.stage.base_from_carriage, record.planned.hold_out, {}};
        pose.time_s = record.settled_s;
        pose.repeats = visited_before(result.plan, i);
        if (!record.corners.empty()) {
            pose.corners = record.corners;
            pose.corner_noise = corner_noise(record);
        }
        if (pose.hold_out && pose.corners) {
            try {
                pose.photometric = reader.read(record);
            } catch (const NumericalError& error) {
                remarks.push_back(
                    fmt::format("pose {} has no photometric pose: {}", record.index, error.what()));
            }
        }
        poses.push_back(std::move(pose));
    }
    return poses;
}

}  // namespace etalon
