// Where the axes may go and by which way: soft limits, forbidden boxes of axis positions, slow
// zones around them, approaches from one side.
//
// The axes of a motion do not keep step: it is free when the box that its start and end span is
// clear of every forbidden one. Another is split into motions of some axes after others, or one
// axis first draws back past a forbidden box. Pure functions, no device; some 10 us a motion, with
// 8 axes and many boxes some milliseconds.
#pragma once

#include "stage/motion/stage.h"

namespace etalon {

struct AxisInterval {
    double low = -std::numeric_limits<double>::infinity();
    double high = std::numeric_limits<double>::infinity();
};

// Forbidden when every axis is inside its side. A rotary axis is inside again after every turn.
struct ForbiddenBox {
    std::string name;
    std::vector<AxisInterval> sides;  // one per axis, mm or rad; unbounded: wherever it is
};

struct MotionRules {
    std::vector<ForbiddenBox> forbidden;
    // Motions that come nearer to a forbidden box than this, one per axis, mm or rad, are made at
    // this share of the axes' speeds. Empty: nothing is slow.
    std::vector<double> slow_margin;
    double slow_share = 1.0;
};

// Of the `stage` section of station.yaml, mm and degrees, both optional; an axis that is not named
// is unbounded (forbidden) or has the margin 0 (slow_near). Throws ConfigError.
//     forbidden: [{name: lens, x: [-20, 20], z: [100, 160]}]
//     slow_near: {margin: {x: 5, z: 10}, speed_share: 0.2}
MotionRules read_motion_rules(const Value& stage, std::span<const Axis> axes);

// One motion of some axes together, from rest to rest.
struct MotionSegment {
    std::vector<double> from, to;   // one per axis, mm or rad
    double speed_share = 1.0;       // of each axis' speed
    Duration time{};                // at these speeds, without ramps and settling
    std::vector<std::string> near;  // forbidden boxes that make it slow
};

// Targets keep this distance from forbidden boxes, and ways half of it: an axis at rest may read a
// little off its target and must still be allowed to go on.
constexpr double clearance_mm = 0.1;
constexpr double clearance_deg = 0.1;

// Throws ConfigError at `place` for a target outside the soft limits or in a forbidden box.
void require_allowed(std::span<const Axis> axes, const MotionRules& rules,
                     std::span<const double> target, const SourcePlace& place);

// Whether the target and its approach are clear of every forbidden box. Ignores the limits.
bool is_clear(std::span<const Axis> axes, const MotionRules& rules, std::span<const double> target);

// The motions that take the axes from where they are to the target, the quickest that is free, at
// the end approaching from each axis' declared side. One segment at least. Throws ConfigError at
// `place` when the target is not allowed, the axes are inside a forbidden box, or no way is found.
std::vector<MotionSegment> plan_motion(std::span<const Axis> axes, const MotionRules& rules,
                                       std::span<const double> from, std::span<const double> target,
                                       const SourcePlace& place);

// The stage that a station drives: another one, within the rules of station.yaml. Each move is
// planned from the positions read, in as many motions as needed. Homing knows no rules.
class LimitedStage final : public Stage {
public:
    // `rules` belong to the stage's axes. Throws ConfigError when an axis cannot be as slow as they
    // ask for.
    LimitedStage(std::unique_ptr<Stage> stage, MotionRules rules)
        : stage_(std::move(stage)), rules_(std::move(rules)) {
        stage_->limit_speed(rules_.slow_share);
        stage_->limit_speed(speed_share_);
    }

    const std::vector<Axis>& axes() const override { return stage_->axes(); }
    void enable(std::stop_token stop) override { stage_->enable(stop); }
    void home(std::stop_token stop) override { stage_->home(stop); }
    void resume() override { stage_->resume(); }
    void take_for_homed() override { stage_->take_for_homed(); }

    // Throws ConfigError, before anything moves, for a target not allowed or without a way.
    void move(std::span<const double> target, std::stop_token stop) override {
        // Not position(): an axis that was homed to its limit switch stands there, and may leave.
        std::vector<double> from;
        for (const AxisStatus& status : stage_->status())
            from.push_back(status.position);
        for (const MotionSegment& segment :
             plan_motion(axes(), rules_, from, target, {"stage", 0, "move"})) {
            stage_->limit_speed(std::min(speed_share_, segment.speed_share));
            stage_->move(segment.to, stop);
        }
    }

    // An upper limit: slow zones stay as slow as they are.
    void limit_speed(double share) override {
        stage_->limit_speed(share);  // refuses what is none
        speed_share_ = share;
    }

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
