// Watches the points of a static target frame by frame: how fast their image drifts, whether that
// is below the limit, and whether something jumped.
//
// Time is cut into blocks. Whenever one is full the drift over the last 20, 40 and 80 is estimated:
// a short window sees the end of a warm-up soon, a long one averages noise. A jump begins a new
// part with the frames after it.
#pragma once

#include <Eigen/Core>
#include <chrono>
#include <deque>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/image/image.h"

namespace etalon {

// Of a target that is to be followed.
inline constexpr std::size_t min_target_points = 4;

// Pixel by the point's index on the target.
using TargetPoints = std::map<int, Eigen::Vector2d>;

// How the target's image moves, by least squares: shift x, shift y, growth, turn, px. Growth and
// turn (clockwise as seen) are what they move a point by that is one `radius` from the middle: with
// equal noise of every coordinate the four are uncorrelated and equally noisy.
using Movement = Eigen::Vector4d;

class TargetReference {
public:
    // Throws NumericalError for fewer than 4 points or points that are all in one place.
    explicit TargetReference(TargetPoints points);

    const TargetPoints& points() const { return points_; }
    const Eigen::Vector2d& centre() const { return centre_; }
    double radius() const { return radius_; }  // root mean square distance from the middle, px

    struct Look {
        Movement movement;
        TargetPoints residuals;  // what the movement leaves of each point's displacement
    };
    // From the points that both have. Nothing when these are fewer than 4 or than half of the
    // reference, or in one place.
    std::optional<Look> look(const TargetPoints& points) const;

    // What a movement does at a pixel: displacement = at(pixel) * movement.
    Eigen::Matrix<double, 2, 4> at(const Eigen::Vector2d& pixel) const;

    // The largest displacement among the reference's points, px.
    double largest(const Movement& movement) const;

private:
    TargetPoints points_;
    Eigen::Vector2d centre_ = Eigen::Vector2d::Zero();
    double radius_ = 0.0;
};

// Root mean square of a coordinate of a movement's residuals, px, less its 4 degrees of freedom; 0
// for up to two points.
double misfit(const TargetPoints& residuals);

// The points of a target in a photograph; empty where it is not seen. For one thread.
using TargetFinder = std::function<TargetPoints(const CodeImage&)>;

// Throws ConfigError at `place` for a marker or board without a detector.
TargetFinder make_target_finder(const std::string& spec, const std::string& place);

using Minutes = std::chrono::duration<double, std::ratio<60>>;

struct DriftBlock {
    Minutes time{};          // mean of its frames
    Movement movement;       // median of its frames, each of the four
    TargetPoints residuals;  // the same of each point
};

struct DriftRate {
    Minutes from{}, to{};           // the first and the last block
    Movement per_min;               // px/min, see Movement
    Movement standard_uncertainty;  // of each
    double worst_px_per_min = 0.0;  // the largest drift over the image, at one of its four corners
    Eigen::Vector2d worst_pixel = Eigen::Vector2d::Zero();
    double standard_uncertainty_px_per_min = 0.0;  // of the worst
    double coverage_factor = 0.0;
    double expanded_uncertainty_px_per_min = 0.0;  // their product
    double bound_px_per_min = 0.0;                 // largest value + U of the image's corners
    double shape_px_per_min = 0.0;   // of the points against each other, RMS, noise included
    double block_correlation = 0.0;  // of neighbouring blocks' residuals; 0 where it is negative

