// What the calibration files of other programs have in common: a camera matrix and a list of
// distortion coefficients, checked here once for all formats.
#pragma once

#include <string>
#include <vector>

#include "calib/camera_model.h"
#include "core/errors.h"

namespace etalon {

// A matrix of a file, row by row, with its place there.
struct ForeignMatrix {
    SourcePlace place;
    int rows = 0, cols = 0;
    std::vector<double> values;
};

// The camera of a 3x3 matrix [fx 0 cx; 0 fy cy; 0 0 1] and of 4, 5, 8, 12 or 14 coefficients in
// OpenCV's order, as a row or a column. The image size is left 0.
// Throws ConfigError at the matrix that is something else.
CameraModel camera_from_matrices(const ForeignMatrix& camera_matrix,
                                 const ForeignMatrix& distortion);

// A whole number of pixels, 1 to 100 000. Throws ConfigError at `place` otherwise.
int checked_image_side(double value, const SourcePlace& place);

}  // namespace etalon
