// TopoTags behind the Detector interface.
#pragma once

#include <opencv2/core.hpp>

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "compare/detect/detector.h"

namespace etalon {

// TopoTags in an image, by their topology: a white region that holds n^2 - 1 black nodes, one of
// which, the baseline, has two white dots and the others one or none
// (sim/marker/topotag_pattern.h).
//
//   1. The image at twice, once, half, a quarter... of its size; in each a pixel is black when it
//      is darker than the mean of the square around it. One of these squares is as wide as four to
//      eight cells of the tag, whatever its size: wider than a node, narrower than the tag.
//   2. The regions and what encloses what (compare/detect/topotag/region_tree.h); white regions
//   with the
//      right number of nodes. Specks, far smaller than nodes and dots, do not count.
//   3. The centroids of nodes and of the baseline's dots, matched with the vertices: the largest
//      quadrangle is that of the corner vertices, the dot among its corners is the first one.
//   4. A homography through all n^2 points. All must fit.
//   5. The image of this tag fitted to the pixels (compare/detect/topotag/topotag_fit.h): sub-pixel
//      vertices, and whether each dot is really there. What does not look like the tag all over is
//      none.

struct FoundTopotag {
    int id = 0;
    std::vector<Eigen::Vector2d> vertices;  // px, row by row
};

// All tags of a family in an image: CV_8UC1, full scale 255, and the same with all its bits as
// CV_32FC1 in which the vertices are measured. Safe from every thread; some 6 ms for 640 x 480.
std::vector<FoundTopotag> find_topotags(const cv::Mat& eight_bit, const cv::Mat& pixels,
                                        const std::string& family);

// The TopoTag finder of compare/detect/topotag/topotag_detector.h. ConfigError at `place` for any
// other marker.
std::unique_ptr<Detector> make_topotag_detector(const Marker& marker, const std::string& place);

}  // namespace etalon
