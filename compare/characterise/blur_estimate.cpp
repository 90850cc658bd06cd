#include "compare/characterise/blur_estimate.h"

#include <fmt/format.h>

#include <Eigen/Dense>

#include "compare/edges/edge_fit.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

constexpr std::size_t min_edges_for_sigma = 4, min_edges_for_profile = 8;
constexpr double profile_bin_px = 0.25;
constexpr double profile_significance = 0.001;

// The uncertainty of the square root is the larger of its two sides: finite at 0 too.
BlurWidth width_of(const EdgeFit& fit) {
    const double v = fit.parameters[0], u = std::sqrt(fit.covariance(0, 0)), sigma = std::sqrt(v);
    return {sigma, std::max(std::sqrt(v + u) - sigma, sigma - std::sqrt(std::max(v - u, 0.0))),
            fit.residual_rms, fit.used_edges};
}

// The measured profile: what the fit says plus what it leaves, bin by bin.
std::vector<EdgeSpreadRow> mean_profile(std::span<const StraightEdge> edges, const EdgeFit& fit,
                                        const BlurModel& model) {
    struct Bin {
        double weight = 0.0, distance = 0.0, value = 0.0;
        int pixels = 0;
    };
    const double reach = reach_px(edges);
    const EdgeResponse response(reach + 4.0);
    const int half = static_cast<int>(std::ceil(reach / profile_bin_px));
    std::vector<Bin> bins(static_cast<std::size_t>(2 * half));
    for (std::size_t i = 0; i < edges.size(); ++i) {
        const FittedEdge& own = fit.edges[i];
        if (own.is_outlier)
            continue;
        const auto& f = response.frequencies();
        const Eigen::ArrayXd transfer =
            pixel_transfer(f, edges[i].normal) * model.transfer(edges[i], fit.parameters, f).value;
        const Eigen::ArrayXd odd = response.odd_table(transfer),
                             even = response.even_table(transfer);
        for (std::size_t k = 0; k < edges[i].pixels.size(); ++k) {
            const EdgePixel& pixel = edges[i].pixels[k];
            const double place = own.place_px(pixel), height = own.height(pixel);
            const int index = static_cast<int>(std::floor(place / profile_bin_px)) + half;
            if (index < 0 || index >= 2 * half)
                continue;
            const double weight =
                height * height / edges[i].noise.variance(pixel.radiance - own.residuals[k]);
            Bin& bin = bins[static_cast<std::size_t>(index)];
            bin.weight += weight;
            bin.distance += weight * place;
            bin.value +=
                weight * (edge_value(odd, even, place).response + own.residuals[k] / height);
            ++bin.pixels;
        }
    }
    const bool is_known = edges.front().noise.is_known;
    const double excess = is_known ? std::max(1.0, fit.reduced_chi_square) : fit.reduced_chi_square;
    std::vector<EdgeSpreadRow> rows;
    for (const Bin& bin : bins)
        if (bin.pixels > 0)
            rows.push_back({bin.distance / bin.weight, bin.value / bin.weight,
                            std::sqrt(excess / bin.weight), bin.pixels});
    return rows;
}

struct Mean {
    double value, standard_uncertainty;
    bool is_known;
};

// Weighted mean of the rows with first <= distance <= last.
Mean mean_between(std::span<const EdgeSpreadRow> rows, double first, double last) {
    double weight = 0.0, value = 0.0;
    for (const EdgeSpreadRow& row : rows)
        if (row.distance_px >= first && row.distance_px <= last) {
            const double w = 1.0 / (row.standard_uncertainty * row.standard_uncertainty);
            weight += w;
            value += w * row.value;
        }
    if (weight <= 0.0)
        return {0.0, 0.0, false};
    return {value / weight, 1.0 / std::sqrt(weight), true};
}

// Largest excess over the level on the light side (sign 1), or below it on the dark side (-1).
Mean largest_excess(std::span<const EdgeSpreadRow> rows, double sign) {
    constexpr double window_px = 0.5, nearest_px = 0.5, farthest_px = 4.0, level_px = 2.0;
    const double reach =
        std::min(std::abs(rows.front().distance_px), std::abs(rows.back().distance_px));
    const auto mean = [&](double near, double far) {
        return sign > 0.0 ? mean_between(rows, near, far) : mean_between(rows, -far, -near);
    };
    const Mean level = mean(reach - level_px, reach);
    Mean largest{-1.0, 0.0, false};
    for (double near = nearest_px;
         near + window_px <= std::min(farthest_px, reach - level_px) && level.is_known;
         near += profile_bin_px) {
        const Mean window = mean(near, near + window_px);
        const double excess = sign * (window.value - level.value);
        if (window.is_known && excess > largest.value)
            largest = {excess, std::hypot(window.standard_uncertainty, level.standard_uncertainty),
                       true};
    }
    return largest;
}

