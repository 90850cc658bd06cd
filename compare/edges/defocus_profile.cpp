#include "compare/edges/defocus_profile.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "compare/edges/edge_fit.h"
#include "core/program/errors.h"
#include "core/statistics/covariance.h"

namespace etalon {
namespace {

// An edge that was measured in both images.
struct Width {
    double inverse_depth;  // mean along the edge, 1/mm
    double measured_px2, deviation_px2;
    double rendered_px2;
};

struct Variance {
    double value = 0.0, deviation = 0.0;
};

// A Gaussian's variance behind the pixel's box, px^2 along the normal.
Variance variance_of(const StraightEdge& edge) {
    const EdgeFit fit = fit_edges({&edge, 1}, gaussian_width());
    return {fit.parameters[0], std::sqrt(fit.covariance(0, 0))};
}

// Both lists are in the grid's order; each may lack edges that the other has.
std::vector<Width> widths_of(std::span<const StraightEdge> photo,
                             std::span<const StraightEdge> rendering) {
    constexpr double min_deviation_px2 = 1e-4;  // the measurement's own errors
    std::vector<Width> widths;
    std::size_t next = 0;
    for (const StraightEdge& edge : photo) {
        const auto same = std::find_if(
            rendering.begin() + static_cast<std::ptrdiff_t>(next), rendering.end(),
            [&](const StraightEdge& other) { return other.centre_px == edge.centre_px; });
        if (same == rendering.end())
            continue;
        next = static_cast<std::size_t>(same - rendering.begin()) + 1;
        const Variance measured = variance_of(edge);
        widths.push_back({edge.depth_term, measured.value,
                          std::max(measured.deviation, min_deviation_px2),
                          variance_of(*same).value});
    }
    return widths;
}

struct InverseDepths {
    double nearest = 0.0, farthest = 0.0;  // 1/mm: the nearest is the largest
};

InverseDepths inverse_depths(std::span<const Width> widths) {
    const auto [low, high] = std::minmax_element(
        widths.begin(), widths.end(),
        [](const Width& a, const Width& b) { return a.inverse_depth < b.inverse_depth; });
    return {high->inverse_depth, low->inverse_depth};
}

// The lowest point of the weighted least-squares parabola through (inverse depth, width).
WidthMinimum minimum_of(std::span<const Width> widths, double Width::*width) {
    constexpr std::size_t min_edges = 12;
    constexpr double max_uncertainty = 0.1;  // of the range of inverse depths
    WidthMinimum minimum;
    if (widths.size() < min_edges) {
        minimum.undetermined =
            fmt::format("{} edges, at least {} are needed", widths.size(), min_edges);
        return minimum;
    }
    const InverseDepths range = inverse_depths(widths);
    const double middle = 0.5 * (range.nearest + range.farthest);
    const double scale = 0.5 * (range.nearest - range.farthest);
    const auto rows = static_cast<Eigen::Index>(widths.size());
    Eigen::MatrixXd design(rows, 3);
    Eigen::VectorXd right(rows);
    for (Eigen::Index i = 0; i < rows; ++i) {
        const Width& one = widths[static_cast<std::size_t>(i)];
        const double x = (one.inverse_depth - middle) / scale;
        design.row(i) << 1.0, x, x * x;
        design.row(i) /= one.deviation_px2;
        right[i] = one.*width / one.deviation_px2;
    }
    const auto inverse = covariance_from_information(design.transpose() * design);
    const std::string depths =
        fmt::format("between {:.1f} and {:.1f} mm", 1.0 / range.nearest, 1.0 / range.farthest);
    if (!(scale > 0.0) || !inverse) {
        minimum.undetermined = "the edges are all at one depth";
        return minimum;
    }
    const Eigen::Vector3d c = *inverse * (design.transpose() * right);
    const double chi_square =
        (right - design * c).squaredNorm() / static_cast<double>(widths.size() - 3);
    const Eigen::Matrix3d covariance = std::max(1.0, chi_square) * *inverse;
    const double place = -0.5 * c[1] / c[2];  // in units of the range
    const Eigen::Vector3d by_c(0.0, -0.5 / c[2], 0.5 * c[1] / (c[2] * c[2]));
    const double uncertainty = std::sqrt(by_c.dot(covariance * by_c));
    if (!(c[2] > 3.0 * std::sqrt(covariance(2, 2))) || !(std::abs(place) < 1.0) ||
        !(uncertainty < 2.0 * max_uncertainty)) {
        minimum.undetermined = "the edges' width has no least value " + depths;
        return minimum;
    }
    minimum.is_determined = true;
    minimum.focus_distance_mm = 1.0 / (middle + scale * place);
    minimum.standard_uncertainty_mm =
        uncertainty * scale * minimum.focus_distance_mm * minimum.focus_distance_mm;
    return minimum;
}

// Weighted means over the edges of one bin.
void set_means(std::span<const Width> widths, DepthBin& bin) {
    double weights = 0.0, depth = 0.0, measured = 0.0, rendered = 0.0, squares = 0.0;
    for (const Width& one : widths) {
        const double weight = 1.0 / (one.deviation_px2 * one.deviation_px2);
        weights += weight;
        depth += weight * one.inverse_depth;
        measured += weight * one.measured_px2;
        rendered += weight * one.rendered_px2;
    }
    bin.depth_mm = weights / depth;
    bin.measured_px2 = measured / weights;
    bin.rendered_px2 = rendered / weights;
    // Widths differ within a bin as the rendered ones do: the scatter is that of the differences.
    for (const Width& one : widths) {
        const double rest =
            (one.measured_px2 - bin.measured_px2) - (one.rendered_px2 - bin.rendered_px2);
        squares += rest * rest / (one.deviation_px2 * one.deviation_px2);
    }
    const double freedom = std::max(1.0, static_cast<double>(widths.size()) - 1.0);
    bin.measured_deviation_px2 = std::sqrt(std::max(1.0, squares / freedom) / weights);
}

double residual_rms(std::span<const EdgeShift> shifts, double low_mm, double high_mm) {
    double squares = 0.0, pixels = 0.0;
    for (const EdgeShift& edge : shifts)
        if (edge.depth_mm >= low_mm && edge.depth_mm <= high_mm) {
            squares += edge.shares.total();
            pixels += edge.pixels;
        }
    return pixels > 0.0 ? std::sqrt(squares / pixels) : 0.0;
}

std::vector<DepthBin> binned(std::span<const Width> widths, std::span<const EdgeShift> shifts,
                             int bins) {
    const InverseDepths range = inverse_depths(widths);
    std::vector<std::vector<Width>> sorted(static_cast<std::size_t>(bins));
    for (const Width& one : widths) {
        const double span = range.nearest - range.farthest;
        const double place = span > 0.0 ? (range.nearest - one.inverse_depth) / span * bins : 0.0;
        sorted[static_cast<std::size_t>(std::clamp(static_cast<int>(place), 0, bins - 1))]
            .push_back(one);
    }
    std::vector<DepthBin> result;
    for (int i = 0; i < bins; ++i) {
        DepthBin bin;
        bin.low_mm = 1.0 / std::lerp(range.nearest, range.farthest, static_cast<double>(i) / bins);
        bin.high_mm = 1.0 / std::lerp(range.nearest, range.farthest, (i + 1.0) / bins);
        const std::vector<Width>& inside = sorted[static_cast<std::size_t>(i)];
        bin.edges = static_cast<int>(inside.size());
        if (!inside.empty())
            set_means(inside, bin);
        bin.residual_rms_gray = residual_rms(shifts, bin.low_mm, bin.high_mm);
        result.push_back(bin);
    }
    return result;
}

}  // namespace

DefocusProfile defocus_profile(const CodeImage& photo, const Radiance& rendering,
                               const Projector& projector, const Marker& marker,
                               const Rigid& camera_from_marker, const ComparedArea& area,
                               std::span<const EdgeShift> shifts, const EdgeSelection& selection,
                               int bins) {
    require_point_of_view(projector.camera(), "a profile of defocus");
    if (bins < 1)
        throw NumericalError(fmt::format("a profile of defocus with {} bins", bins));
    const LinearPhoto measured = linear_photo(photo, projector.camera());
    const LinearPhoto rendered{rendering, cv::Mat::zeros(rendering.size(), CV_8UC1),
                               measured.noise};
    const auto edges_in = [&](const LinearPhoto& image) {
        return target_edges(image, projector, marker, camera_from_marker, area, selection).edges;
    };
    const std::vector<Width> widths = widths_of(edges_in(measured), edges_in(rendered));
    DefocusProfile profile;
    profile.edges = static_cast<int>(widths.size());
    profile.photo = minimum_of(widths, &Width::measured_px2);
    profile.rendering = minimum_of(widths, &Width::rendered_px2);
    if (!widths.empty())
        profile.bins = binned(widths, shifts, bins);
    return profile;
}

}  // namespace etalon
