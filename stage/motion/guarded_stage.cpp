#include "stage/motion/guarded_stage.h"

#include <fmt/format.h>

#include <algorithm>

namespace etalon {
namespace {

void require_undisturbed(const Axis& axis, const AxisStatus& status) {
    const auto fail = [&](const std::string& what) {
        throw DeviceError("stage", "read the positions",
                          fmt::format("axis {}: {}", axis.name, what));
    };
    if (status.emergency_stop)
        fail("emergency stop");
    if (status.alarm != 0)
        fail(fmt::format("alarm {}", status.alarm));
    if (status.limit)
        fail("at a limit");
}

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
    for (std::size_t i = 0; i < statuses.size(); ++i)
        require_undisturbed(axes().at(i), statuses[i]);
    return positions_of(statuses);
}

}  // namespace etalon