Sharpening sharpening_of(std::span<const EdgeSpreadRow> rows) {
    constexpr double sigmas = 4.0;
    const Mean over = largest_excess(rows, 1.0), under = largest_excess(rows, -1.0);
    const auto is_significant = [&](const Mean& excess) {
        return excess.is_known &&
               excess.value - sigmas * excess.standard_uncertainty > min_overshoot;
    };
    return {over.value, over.standard_uncertainty, under.value,
            is_significant(over) || is_significant(under)};
}

// Knots in steps of the blur's own width; no farther out than the edges' pixels.
std::vector<double> profile_radii(double sigma_px, double reach_px) {
    constexpr double multiples[] = {1.0, 2.0, 3.0, 4.0, 5.0, 6.5, 8.0, 10.0, 13.0};
    constexpr double min_step_px = 0.3, steps_per_sigma = 0.6, room_px = 1.0;
    const double step = std::max(min_step_px, steps_per_sigma * sigma_px);
    std::vector<double> radii;
    for (const double multiple : multiples)
        if (multiple * step <= reach_px - room_px || radii.size() < 2)
            radii.push_back(multiple * step);
    return radii;
}

MeasuredSpread measured_spread(std::span<const StraightEdge> edges, double sigma_px, EdgeFit& fit) {
    std::vector<double> radii = profile_radii(sigma_px, reach_px(edges));
    const SlopingDisks disks(radii);
    radii.insert(radii.begin(), 0.0);
    fit = fit_edges(edges, disks.model());
    const Eigen::MatrixXd by_part = disks.density_by_part();
    const Eigen::VectorXd density = by_part * fit.parameters;
    MeasuredSpread spread;
    spread.covariance = by_part * fit.covariance * by_part.transpose();
    for (Eigen::Index i = 0; i < density.size(); ++i)
        spread.rows.push_back({radii[static_cast<std::size_t>(i)], density[i],
                               std::sqrt(std::max(0.0, spread.covariance(i, i)))});
    spread.residual_rms = fit.residual_rms;
    return spread;
}

// On the edges that both fits used.
bool gaussian_suffices(std::span<const StraightEdge> edges, const EdgeFit& gaussian,
                       const EdgeFit& measured) {
    double drop = 0.0;
    for (std::size_t i = 0; i < edges.size(); ++i)
        if (!gaussian.edges[i].is_outlier && !measured.edges[i].is_outlier)
            drop += (gaussian.edges[i].reduced_chi_square - measured.edges[i].reduced_chi_square) *
                    own_freedom(edges[i]);
    const auto parameters = static_cast<int>(std::ranges::count(measured.is_at_bound, false));
    const int more = std::max(1, parameters - 2);  // the sum is 1; one sigma
    const double statistic = std::max(0.0, drop / more / measured.reduced_chi_square);
    return fisher_tail(statistic, more, measured.degrees_of_freedom) > profile_significance;
}

// With the blur of the camera's lens section.
BlurModel gaussian_of_edges(std::span<const StraightEdge> edges, const CameraModel& camera) {
    if (edges.size() < min_edges_for_sigma)
        throw NumericalError(fmt::format("point spread: {} edges, at least {} are needed",
                                         edges.size(), min_edges_for_sigma));
    return camera.lens ? gaussian_blur(aperture_of(camera)) : gaussian_blur();
}

}  // namespace

std::size_t image_zone(const CameraModel& camera, const Eigen::Vector2d& pixel) {
    const auto third = [](double at, int size) {
        return std::clamp(static_cast<int>(std::floor(3.0 * (at + 0.5) / size)), 0, 2);
    };
    return static_cast<std::size_t>(3 * third(pixel.y(), camera.height) +
                                    third(pixel.x(), camera.width));
}

