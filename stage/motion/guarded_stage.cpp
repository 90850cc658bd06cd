#include "stage/motion/guarded_stage.h"

#include <algorithm>
#include <array>

#include "stage/motion/axis_signals.h"

namespace etalon {
namespace {

std::vector<double> positions_of(const std::vector<AxisStatus>& statuses) {
    std::vector<double> positions;
    for (const AxisStatus& status : statuses)
        positions.push_back(status.position);
    return positions;
}

}  // namespace

GuardedStage::GuardedStage(std::unique_ptr<Stage> stage, MotionRules rules)
    : stage_(std::move(stage)), rules_(std::move(rules)) {}

void GuardedStage::move(std::span<const double> target, std::stop_token stop) {
    // Not position(): an axis that was homed to its limit switch stands there, and may leave.
    const std::vector<double> from = positions_of(stage_->status());
    for (const MotionSegment& segment :
         plan_motion(axes(), rules_, from, target, {"stage", 0, "move"})) {
        stage_->limit_speed(std::min(speed_share_, segment.speed_share));
        stage_->move(segment.to, stop);
    }
}

void GuardedStage::limit_speed(double share) {
    stage_->limit_speed(share);  // refuses what is none
    speed_share_ = share;
}

std::vector<double> GuardedStage::position() {
    const std::vector<AxisStatus> statuses = stage_->status();
    static const StageProfile unknown;  // the stage inside may be any
    const std::string cause =
        disturbance(axes(), statuses, std::array{pressed, at_limit, alarmed}, unknown);
    if (!cause.empty())
        throw DeviceError("stage", "read the positions", cause);
    return positions_of(statuses);
}

}  // namespace etalon
