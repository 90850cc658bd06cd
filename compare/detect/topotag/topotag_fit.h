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

#include <opencv2/core.hpp>

#include <Eigen/Core>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "sim/marker/topotag_pattern.h"

namespace etalon {

// How a TopoTag's shapes are seen around a node: black and white with blurred edges, and how that
// changes with place, blur and the edges' own shift. For compare/detect/topotag/topotag_fit.h.
//
// The blur (pixels and lens) is taken as normal: an edge is a normal distribution in the distance
// from it. That is exact along straight edges, and symmetric about each shape's centre everywhere,
// which is what a vertex's place hangs on. Where edges are nearer to each other than some sigmas,
// shapes are painted over each other as if each had been blurred alone.

// A value with its derivatives by the place on the tag (per cell), by the logarithm of the blur and
// by the growth of what is white (per px).
struct Shade {
    double value = 0.0;  // 0 black, 1 white
    Eigen::Vector4d slope = Eigen::Vector4d::Zero();
};

// Edges as they are seen around a node, in cells: blurred, and all moved towards the black.
struct SeenEdges {
    SeenEdges(double blur, double growth_px, const Eigen::Matrix2d& cell_per_px)
        : covariance(blur * blur * cell_per_px * cell_per_px.transpose()),
          sigma(covariance.diagonal().cwiseSqrt()),
          area(std::sqrt(covariance.determinant())),
          blur_px(blur),
          growth_in_sigmas(growth_px / blur) {}

    Eigen::Matrix2d covariance;
    Eigen::Vector2d sigma;  // along the tag's axes
    double area, blur_px, growth_in_sigmas;
};

// How much of a point (in cells) a shape covers.
Shade cover(const TopotagShape& shape, const Eigen::Vector2d& cell, const SeenEdges& edges);

// Those shapes of which something is seen between two corners, in the order of painting.
std::vector<TopotagShape> shapes_between(const Eigen::Vector2d& low, const Eigen::Vector2d& high,
                                         std::span<const TopotagShape> shapes,
                                         const SeenEdges& edges);

// All painted over each other on black.
Shade shade(std::span<const TopotagShape> shapes, const Eigen::Vector2d& cell,
            const SeenEdges& edges);

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
