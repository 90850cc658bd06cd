// The stage that a station drives: another one, within the rules of its station.yaml. Each move is
// planned from the positions that the axes read (stage/motion/motion_guard.h) and made in as many
// motions as the plan needs, slowly where something is near. Homing is the controller's own and
// knows no rules: see docs/stage.md. One owner thread, like the stage inside.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "stage/motion/motion_guard.h"
#include "stage/motion/stage.h"

namespace etalon {

class LimitedStage final : public Stage {
public:
    // `rules` belong to the stage's axes. Throws ConfigError when an axis cannot be as slow as they
    // ask for.
    LimitedStage(std::unique_ptr<Stage> stage, MotionRules rules);

    const std::vector<Axis>& axes() const override { return stage_->axes(); }
    void enable(std::stop_token stop) override { stage_->enable(stop); }
    void home(std::stop_token stop) override { stage_->home(stop); }
    void resume() override { stage_->resume(); }
    void take_for_homed() override { stage_->take_for_homed(); }

    // Throws ConfigError, before anything moves, for a target that is not allowed or to which no
    // way is found.
    void move(std::span<const double> target, std::stop_token stop) override;

    // An upper limit: slow zones stay as slow as they are.
    void limit_speed(double share) override;

    std::vector<double> position() override { return stage_->position(); }
    std::vector<AxisStatus> status() override { return stage_->status(); }
    bool stop() noexcept override { return stage_->stop(); }
    std::string trace() const override { return stage_->trace(); }
    void set_trace(std::function<void(const std::string&)> line) override {
        stage_->set_trace(std::move(line));
    }

private:
    std::unique_ptr<Stage> stage_;
    MotionRules rules_;
    double speed_share_ = 1.0;
};

}  // namespace etalon
