// TopoTags in an image, by their topology: a white region that holds n^2 - 1 black nodes, one of
// which, the baseline, has two white dots and the others one or none
// (sim/marker/topotag_pattern.h). All functions are safe from every thread.
//
//   1. The image at twice, once, half, a quarter... of its size; in each a pixel is black when it
//      is darker than the mean of the square around it.
//   2. White regions that enclose the right number of nodes, specks aside.
//   3. The centroids of nodes and of the baseline's dots, matched with the vertices: the largest
//      quadrangle is that of the corner vertices, the dot among its corners is the first one.
//   4. A homography through all n^2 points. All must fit.
//   5. fit_topotag(): sub-pixel vertices, and whether each dot is there.
#pragma once

#include <memory>
#include <opencv2/core.hpp>

#include "compare/detect/detector.h"

namespace etalon {

// A connected region of a two-level image.
struct Region {
    int parent = -1;  // index of the region around it; -1 of the outermost one
    bool is_dark = false;
    double area = 0.0;                              // px
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();  // of the pixels' positions
    std::vector<int> children = {};                 // ascending
};

// White regions have 8 neighbours, black ones 4: every region but the outermost one then has
// exactly one region around it (Rosenfeld, J. ACM 17, 1970). Outside the image all is white. Region
// 0 is the outermost one; every region comes after its parent. `dark` is CV_8UC1, 255 or 0 (white).
// Some 5 ns a pixel.
std::vector<Region> region_tree(const cv::Mat& dark);

struct TopotagFit {
    int id = 0;
    std::vector<Eigen::Vector2d> vertices;  // px, row by row
    double step = 0.0;                      // white - black, median of the windows
    double blur_px = 0.0;                   // standard deviation of an edge's blur
    double white_growth_px = 0.0;           // how far edges lie towards the black
    double explained = 0.0;                 // of the windows' variance, 0 to 1
};

// The image of a TopoTag fitted to an image's pixels: vertices to a hundredth of a pixel. Every
// vertex has a window, node and half the gap around it, in which
//
//     pixel = dark + (step + g_x x + g_y y) m(p - shift)
//
// is fitted by least squares, with m the tag's image after the homography of all vertices, its
// edges blurred. Fitted too are the blur and the shift of black edges (tone, print gain) for all
// windows together, and an amplitude of the dot, 0 to 1. The shift need not obey the homography:
// lens distortion stays in the vertices. Three times, each with m from what was found before.
//
// `pixels` is CV_32FC1; `vertices` are right to a cell or so. Nothing when a window leaves the
// image, the contrast is too low, the tag explains too little of what is seen, or a dot is neither
// there nor not there. CPU time 1 to 3 ms.
std::optional<TopotagFit> fit_topotag(const cv::Mat& pixels, const std::string& family,
                                      const std::vector<Eigen::Vector2d>& vertices);

// All tags of a family in an image, the vertices row by row: CV_8UC1, full scale 255, and the same
// with all its bits as CV_32FC1 in which the vertices are measured. Some 6 ms for 640 x 480.
std::vector<DetectedCorners> find_topotags(const cv::Mat& eight_bit, const cv::Mat& pixels,
                                           const std::string& family);

std::unique_ptr<Detector> make_topotag_detector(const Marker& marker);

}  // namespace etalon
