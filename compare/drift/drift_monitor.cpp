#include "compare/drift/drift_monitor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/program/errors.h"
#include "core/statistics/distributions.h"
#include "core/statistics/median.h"

namespace etalon {
namespace {

constexpr std::size_t frames_to_look_back = 10;            // of JumpFinder
constexpr std::array<std::size_t, 3> windows{20, 40, 80};  // blocks

DriftBlock median_of(const std::vector<std::pair<Minutes, TargetReference::Look>>& frames) {
    DriftBlock block;
    std::vector<double> values[4];
    std::map<int, std::pair<std::vector<double>, std::vector<double>>> residuals;
    for (const auto& [time, look] : frames) {
        block.time += time / static_cast<double>(frames.size());
        for (int i = 0; i < 4; ++i)
            values[i].push_back(look.movement[i]);
        for (const auto& [id, residual] : look.residuals) {
            residuals[id].first.push_back(residual.x());
            residuals[id].second.push_back(residual.y());
        }
    }
    for (int i = 0; i < 4; ++i)
        block.movement[i] = median(values[i]);
    for (const auto& [id, xy] : residuals)
        block.residuals[id] = {median(xy.first), median(xy.second)};
    return block;
}

// The median over the true value, of standard deviations from 2 n - 4 normal values.
double median_over_deviation(std::size_t points) {
    const double freedoms = 2.0 * static_cast<double>(std::max<std::size_t>(points, 3)) - 4.0;
    return std::sqrt(reduced_chi_square(0.0, freedoms));
}

}  // namespace

DriftPlan drift_plan(cv::Size image, Minutes interval, Minutes longest) {
    DriftPlan plan;
    plan.image = image;
    plan.block = std::max(plan.block, interval);
    const double blocks = std::floor(longest / plan.block);
    plan.judgements =
        std::max(1, static_cast<int>(windows.size() * std::max(0.0, blocks - min_blocks + 1)));
    return plan;
}

void DriftMonitor::add(Minutes time, const TargetPoints& points) {
    frames_.push_back({.time = time, .part = static_cast<int>(jumps_.size())});
    if (points.size() >= min_target_points)
        look({time, points});
}

void DriftMonitor::look(const Seen& seen) {
    if (!reference_) {
        reference_.emplace(seen.points);
        part_start_ = seen.time;
    }
    const auto look = reference_->look(seen.points);
    if (!look)
        return;
    DriftFrame& frame = *std::find_if(frames_.rbegin(), frames_.rend(),
                                      [&](const DriftFrame& f) { return f.time == seen.time; });
    frame = {seen.time,
             true,
             static_cast<int>(jumps_.size()),
             look->movement,
             reference_->radius(),
             misfit(look->residuals)};
    last_seen_.push_back(seen);
    if (last_seen_.size() > frames_to_look_back)
        last_seen_.pop_front();
    note_noise(*look);
    if (const auto jump = jump_finder_.add(look->movement))
        return start_anew(*jump);
    put_into_block(seen.time, *look);
}

void DriftMonitor::note_noise(const TargetReference::Look& look) {
    if (last_look_) {
        TargetPoints steps;
        for (const auto& [id, residual] : look.residuals)
            if (const auto before = last_look_->residuals.find(id);
                before != last_look_->residuals.end())
                steps[id] = (residual - before->second) / std::numbers::sqrt2;
        point_noise_.push_back(misfit(steps) / median_over_deviation(steps.size()));
        const Movement step = (look.movement - last_look_->movement) / std::numbers::sqrt2;
        shake_.push_back(1.4826 * std::abs(step[0]));
        shake_.push_back(1.4826 * std::abs(step[1]));
    }
    last_look_ = look;
}

void DriftMonitor::put_into_block(Minutes time, const TargetReference::Look& look) {
    const auto number = static_cast<long>(std::floor((time - part_start_) / plan_.block));
    if (number != block_number_ && !block_.empty())
        close_block();
    block_number_ = number;
    block_.emplace_back(time, look);
}

void DriftMonitor::close_block() {
    blocks_.push_back(median_of(block_));
    block_.clear();
    if (blocks_.size() > windows.back())
        blocks_.erase(blocks_.begin());
    judge();
}

void DriftMonitor::judge() {
    std::optional<DriftRate> best;
    for (const std::size_t window : windows) {
        const std::size_t count = std::min(window, blocks_.size());
        const auto rate = estimate_drift(std::span(blocks_).last(count), *reference_, plan_.image,
                                         DriftPlan::chance_of_error / plan_.judgements);
        if (rate && (!best || rate->bound_px_per_min < best->bound_px_per_min))
            best = rate;
        if (count < window)
            break;
    }
    if (best)
        rates_.push_back(*best);
    fresh_ = best.has_value();
}

void DriftMonitor::start_anew(const TargetJump& jump) {
    const std::vector<Seen> after(last_seen_.end() - jump.frames_after, last_seen_.end());
    jumps_.push_back({after.front().time, reference_->largest(jump.movement), jump.movement,
                      reference_->radius()});
    fresh_ = false;
    reference_.reset();
    last_seen_.clear();
    last_look_.reset();
    block_.clear();
    block_number_ = 0;
    blocks_.clear();
    jump_finder_.restart();
    for (const Seen& seen : after)
        look(seen);
}

std::optional<double> DriftMonitor::point_noise_px() const {
    return point_noise_.empty() ? std::nullopt : std::optional(median(point_noise_));
}

std::optional<double> DriftMonitor::shake_px() const {
    return shake_.empty() ? std::nullopt : std::optional(median(shake_));
}

}  // namespace etalon
