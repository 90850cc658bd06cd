// Watches the points of a static target frame by frame: how fast their image drifts, whether that
// is below the limit, and whether something jumped. Knows nothing of cameras or clocks.
//
// Time is cut into blocks; whenever one is full the drift over the last 20 is estimated, and over
// the last 40 and 80 where there are as many (compare/drift/drift_rate.h): a short window sees the
// end of a warm-up soon, a long one decides where the points are few or noisy. After a jump
// everything starts anew with the frames behind it.
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "compare/drift/drift_rate.h"
#include "compare/drift/jump_finder.h"

namespace etalon {

struct DriftPlan {
    cv::Size image;
    double limit_px_per_min = 0.02;
    Minutes block{0.25};
    // How many windows can come to be judged. The chance to call a camera stable whose drift is as
    // large as the limit is at most 5 % over all of them.
    int judgements = 1;

    static constexpr double chance_of_error = 0.05;
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
    bool stable() const { return !rates_.empty() && fresh_ && rates_.back().below(limit()); }

    // From frame to frame, one standard deviation of a coordinate: of a single point against the
    // others, and of the target as a whole. Medians over all frames; nothing before the second.
    std::optional<double> point_noise_px() const;
    std::optional<double> shake_px() const;

private:
    struct Seen {
        Minutes time;
        TargetPoints points;
    };

    double limit() const { return plan_.limit_px_per_min; }
    void look(const Seen& seen);
    void note_noise(const TargetReference::Look& look);
    void put_into_block(Minutes time, const TargetReference::Look& look);
    void close_block();
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
