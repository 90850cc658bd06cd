#include "compare/pose/pose.h"

namespace etalon {
namespace {

bool is_known(const std::optional<CornerNoise>& noise) {
    return noise && noise->variance_px2 > 0.0 && noise->degrees_of_freedom > 0.0;
}

// As uncertain as that of one pose: how far poses differ in it is not known here.
std::optional<CornerNoise> pooled_noise(std::span<const AnalysedPose> poses,
                                        std::optional<CornerNoise> VisitedPose::*noise) {
    double squares = 0.0, freedom = 0.0;
    int count = 0;
    for (const AnalysedPose& pose : poses) {
        if (!pose.is_detected() || !is_known(pose.*noise))
            continue;
        squares += (pose.*noise)->variance_px2 * (pose.*noise)->degrees_of_freedom;
        freedom += (pose.*noise)->degrees_of_freedom;
        ++count;
    }
    return count == 0 ? std::nullopt
                      : std::optional(CornerNoise{squares / freedom, freedom / count});
}

}  // namespace

void find_noise(std::span<AnalysedPose> poses) {
    const auto of_others = pooled_noise(poses, &VisitedPose::corner_noise),
               stated_for_others = pooled_noise(poses, &VisitedPose::stated_noise);
    for (AnalysedPose& pose : poses) {
        pose.noise.reset();
        if (!pose.is_detected())
            continue;
        const std::optional<CornerNoise>* sources[] = {&pose.corner_noise, &of_others,
                                                       &pose.stated_noise, &stated_for_others};
        for (const auto* each : sources)
            if (is_known(*each) && !pose.noise)
                pose.noise = *each;
    }
}

std::vector<int> poses_of_equal_frames(std::span<const VisitedPose> poses) {
    std::vector<int> equal;
    for (const VisitedPose& pose : poses)
        if (pose.detections > 1 && !is_known(pose.corner_noise))
            equal.push_back(pose.index);
    return equal;
}

}  // namespace etalon