std::pair<double, double> MeasuredSpread::modulation(double cycles_per_px) const {
    std::vector<double> radii;
    for (std::size_t i = 1; i < rows.size(); ++i)
        radii.push_back(rows[i].radius_px);
    const SlopingDisks disks(radii);
    const Eigen::MatrixXd by_part = disks.density_by_part();
    // The part k makes the density's fall from its inner to its outer radius.
    Eigen::VectorXd slope = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(rows.size()));
    for (Eigen::Index k = 0; k < by_part.cols(); ++k) {
        const double each = disks.transfer(k, cycles_per_px) / by_part(k, k);
        slope[k] += each;
        slope[k + 1] -= each;
    }
    double value = 0.0;
    for (Eigen::Index i = 0; i < slope.size(); ++i)
        value += slope[i] * rows[static_cast<std::size_t>(i)].density;
    return {value, std::sqrt(std::max(0.0, slope.dot(covariance * slope)))};
}

Sharpening measure_sharpening(std::span<const StraightEdge> edges, const CameraModel& camera) {
    const BlurModel gaussian = gaussian_of_edges(edges, camera);
    return sharpening_of(mean_profile(edges, fit_edges(edges, gaussian), gaussian));
}

BlurWidth estimate_gaussian(std::span<const StraightEdge> edges, const CameraModel& camera) {
    return width_of(fit_edges(edges, gaussian_of_edges(edges, camera)));
}

PointSpreadEstimate estimate_point_spread(std::span<const StraightEdge> edges,
                                          const CameraModel& camera) {
    const BlurModel gaussian = gaussian_of_edges(edges, camera);
    const EdgeFit gaussian_fit = fit_edges(edges, gaussian);
    PointSpreadEstimate estimate;
    estimate.gaussian = width_of(gaussian_fit);
    std::array<std::vector<StraightEdge>, 9> by_zone;
    for (const StraightEdge& edge : edges)
        by_zone[image_zone(camera, edge.centre_px)].push_back(edge);
    for (std::size_t zone = 0; zone < by_zone.size(); ++zone)
        if (by_zone[zone].size() >= min_edges_for_sigma)
            estimate.zones[zone] = width_of(fit_edges(by_zone[zone], gaussian));
    estimate.edge_spread = mean_profile(edges, gaussian_fit, gaussian);
    estimate.sharpening = sharpening_of(estimate.edge_spread);
    if (edges.size() >= min_edges_for_profile) {
        EdgeFit measured_fit;
        const double alone_px2 = fit_edges(edges, gaussian_blur()).parameters[0];
        estimate.measured = measured_spread(edges, std::sqrt(alone_px2), measured_fit);
        estimate.gaussian_suffices = gaussian_suffices(edges, gaussian_fit, measured_fit);
    }
    return estimate;
}

