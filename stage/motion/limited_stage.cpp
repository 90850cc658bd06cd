#include "stage/motion/limited_stage.h"

#include <algorithm>

namespace etalon {
namespace {

std::vector<double> positions_of(const std::vector<AxisStatus>& statuses) {
    std::vector<double> positions;
    for (const AxisStatus& status : statuses)
        positions.push_back(status.position);
    return positions;
}

}  // namespace

LimitedStage::LimitedStage(std::unique_ptr<Stage> stage, MotionRules rules)
    : stage_(std::move(stage)), rules_(std::move(rules)) {
    stage_->limit_speed(rules_.slow_share);
    stage_->limit_speed(speed_share_);
}

void LimitedStage::move(std::span<const double> target, std::stop_token stop) {
    // Not position(): an axis that was homed to its limit switch stands there, and may leave.
    const std::vector<double> from = positions_of(stage_->status());
    for (const MotionSegment& segment :
         plan_motion(axes(), rules_, from, target, {"stage", 0, "move"})) {
        stage_->limit_speed(std::min(speed_share_, segment.speed_share));
        stage_->move(segment.to, stop);
    }
}

void LimitedStage::limit_speed(double share) {
    stage_->limit_speed(share);  // refuses what is none
    speed_share_ = share;
}

}  // namespace etalon
