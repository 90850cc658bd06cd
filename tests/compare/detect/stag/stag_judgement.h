// Right and wrong of what was found in an image of tests/compare/detect/stag/stag_images.h.
#pragma once

#include "compare/detect/stag/stag_detector.h"
#include "tests/compare/detect/stag/stag_images.h"

namespace etalon::test {

struct StagTally {
    int images = 0;
    int found = 0;      // the marker that is there, refined
    int unrefined = 0;  // it was read, but a detector would not report it
    int false_ids = 0;  // refined, with the word of a marker that is not there
    int misplaced = 0;  // refined, the right word, a corner too far off

    StagTally& operator+=(const StagTally& other) {
        images += other.images;
        found += other.found;
        unrefined += other.unrefined;
        false_ids += other.false_ids;
        misplaced += other.misplaced;
        return *this;
    }
};

// A corner may be off by 1 px and a hundredth of the marker's diagonal: the finder promises a
// standard deviation of at most 0.25 px for the worst one, the warped images are good to 0.2 px.
inline StagTally judge(const StagImage& image, const std::vector<FoundStag>& found) {
    StagTally tally;
    tally.images = 1;
    for (const FoundStag& one : found) {
        if (!one.is_refined) {
            ++tally.unrefined;
            continue;
        }
        if (one.id != image.id) {
            ++tally.false_ids;
            continue;
        }
        const double allowed = 1.0 + (image.corners[2] - image.corners[0]).norm() / 100.0;
        bool right = true;
        for (std::size_t i = 0; i < 4; ++i)
            right = right && (one.corners[i] - image.corners[i]).norm() <= allowed;
        ++(right ? tally.found : tally.misplaced);
    }
    return tally;
}

}  // namespace etalon::test