namespace {

constexpr std::size_t min_edges_for_defocus = 12;
constexpr int min_edges_a_side = 4;
constexpr double min_blur_px = 0.5;
constexpr double piece_length_px = 10.0;
constexpr std::size_t min_pixels_of_a_piece = 40;  // several for each of a piece's own parameters
constexpr double max_relative_uncertainty = 0.2;   // of the aperture

// Aperture radius (mm), 1/z_f in units of `depth_unit` (1/mm), sigma^2 (px^2): numbers near 1.
BlurModel thin_lens_blur(const Eigen::Vector3d& start, double depth_unit) {
    BlurModel model;
    model.start = start;
    model.lower = Eigen::Vector3d(1e-6, -std::numeric_limits<double>::max(), 0.0);
    model.transfer = [=](const StraightEdge& edge, const Eigen::VectorXd& p,
                         const Eigen::ArrayXd& frequencies) {
        const double focus = p[1] * depth_unit, scale = p[0] * edge.px_per_unit;
        const double radius_squared = disk_radius_squared(edge, p[0], focus);
        const BlurTransfer blur = blur_transfer(edge, p[2], radius_squared, frequencies);
        BlurModel::Transfer result{blur.value, Eigen::MatrixXd(frequencies.size(), 3)};
        result.derivative << blur.by_radius_squared * (2.0 * radius_squared / p[0]),
            blur.by_radius_squared *
                (-2.0 * scale * scale * (edge.depth_term - focus) * depth_unit),
            blur.by_variance;
        return result;
    };
    return model;
}

double disk_radius_px(const StraightEdge& edge, const EdgeFit& fit, double depth_unit) {
    return std::sqrt(disk_radius_squared(edge, fit.parameters[0], fit.parameters[1] * depth_unit));
}

// In pieces of 10 px and more: the blur changes along an edge that runs into the depth.
std::vector<StraightEdge> in_pieces(std::span<const StraightEdge> edges) {
    std::vector<StraightEdge> pieces;
    for (const StraightEdge& edge : edges) {
        double first = 0.0, last = 0.0;
        for (const EdgePixel& pixel : edge.pixels) {
            first = std::min(first, pixel.along_px);
            last = std::max(last, pixel.along_px);
        }
        const int count = std::max(1, static_cast<int>((last - first) / piece_length_px));
        const double length = (last - first) / count + 1e-9;
        for (int i = 0; i < count; ++i) {
            StraightEdge piece = edge;
            const double from = first + i * length, to = first + (i + 1) * length;
            std::erase_if(piece.pixels, [&](const EdgePixel& pixel) {
                return pixel.along_px < from || pixel.along_px >= to;
            });
            piece.set_depth();
            if (piece.pixels.size() >= min_pixels_of_a_piece)
                pieces.push_back(std::move(piece));
        }
    }
    return pieces;
}

// The widths as a parabola over 1/z, weights 1/variance^2; nothing when it does not open upwards.
std::optional<Eigen::Vector3d> start_of(std::span<const StraightEdge> edges, double depth_unit) {
    const auto n = static_cast<Eigen::Index>(edges.size());
    Eigen::MatrixXd design(n, 3);
    Eigen::VectorXd right(n);
    double scale = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) {
        const StraightEdge& edge = edges[static_cast<std::size_t>(i)];
        const double variance = edge_width(edge).variance_px2;
        const double x = edge.depth_term / depth_unit - 1.0;
        const double weight = 1.0 / (variance + 0.1);
        design.row(i) << weight, weight * x, weight * x * x;
        right[i] = weight * variance;
        scale += edge.px_per_unit * depth_unit / static_cast<double>(n);
    }
    const Eigen::Vector3d c = design.colPivHouseholderQr().solve(right);
    if (!c.allFinite() || !(c[2] > 0.0))
        return {};
    const double focus = -c[1] / (2.0 * c[2]);
    return Eigen::Vector3d(2.0 * std::sqrt(c[2]) / scale, 1.0 + focus,
                           std::max(0.01, c[0] - c[2] * focus * focus));
}

std::string depths(std::span<const StraightEdge> edges) {
    const auto [farthest, nearest] =
        std::ranges::minmax_element(edges, {}, &StraightEdge::depth_term);
    return fmt::format("between {:.1f} and {:.1f} mm", 1.0 / nearest->depth_term,
                       1.0 / farthest->depth_term);
}

void count_sides(std::span<const StraightEdge> edges, const EdgeFit& fit, double depth_unit,
                 DefocusEstimate& estimate) {
    for (std::size_t i = 0; i < edges.size(); ++i) {
        if (fit.edges[i].is_outlier)
            continue;
        const double radius = disk_radius_px(edges[i], fit, depth_unit);
        estimate.largest_blur_px = std::max(estimate.largest_blur_px, radius);
        if (radius > min_blur_px)
            ++(edges[i].depth_term / depth_unit > fit.parameters[1] ? estimate.edges_nearer
                                                                    : estimate.edges_farther);
    }
}

// Edges so blurred that the next one reaches into their pixels are left out and the others fitted
// again. Less than 1 % of the contrast lies beyond disk, point spread and 0.5 px.
EdgeFit fit_within_clearance(std::vector<StraightEdge>& edges, const BlurModel& model,
                             double depth_unit) {
    constexpr int max_rounds = 4;
    EdgeFit fit = fit_edges(edges, model);
    for (int round = 0; round < max_rounds; ++round) {
        const auto removed = std::erase_if(edges, [&](const StraightEdge& edge) {
            return disk_radius_px(edge, fit, depth_unit) + 2.5 * std::sqrt(fit.parameters[2]) +
                       0.5 >
                   edge.clearance_px;
        });
        if (removed == 0)
            break;
        if (edges.size() < min_edges_for_defocus)
            throw NumericalError(fmt::format(
                "no thin lens fits; the best one leaves {} edges clear of the next", edges.size()));
        fit = fit_edges(edges, model);
    }
    return fit;
}