    bool below(double limit_px_per_min) const {
        return bound_px_per_min < limit_px_per_min && shape_px_per_min < limit_px_per_min;
    }
};

inline constexpr std::size_t min_blocks = 15;

// A straight line through the medians of the blocks, whose scatter about it is the uncertainty;
// correlated neighbours widen it (Santer et al., J. Geophys. Res. 105, 7337, 2000). By hand:
// docs/cameras.md, "Drift". A true worst drift >= limit has bound < limit with at most the
// probability `chance_of_error`. Nothing for fewer than min_blocks blocks or blocks at one time.
// Times must rise.
std::optional<DriftRate> estimate_drift(std::span<const DriftBlock> blocks,
                                        const TargetReference& reference, cv::Size image,
                                        double chance_of_error);

struct TargetJump {
    int frames_after = 0;  // how many of the last frames came after it
    Movement movement;
};

// Tells a jump of a static target's image from its drift and its noise. The medians of the last
// five frames and of the five before them are compared. Their difference by drift is the median of
// earlier such differences; that by noise follows from the scatter of these or of the steps from
// frame to frame, the larger. The threshold is Student's quantile at a chance of 1e-7 per frame and
// component.
class JumpFinder {
public:
    // The jump that this frame shows, 3 frames or more ago; none in the first 20 frames and below
    // 0.01 px.
    std::optional<TargetJump> add(const Movement& movement);

    // Movements now have another reference. What was learnt of noise and drift stays.
    void restart() { recent_.clear(); }

private:
    bool is_jump(const Movement& difference) const;
    double noise_of_difference(int component_index) const;

    std::deque<Movement> recent_;       // the last ten
    std::deque<Movement> steps_;        // from frame to frame
    std::deque<Movement> differences_;  // of the medians
};

struct DriftPlan {
    cv::Size image;
    double limit_px_per_min = 0.02;
    Minutes block{0.25};
    int judgements = 1;  // how many windows can come to be judged

    static constexpr double chance_of_error = 0.05;  // over all of them
};

// A plan whose blocks are 15 s, or an interval between frames where this is longer.
DriftPlan drift_plan(cv::Size image, Minutes interval, Minutes longest);

// What a frame showed, for the record.
struct DriftFrame {
    Minutes time{};
    bool seen = false;
    int part = 0;                          // counts the jumps before it
    Movement movement = Movement::Zero();  // since the part's first frame
    double radius_px = 0.0;                // of the part's reference, see Movement
    double misfit_px = 0.0;                // what the movement does not explain
};

struct DriftJump {
    Minutes time{};        // of the first frame after it
    double size_px = 0.0;  // largest displacement of a point of the target
    Movement movement;
    double radius_px = 0.0;
};

class DriftMonitor {
public:
    explicit DriftMonitor(const DriftPlan& plan) : plan_(plan) {}

    // A frame's points; none where the target was not seen. Times must rise.
    void add(Minutes time, const TargetPoints& points);

    const DriftPlan& plan() const { return plan_; }
    const std::vector<DriftFrame>& frames() const { return frames_; }
    // Whenever a block was full: of its windows the one with the lowest bound.
    const std::vector<DriftRate>& rates() const { return rates_; }
    const std::vector<DriftJump>& jumps() const { return jumps_; }
    // By the last rate, unless something jumped since then.
    bool stable() const {
        return !rates_.empty() && fresh_ && rates_.back().below(plan_.limit_px_per_min);
    }

    // Standard deviation of a coordinate from frame to frame: of a point against the others, and of
    // the whole target. Medians over all frames; nothing before the second.
    std::optional<double> point_noise_px() const;
    std::optional<double> shake_px() const;

private:
    struct Seen {
        Minutes time;
        TargetPoints points;
    };

    void look(const Seen& seen);
    void note_noise(const TargetReference::Look& look);
    void put_into_block(Minutes time, const TargetReference::Look& look);
    void judge();
    void start_anew(const TargetJump& jump);

    DriftPlan plan_;
    std::vector<DriftFrame> frames_;
    std::vector<DriftRate> rates_;
    std::vector<DriftJump> jumps_;
    bool fresh_ = false;  // the last rate belongs to this part

    // This part's.
    std::optional<TargetReference> reference_;
    Minutes part_start_{};
    std::deque<Seen> last_seen_;
    std::vector<std::pair<Minutes, TargetReference::Look>> block_;
    long block_number_ = 0;
    std::vector<DriftBlock> blocks_;  // the last 80
    std::optional<TargetReference::Look> last_look_;

    JumpFinder jump_finder_;
    std::vector<double> point_noise_, shake_;
};

}  // namespace etalon
