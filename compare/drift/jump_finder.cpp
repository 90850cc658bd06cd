#include "compare/drift/jump_finder.h"

#include <cmath>
#include <span>

#include "core/statistics/distributions.h"
#include "core/statistics/median.h"

namespace etalon {
namespace {

constexpr std::size_t half = 5;  // frames before and after
constexpr std::size_t min_steps = 20, max_steps = 300;
constexpr double chance_of_false_jump = 1e-7;  // per frame and component
constexpr double min_jump_px = 0.01;

// Of normal values: standard deviation of the difference of two medians of five over that of the
// difference of two values. The variance of a median of five is 0.2868 (Teichroew 1956).
const double medians_over_steps = std::sqrt(0.2868);

// A standard deviation from the median deviation of n values is as uncertain as the usual one of
// 0.37 n values.
constexpr double median_efficiency = 0.37;

std::vector<double> component(const std::deque<Movement>& movements, int index) {
    std::vector<double> values;
    for (const Movement& movement : movements)
        values.push_back(movement[index]);
    return values;
}

Movement medians(std::span<const Movement> movements) {
    Movement result;
    for (int i = 0; i < 4; ++i) {
        std::vector<double> values;
        for (const Movement& movement : movements)
            values.push_back(movement[i]);
        result[i] = median(std::move(values));
    }
    return result;
}

void push(std::deque<Movement>& movements, const Movement& movement, std::size_t most) {
    movements.push_back(movement);
    if (movements.size() > most)
        movements.pop_front();
}

}  // namespace

double JumpFinder::noise_of_difference(int component_index) const {
    return std::max(medians_over_steps * median_deviation(component(steps_, component_index)),
                    median_deviation(component(differences_, component_index)));
}

bool JumpFinder::is_jump(const Movement& difference) const {
    if (steps_.size() < min_steps || differences_.size() < half)
        return false;
    const int freedoms = static_cast<int>(median_efficiency * static_cast<double>(steps_.size()));
    for (int i = 0; i < 4; ++i) {
        const double by_drift = median(component(differences_, i));
        const double size = std::abs(difference[i] - by_drift);
        if (size > min_jump_px && size > student_t_quantile(0.5 * chance_of_false_jump, freedoms) *
                                             noise_of_difference(i))
            return true;
    }
    return false;
}

// Where the last frames fall into two parts, and how far apart these are.
TargetJump JumpFinder::largest_step() const {
    const std::vector<Movement> frames(recent_.begin(), recent_.end());
    std::size_t first_after = 1;
    for (std::size_t i = 2; i < frames.size(); ++i)
        if ((frames[i] - frames[i - 1]).norm() >
            (frames[first_after] - frames[first_after - 1]).norm())
            first_after = i;
    const std::span<const Movement> all(frames);
    return {static_cast<int>(frames.size() - first_after),
            medians(all.subspan(first_after)) - medians(all.first(first_after))};
}

std::optional<TargetJump> JumpFinder::add(const Movement& movement) {
    if (!recent_.empty())
        push(steps_, movement - recent_.back(), max_steps);
    push(recent_, movement, 2 * half);
    if (recent_.size() < 2 * half)
        return std::nullopt;
    const std::vector<Movement> frames(recent_.begin(), recent_.end());
    const Movement difference =
        medians(std::span(frames).last(half)) - medians(std::span(frames).first(half));
    if (is_jump(difference))
        return largest_step();
    push(differences_, difference, max_steps);
    return std::nullopt;
}

}  // namespace etalon
