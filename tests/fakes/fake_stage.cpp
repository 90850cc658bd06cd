#include "tests/fakes/fake_stage.h"

#include "stage/motion/stage_unit.h"

namespace etalon {
namespace {

void require(bool condition, const char* request, const char* cause) {
    if (!condition)
        throw DeviceError("fake stage", request, cause);
}

void require_going_on(const std::stop_token& stop) {
    if (stop.stop_requested())
        throw Interrupted();
}

}  // namespace

FakeStage::FakeStage(std::vector<Axis> axes) : axes_(std::move(axes)), position_(axes_.size()) {}

void FakeStage::enable(std::stop_token stop) {
    require_going_on(stop);
    enabled_ = true;
}

void FakeStage::home(std::stop_token stop) {
    require_going_on(stop);
    require(enabled_, "home", "the axes are not enabled");
    homed_ = true;
    position_.assign(axes_.size(), 0.0);
}

void FakeStage::resume() {
    require(enabled_ && homed_, "resume", "the axes are not homed");
}

void FakeStage::move(std::span<const double> target, std::stop_token stop) {
    require(homed_, "move", "the axes are not homed");
    require_within_limits(axes_, target, {"fake stage", 0, "move"});
    require_going_on(stop);
    moves.emplace_back(target.begin(), target.end());
    speed_shares.push_back(speed_share_);
    if (before_move)
        before_move(target);
    position_.assign(target.begin(), target.end());
    for (std::size_t i = 0; i < read_back_error.size() && i < position_.size(); ++i)
        position_[i] += read_back_error[i];
}

std::vector<double> FakeStage::position() {
    const std::vector<AxisStatus> axes = status();
    static const StageProfile profile;
    const std::string cause =
        disturbance(axes_, axes, std::array{pressed, at_limit, alarmed}, profile);
    require(cause.empty(), "read the positions", cause.c_str());
    std::vector<double> positions;
    for (const AxisStatus& axis : axes)
        positions.push_back(axis.position);
    return positions;
}

std::vector<AxisStatus> FakeStage::status() {
    std::vector<AxisStatus> axes;
    for (const double position : position_)
        axes.push_back({enabled_, homed_, false, true, 0, position});
    if (on_status)
        on_status(axes);
    return axes;
}

bool FakeStage::stop() noexcept {
    ++stops;
    return true;
}

}  // namespace etalon
