#include "station/qualify/visited_pose.h"

#include <fmt/format.h>

#include <cmath>

#include "stage/axes/kinematics.h"

namespace etalon {
namespace {

std::optional<CornerNoise> corner_noise(const Pose& pose) {
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

}  // namespace

std::string frame_file(int pose, int frame) {
    return fmt::format("frames/{:04}_{}.png", pose, frame);
}

void average_readings(Pose& pose, std::span<const Axis> axes) {
    const auto n = static_cast<double>(pose.readings.size());
    for (std::size_t i = 0; i < axes.size(); ++i) {
        double sum = 0.0, squares = 0.0;
        for (const auto& reading : pose.readings)
            sum += reading.at(i);
        for (const auto& reading : pose.readings)
            squares += std::pow(reading[i] - sum / n, 2);
        const double deviation = std::sqrt(squares / (n - 1.0));
        pose.read_back.push_back(sum / n);
        pose.read_back_deviation.push_back(deviation);
        const double single = std::max(deviation, axes[i].read_noise.value_or(0.0));
        pose.read_back_uncertainty.push_back(single / std::sqrt(n));
    }
    const StagePose stage = stage_pose(axes, pose.read_back, pose.read_back_uncertainty);
    pose.base_from_carriage = stage.base_from_carriage;
    pose.stage_covariance = stage.covariance;
}

void detect_frame(Detector& detector, const CodeImage& image, FrameRecord& frame) {
    const Detection seen = detector.detect(image);
    if (!seen.corners)
        frame.detection = seen.reason;
    else if (!seen.shown_as.empty())
        frame.detection = drawn_otherwise(seen.shown_as);
    else if (!seen.corners->is_whole())
        frame.detection = "marker seen in part only";
    else
        frame.corners = seen.corners->pixels;
}

void average_corners(Pose& pose) {
    for (const FrameRecord& frame : pose.frames) {
        if (frame.corners.empty())
            continue;
        ++pose.detections;
        pose.corners.resize(frame.corners.size(), Eigen::Vector2d::Zero());
        for (std::size_t i = 0; i < frame.corners.size(); ++i)
            pose.corners[i] += frame.corners[i];
    }
    for (Eigen::Vector2d& corner : pose.corners)
        corner /= pose.detections;
    pose.corner_noise = corner_noise(pose);
}

}  // namespace etalon