// What keeps the result from being one; empty when nothing does.
std::string objection(std::span<const StraightEdge> edges, const EdgeFit& fit,
                      const DefocusEstimate& estimate) {
    const double aperture = fit.parameters[0], uncertainty = std::sqrt(fit.covariance(0, 0));
    if (fit.is_at_bound[0] || uncertainty > max_relative_uncertainty * aperture)
        return fmt::format(
            "focus distance and f-number: the blur hardly changes {} (largest disk radius {:.2f} "
            "px)",
            depths(edges), estimate.largest_blur_px);
    if (estimate.edges_nearer < min_edges_a_side || estimate.edges_farther < min_edges_a_side)
        return fmt::format(
            "focus distance and f-number: {} edges are nearer than the plane of focus and {} "
            "farther by a blur over {} px, {} are needed on both sides; the target was {}",
            estimate.edges_nearer, estimate.edges_farther, min_blur_px, min_edges_a_side,
            depths(edges));
    return {};
}

// N = f/d with 1/f = 1/z_f + 1/v: dN/d(aperture) = -N/aperture, dN/d(1/z_f) = -N f.
void set_values(const EdgeFit& fit, double image_distance_mm, double depth_unit,
                DefocusEstimate& estimate) {
    const double aperture = fit.parameters[0], focus = fit.parameters[1] * depth_unit;
    const double focal_length = 1.0 / (focus + 1.0 / image_distance_mm);
    const double number = focal_length / (2.0 * aperture);
    Eigen::Matrix3d by_parameter;
    by_parameter << 0.0, -depth_unit / (focus * focus), 0.0,  //
        -number / aperture, -number * focal_length * depth_unit, 0.0, 0.0, 0.0, 1.0;
    estimate.is_determined = true;
    estimate.covariance = by_parameter * fit.covariance * by_parameter.transpose();
    estimate.focus_distance_mm = 1.0 / focus;
    estimate.f_number = number;
    estimate.sigma_px = std::sqrt(fit.parameters[2]);
    const Eigen::Vector3d u = estimate.covariance.diagonal().cwiseSqrt();
    estimate.focus_distance_standard_uncertainty_mm = u[0];
    estimate.f_number_standard_uncertainty = u[1];
    estimate.sigma_standard_uncertainty_px =
        std::sqrt(fit.parameters[2] + u[2]) - estimate.sigma_px;
}

}  // namespace

DefocusEstimate estimate_defocus(std::span<const StraightEdge> whole_edges,
                                 const CameraModel& camera) {
    require_point_of_view(camera, "estimating a thin lens");
    if (!camera.sensor || !(camera.sensor->pixel_pitch_um > 0.0))
        throw NumericalError("defocus: the pixel pitch is needed");
    std::vector<StraightEdge> edges = in_pieces(whole_edges);
    if (std::min(edges.size(), whole_edges.size()) < min_edges_for_defocus)
        throw NumericalError(fmt::format("defocus: {} edges in {} pieces, at least {} are needed",
                                         whole_edges.size(), edges.size(), min_edges_for_defocus));
    double depth_unit = 0.0;
    for (const StraightEdge& edge : edges)
        depth_unit += edge.depth_term / static_cast<double>(edges.size());
    DefocusEstimate estimate;
    const auto start = start_of(edges, depth_unit);
    if (!start) {
        estimate.undetermined = fmt::format(
            "focus distance and f-number: the blur has no least value {}", depths(edges));
        return estimate;
    }
    const BlurModel model = thin_lens_blur(*start, depth_unit);
    auto fit = attempted([&] { return fit_within_clearance(edges, model, depth_unit); });
    if (!fit) {  // an aperture that vanishes: focus is then anywhere
        estimate.undetermined =
            fmt::format("focus distance and f-number: {} ({})", fit.cause, depths(whole_edges));
        return estimate;
    }
    estimate.edges = fit->used_edges;
    estimate.degrees_of_freedom = fit->degrees_of_freedom;
    count_sides(edges, *fit, depth_unit, estimate);
    estimate.undetermined = objection(edges, *fit, estimate);
    if (estimate.undetermined.empty())
        set_values(*fit, image_distance_mm(camera), depth_unit, estimate);
    return estimate;
}

}  // namespace etalon
