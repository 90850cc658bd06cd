// libapriltag 3 as a finder of all tags of a family in an image. Single tags behind the Detector
// interface: compare/detect/apriltag/apriltag_finder.cpp; boards of them:
// compare/detect/board/tag_board_match.cpp.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "compare/detect/detector_adaptors.h"

namespace etalon {

// Not thread-safe: one per thread. Some 10 ms to make for a family of hundreds of codes.
class ApriltagFinder {
public:
    // The library puts (0, 0) at the corner of the top-left pixel: taken off its coordinates.
    static constexpr double library_offset_px = 0.5;

    // Families of sim/marker/tag_pattern.h; Kalibr prints the classic ones with a border of two
    // cells. Throws ConfigError for an unknown family.
    explicit ApriltagFinder(const std::string& family, int border_cells = 1,
                            const ApriltagOptions& options = {});
    ~ApriltagFinder();

    // `image`: CV_8UC1. Corners include what decimation displaces them by, which is a bias of the
    // library (compare/detect/detector_adaptors.h). The same image gives the same result.
    std::vector<FoundTag> find(cv::Mat image);

private:
    struct Handles;
    std::unique_ptr<Handles> handles_;
};

}  // namespace etalon
