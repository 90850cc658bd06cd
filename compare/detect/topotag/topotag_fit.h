// The image of a TopoTag fitted to an image's pixels: vertices to a hundredth of a pixel.
//
// A centroid is not where a node's centre is seen (perspective), and is pulled by what is near.
// Here every vertex has a window, node and half the gap around it, in which
//
//     pixel = dark + (step + g_x x + g_y y) m(p - shift)
//
// is fitted by least squares, with m the tag's image after the homography of all vertices, its
// edges blurred by pixels and lens. Light may thus change over a node. A tone curve or spreading
// ink moves black edges inwards or outwards: that, the blur, and whether the dot is there (an
// amplitude from 0 to 1) are fitted too, the first two for all windows together. The shift need not
// obey the homography: lens distortion stays in the vertices, where the pose wants it. Three times,
// each with m from what was found before.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

namespace etalon {

struct TopotagFit {
    int id = 0;
    std::vector<Eigen::Vector2d> vertices;  // px, row by row
    double step = 0.0;                      // white - black, median of the windows
    double blur_px = 0.0;                   // standard deviation of an edge's blur
    double white_growth_px = 0.0;           // how far edges lie towards the black
    double explained = 0.0;                 // of the windows' variance, 0 to 1
};

// `pixels` is CV_32FC1 and `vertices` are near those of a tag of this family, to a cell or so.
// Nothing when a window leaves the image, there is not enough contrast all over the tag, the tag
// explains too little of what is seen, or a dot is neither there nor not there. CPU time 1 to 3 ms.
std::optional<TopotagFit> fit_topotag(const cv::Mat& pixels, const std::string& family,
                                      const std::vector<Eigen::Vector2d>& vertices);

// The homography of least squares in px that takes the vertices' cells to pixels; nothing when
// points are degenerate.
std::optional<Eigen::Matrix3d> pixel_from_cell(int order,
                                               const std::vector<Eigen::Vector2d>& vertices);

}  // namespace etalon
