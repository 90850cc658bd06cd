// Areas that straight lines cut from a square, as fractions of the square: what a pixel sees past
// one edge and past two crossing edges.
//
// The square is [-1/2, 1/2]^2. Closed form for one line; clipping of the square's outline
// (Sutherland and Hodgman, 1974) for two.
#pragma once

#include <Eigen/Core>

namespace etalon {

// The part offset + gradient . s >= 0 of the square.
struct SquareCut {
    Eigen::Vector2d gradient;
    double offset;
    double area;  // of the part
};

// Any finite values; a zero gradient gives 0 or 1.
SquareCut square_cut(const Eigen::Vector2d& gradient, double offset);

// The inverse: the offset of the cut that has this area, 0..1. Needs a gradient that is not zero.
double offset_of_area(const Eigen::Vector2d& gradient, double area);

// Fraction of the square that lies in both parts.
double square_wedge_area(const SquareCut& a, const SquareCut& b);

}  // namespace etalon
