// Tells a jump of a static target's image from its drift and its noise: somebody touched the
// target, the camera or what they stand on.
//
// The medians of the last five frames and of the five before them are compared: two bad frames
// cannot move them. How much they differ by drift is the median of earlier such differences, how
// much by noise follows from the scatter of these and of the steps from frame to frame, whichever
// says more. The threshold is Student's quantile for the number of steps seen, at a chance of 1e-7
// per frame and component: with normal noise a false jump in some 2.5 million frames.
#pragma once

#include <deque>
#include <optional>

#include "compare/drift/target_movement.h"

namespace etalon {

struct TargetJump {
    int frames_after = 0;  // how many of the last frames came after it
    Movement movement;
};

class JumpFinder {
public:
    // The jump that this frame gives away; it then has 3 frames or more behind it. Never before 20
    // frames, and none below 0.01 px.
    std::optional<TargetJump> add(const Movement& movement);

    // Movements now refer to something else: those before are not compared with. What was learnt
    // of noise and drift stays.
    void restart() { recent_.clear(); }

private:
    bool is_jump(const Movement& difference) const;
    double noise_of_difference(int component_index) const;
    TargetJump largest_step() const;

    std::deque<Movement> recent_;       // the last ten
    std::deque<Movement> steps_;        // from frame to frame
    std::deque<Movement> differences_;  // of the medians
};

}  // namespace etalon
