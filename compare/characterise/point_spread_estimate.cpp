#include "compare/characterise/point_spread_estimate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "compare/edges/edge_fit.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"
#include "sim/psf/diffraction.h"

namespace etalon {
namespace {

constexpr std::size_t min_edges_for_sigma = 4, min_edges_for_profile = 8;
constexpr double profile_bin_px = 0.25;
constexpr double profile_significance = 0.001;

// Standard uncertainty of sqrt(v), the larger of its two sides: finite at v = 0 too.
double root_uncertainty(double v, double u) {
    return std::max(std::sqrt(v + u) - std::sqrt(v),
                    std::sqrt(v) - std::sqrt(std::max(v - u, 0.0)));
}

BlurWidth width_of(const EdgeFit& fit) {
    BlurWidth width;
    width.variance_px2 = fit.parameters[0];
    width.variance_standard_uncertainty_px2 = std::sqrt(fit.covariance(0, 0));
    width.sigma_px = std::sqrt(width.variance_px2);
    width.standard_uncertainty_px =
        root_uncertainty(width.variance_px2, width.variance_standard_uncertainty_px2);
    width.reduced_chi_square = fit.reduced_chi_square;
    width.residual_rms = fit.residual_rms;
    width.edges = fit.used_edges;
    width.pixels = fit.pixels;
    width.degrees_of_freedom = fit.degrees_of_freedom;
    width.outlying_edges = fit.outlying_edges;
    return width;
}

// The measured profile: what the fit says plus what it leaves, bin by bin.
std::vector<EdgeSpreadRow> mean_profile(std::span<const StraightEdge> edges, const EdgeFit& fit,
                                        const BlurModel& model) {
    struct Bin {
        double weight = 0.0, distance = 0.0, value = 0.0;
        int pixels = 0;
    };
    double reach = 0.0;
    for (const StraightEdge& edge : edges)
        for (const EdgePixel& pixel : edge.pixels)
            reach = std::max(reach, std::abs(pixel.distance_px));
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
            const double place = pixel.distance_px - own.shift_px - own.turn * pixel.along_px;
            const int index = static_cast<int>(std::floor(place / profile_bin_px)) + half;
            if (index < 0 || index >= 2 * half)
                continue;
            const double height = own.step + own.gradient_across * pixel.distance_px +
                                  own.gradient_along * pixel.along_px;
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
    Sharpening result{over.value, over.standard_uncertainty, under.value,
                      under.standard_uncertainty, false};
    for (const Mean& excess : {over, under})
        if (excess.is_known && excess.value - sigmas * excess.standard_uncertainty > min_overshoot)
            result.is_detected = true;
    return result;
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

double reach_of(std::span<const StraightEdge> edges) {
    double reach = 0.0;
    for (const StraightEdge& edge : edges)
        for (const EdgePixel& pixel : edge.pixels)
            reach = std::max(reach, std::abs(pixel.distance_px));
    return reach;
}

MeasuredSpread measured_spread(std::span<const StraightEdge> edges, double sigma_px, EdgeFit& fit) {
    const SlopingDisks disks(profile_radii(sigma_px, reach_of(edges)));
    fit = fit_edges(edges, disks.model());
    const Eigen::MatrixXd by_part = disks.density_by_part();
    const Eigen::VectorXd density = by_part * fit.parameters;
    MeasuredSpread spread;
    spread.covariance = by_part * fit.covariance * by_part.transpose();
    for (Eigen::Index i = 0; i < density.size(); ++i)
        spread.rows.push_back({i == 0 ? 0.0 : disks.radii_px()[static_cast<std::size_t>(i - 1)],
                               density[i], std::sqrt(std::max(0.0, spread.covariance(i, i)))});
    spread.reduced_chi_square = fit.reduced_chi_square;
    spread.residual_rms = fit.residual_rms;
    spread.degrees_of_freedom = fit.degrees_of_freedom;
    spread.parameters =
        static_cast<int>(std::count(fit.is_at_bound.begin(), fit.is_at_bound.end(), false));
    return spread;
}

// On the edges that both fits used.
void compare_shapes(std::span<const StraightEdge> edges, const EdgeFit& gaussian,
                    const EdgeFit& measured, PointSpreadEstimate& estimate) {
    double drop = 0.0;
    for (std::size_t i = 0; i < edges.size(); ++i)
        if (!gaussian.edges[i].is_outlier && !measured.edges[i].is_outlier)
            drop += (gaussian.edges[i].reduced_chi_square - measured.edges[i].reduced_chi_square) *
                    own_freedom(edges[i]);
    const int more = std::max(1, estimate.measured->parameters - 2);  // the sum is 1; one sigma
    estimate.f_statistic = std::max(0.0, drop / more / measured.reduced_chi_square);
    estimate.f_probability = fisher_tail(estimate.f_statistic, more, measured.degrees_of_freedom);
    estimate.gaussian_suffices = estimate.f_probability > profile_significance;
}

std::size_t zone_of(const StraightEdge& edge, const CameraModel& camera) {
    const auto third = [](double at, int size) {
        return std::clamp(static_cast<int>(std::floor(3.0 * (at + 0.5) / size)), 0, 2);
    };
    return static_cast<std::size_t>(3 * third(edge.centre_px.y(), camera.height) +
                                    third(edge.centre_px.x(), camera.width));
}

void estimate_zones(std::span<const StraightEdge> edges, const CameraModel& camera,
                    const BlurModel& model, PointSpreadEstimate& estimate) {
    std::array<std::vector<StraightEdge>, 9> by_zone;
    for (const StraightEdge& edge : edges)
        by_zone[zone_of(edge, camera)].push_back(edge);
    for (std::size_t zone = 0; zone < by_zone.size(); ++zone)
        if (by_zone[zone].size() >= min_edges_for_sigma)
            estimate.zones[zone] = width_of(fit_edges(by_zone[zone], model));
}

Aperture pinhole_of(const CameraModel& camera) {
    return {camera.projection.of_normalised(), 0.0, 0.0, Eigen::Vector2d::Zero()};
}

// Beside the blur of the camera's lens section.
BlurModel gaussian_of_edges(std::span<const StraightEdge> edges, const CameraModel& camera) {
    if (edges.size() < min_edges_for_sigma)
        throw NumericalError(fmt::format("point spread: {} edges, at least {} are needed",
                                         edges.size(), min_edges_for_sigma));
    return gaussian_blur(camera.lens ? aperture_of(camera) : pinhole_of(camera), 0.0);
}

}  // namespace

std::vector<std::pair<double, double>> MeasuredSpread::profile() const {
    std::vector<std::pair<double, double>> result;
    for (const ProfileRow& row : rows)
        result.emplace_back(row.radius_px, row.density);
    return result;
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
        const double each =
            disks.transfer(static_cast<std::size_t>(k), cycles_per_px) / by_part(k, k);
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

PointSpreadEstimate estimate_point_spread(std::span<const StraightEdge> edges,
                                          const CameraModel& camera) {
    const BlurModel gaussian = gaussian_of_edges(edges, camera);
    const EdgeFit gaussian_fit = fit_edges(edges, gaussian);
    PointSpreadEstimate estimate;
    estimate.gaussian = width_of(gaussian_fit);
    estimate_zones(edges, camera, gaussian, estimate);
    estimate.edge_spread = mean_profile(edges, gaussian_fit, gaussian);
    estimate.sharpening = sharpening_of(estimate.edge_spread);
    if (edges.size() >= min_edges_for_profile) {
        EdgeFit measured_fit;
        const BlurModel alone = gaussian_blur(pinhole_of(camera), 0.0);
        const EdgeFit alone_fit = fit_edges(edges, alone);
        estimate.measured =
            measured_spread(edges, std::sqrt(alone_fit.parameters[0]), measured_fit);
        compare_shapes(edges, gaussian_fit, measured_fit, estimate);
    }
    return estimate;
}

}  // namespace etalon
