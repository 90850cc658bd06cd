// Length error: by how much the distance between two positions of the marker comes out too long.
// Neither the registered stage pose nor any constant offset is in it, so it stands where absolute
// positions do not. After the length tests of ISO 10360 and VDI/VDE 2634, over all pairs of
// hold-out poses instead of a ball bar in a few places.
//
// Judged is what the smooth field does to lengths; single pairs, reported beside it, carry the
// noise of two poses.
#pragma once

#include <Eigen/SparseCore>
#include <span>

#include "compare/verdict/smooth_field.h"

namespace etalon {

struct LengthErrors {
    int pairs = 0;
    double longest_mm = 0.0;  // distance between two poses
    // Of the single pairs, noise included.
    double measured_rms_mm = 0.0, measured_max_mm = 0.0;
    // Largest |error| that the field makes, over all pairs, and where.
    double field_max_mm = 0.0;
    double field_max_length_mm = 0.0;  // distance of that pair
    // The 97.7 % quantile of what noise alone makes of it: a simultaneous band over all pairs.
    double field_max_uncertainty_mm = 0.0;
};

// `samples` are those that the field was fitted to, `draws` are behind the band. Throws
// NumericalError for less than two samples. Some 10 ms for 70 samples.
LengthErrors length_errors(const SmoothField& field, std::span<const FieldSample> samples,
                           const NoiseDraws& draws);

// One row per pair: what the samples' shifts, stacked by three, do to its length. Zeros for two
// poses in the same place.
using PairLengthening = Eigen::SparseMatrix<double, Eigen::RowMajor>;
PairLengthening pair_lengthening(std::span<const FieldSample> samples);

}  // namespace etalon
