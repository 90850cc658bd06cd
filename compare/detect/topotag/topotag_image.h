// How a TopoTag's shapes are seen around a node: black and white with blurred edges, and how that
// changes with place, blur and the edges' own shift. For compare/detect/topotag/topotag_fit.h.
//
// The blur (pixels and lens) is taken as normal: an edge is a normal distribution in the distance
// from it. That is exact along straight edges, and symmetric about each shape's centre everywhere,
// which is what a vertex's place hangs on. Where edges are nearer to each other than some sigmas,
// shapes are painted over each other as if each had been blurred alone.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "sim/marker/topotag_pattern.h"

namespace etalon {

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

}  // namespace etalon
