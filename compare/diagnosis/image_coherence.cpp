#include "compare/diagnosis/image_coherence.h"

#include <algorithm>
#include <cmath>

#include "core/program/errors.h"

namespace etalon {
namespace {

// Sums of the residuals by bin: x and y of each bin below one another, a column for each pose; and
// how many corners they are of.
struct BinnedResiduals {
    Eigen::MatrixXd sums, counts;
};

BinnedResiduals binned(std::span<const PoseResiduals> poses, int width, int height, double bin_px) {
    const auto bins_along = [bin_px](int pixels) {
        return static_cast<Eigen::Index>(std::ceil(pixels / bin_px));
    };
    const Eigen::Index across = bins_along(width), down = bins_along(height);
    BinnedResiduals bins{Eigen::MatrixXd::Zero(2 * across * down, std::ssize(poses)),
                         Eigen::MatrixXd::Zero(across * down, std::ssize(poses))};
    const auto bin_of = [bin_px](double place, Eigen::Index count) {
        return std::clamp(static_cast<Eigen::Index>(std::floor(place / bin_px)), Eigen::Index{0},
                          count - 1);
    };
    for (Eigen::Index i = 0; i < std::ssize(poses); ++i) {
        const auto& [place, left] = poses[static_cast<std::size_t>(i)];
        for (Eigen::Index k = 0; k + 1 < place.size(); k += 2) {
            const Eigen::Index bin = bin_of(place[k + 1], down) * across + bin_of(place[k], across);
            bins.sums.col(i).segment<2>(2 * bin) += left.segment<2>(k);
            bins.counts(bin, i) += 1.0;
        }
    }
    return bins;
}

double mean_square(std::span<const PoseResiduals> poses) {
    double squares = 0.0, corners = 0.0;
    for (const PoseResiduals& pose : poses) {
        squares += pose.left.squaredNorm();
        corners += 0.5 * static_cast<double>(pose.left.size());
    }
    return squares / corners;
}

// Sum over all pairs of different poses.
double off_diagonal(const Eigen::MatrixXd& square) {
    return 0.5 * (square.sum() - square.trace());
}

ImageCoherence coherence_in(std::span<const PoseResiduals> poses, int width, int height,
                            double bin_px) {
    const BinnedResiduals bins = binned(poses, width, height, bin_px);
    const Eigen::MatrixXd products = bins.sums.transpose() * bins.sums;
    const double sum = off_diagonal(products), variance = off_diagonal(products.cwiseAbs2());
    const double pairs = off_diagonal(bins.counts.transpose() * bins.counts);
    if (!(variance > 0.0) || !(pairs > 0.0))
        return {0.0, 0.0, bin_px};
    return {sum / std::sqrt(variance), std::clamp(sum / pairs / mean_square(poses), 0.0, 1.0),
            bin_px};
}

}  // namespace

ImageCoherence image_coherence(std::span<const PoseResiduals> poses, int width, int height) {
    for (const PoseResiduals& pose : poses)
        if (pose.place_px.size() != pose.left.size() || !pose.place_px.allFinite() ||
            !pose.left.allFinite())
            throw NumericalError("image coherence: places and residuals do not agree");
    ImageCoherence largest;
    for (const double parts : {24.0, 12.0, 6.0}) {
        const ImageCoherence one =
            coherence_in(poses, width, height, std::hypot(width, height) / parts);
        if (largest.bin_px == 0.0 || one.deviations > largest.deviations)
            largest = one;
    }
    return largest;
}

}  // namespace etalon
