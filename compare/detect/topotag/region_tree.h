// The connected regions of a two-level image and which of them encloses which: topology, for
// markers that are told by it.
//
// White regions are joined over corners too (8 neighbours), black ones over edges only (4): with
// these two, every region but the outermost one has exactly one region around it (Rosenfeld,
// "Connectivity in digital pictures", J. ACM 17, 1970). Outside the image all is white.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

namespace etalon {

struct Region {
    int parent = -1;  // index of the region around it; -1 of the outermost one
    bool is_dark = false;
    double area = 0.0;                              // px
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();  // of the pixels' positions
};

class RegionTree {
public:
    // `dark` is CV_8UC1, 255 or 0 (white). About a ns a pixel and 20 a run of equal pixels.
    explicit RegionTree(const cv::Mat& dark);

    // Region 0 is the outermost one. Every region comes after its parent.
    const std::vector<Region>& regions() const { return regions_; }
    std::span<const int> children(int region) const;

private:
    std::vector<Region> regions_;
    std::vector<int> children_, first_child_;  // of region i: from first_child_[i]
};

}  // namespace etalon
