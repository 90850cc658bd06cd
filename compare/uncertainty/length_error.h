// Length error: by how much the distance between two positions of the marker comes out too long,
// without registration and constant offsets. After ISO 10360 and VDI/VDE 2634, over all pairs of
// hold-out poses. What the smooth field does to lengths is judged.
#pragma once

#include "compare/uncertainty/bias_field.h"

namespace etalon {

struct LengthErrors {
    int pairs = 0;
    double longest_mm = 0.0;                              // distance between two poses
    double measured_rms_mm = 0.0, measured_max_mm = 0.0;  // of the single pairs, noise included
    double field_max_mm = 0.0;  // largest |error| that the field makes, over all pairs, and where
    double field_max_length_mm = 0.0;  // distance of that pair
    // The 97.7 % quantile of what noise alone makes of it: a simultaneous band over all pairs.
    double field_max_uncertainty_mm = 0.0;
};

// `samples` are those that the field was fitted to, `draws` are behind the band. Throws
// NumericalError for less than two samples. Some 10 ms for 70 samples.
LengthErrors length_errors(const BiasField& field, std::span<const FieldSample> samples,
                           const NoiseDraws& draws);

// By how much shifts of the samples lengthen the distances of all their pairs, to first order.
class PairLengthening {
public:
    explicit PairLengthening(std::span<const FieldSample> samples);

    Eigen::Index size() const { return n_ * (n_ - 1) / 2; }

    // A row for each pair from `first` on. `shifts` have 3 rows for each sample and any number of
    // columns. Zeros for two poses in the same place.
    Eigen::MatrixXd of(const Eigen::MatrixXd& shifts, Eigen::Index first, Eigen::Index count) const;

    // The pair whose row of `shifts` is the longest, and how long that is; nothing is 0.
    struct Largest {
        double lengthening = 0.0;
        Eigen::Index pair = 0;
    };
    Largest largest(const Eigen::MatrixXd& shifts) const;

    double distance_mm(Eigen::Index pair) const;

private:
    std::vector<Eigen::Vector3d> positions_;
    Eigen::Index n_;
};

constexpr Eigen::Index pairs_at_a_time = 1024;  // their rows stay in the cache

}  // namespace etalon
