#include "compare/characterise/defocus_estimate.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

#include "compare/edges/edge_fit.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr std::size_t min_edges_for_defocus = 12;
constexpr int min_edges_a_side = 4;
constexpr double min_blur_px = 0.5;
constexpr double piece_length_px = 10.0;
constexpr std::size_t min_pixels_of_a_piece = 40;  // several for each of a piece's own parameters
constexpr double max_relative_uncertainty = 0.2;   // of the aperture

// What does not depend on the edges. Depths in units of `depth_scale` (1/mm): numbers near 1.
struct Setting {
    double image_distance_mm, pitch_mm, wavelength_mm, depth_scale;
    FocusSpread spread;
};

// Parameters: aperture radius (mm), 1/z_f (in depth_scale), sigma^2 (px^2; Gaussian only).
struct Blur {
    double radius_squared, by_aperture, by_focus;  // px^2
};

Blur blur_of(const StraightEdge& edge, const Setting& setting, double aperture, double focus) {
    const double scale = edge.px_per_unit * setting.depth_scale;
    const double defocus = edge.depth_term / setting.depth_scale - focus;
    const double spread = edge.depth_term_variance / (setting.depth_scale * setting.depth_scale);
    const double unit = scale * scale * (defocus * defocus + spread);
    return {aperture * aperture * unit, 2.0 * aperture * unit,
            -2.0 * aperture * aperture * scale * scale * defocus};
}

// lambda N_w in px, with N_w = v / d.
double lambda_n_px(const Setting& setting, double aperture) {
    return setting.wavelength_mm * setting.image_distance_mm / (2.0 * aperture) / setting.pitch_mm;
}

BlurModel::Transfer transfer_of(const StraightEdge& edge, const Setting& setting,
                                const Eigen::VectorXd& p, const Eigen::ArrayXd& frequencies) {
    using std::numbers::pi;
    const Blur blur = blur_of(edge, setting, p[0], p[1]);
    const double radius = std::sqrt(blur.radius_squared);
    const bool is_gaussian = setting.spread == FocusSpread::gaussian;
    BlurModel::Transfer result{Eigen::ArrayXd(frequencies.size()),
                               Eigen::MatrixXd(frequencies.size(), p.size())};
    for (Eigen::Index i = 0; i < frequencies.size(); ++i) {
        const double q = frequencies[i] * edge.px_per_pitch, fall = -2.0 * pi * pi * q * q;
        const DiskTransfer disk = disk_transfer(frequencies[i], radius);
        const double x = is_gaussian ? 0.0 : q * lambda_n_px(setting, p[0]);
        const AiryTransfer airy = airy_transfer(x);
        const double lens = is_gaussian ? std::exp(fall * p[2]) : airy.value;
        result.value[i] = lens * disk.value;
        result.derivative(i, 0) = lens * disk.by_radius_squared * blur.by_aperture;
        result.derivative(i, 1) = lens * disk.by_radius_squared * blur.by_focus;
        if (is_gaussian)
            result.derivative(i, 2) = fall * result.value[i];
        else
            result.derivative(i, 0) -= airy.derivative * x / p[0] * disk.value;
    }
    return result;
}

void require_usable(std::span<const StraightEdge> edges, const CameraModel& camera,
                    FocusSpread spread) {
    require_point_of_view(camera, "estimating a thin lens");
    if (!camera.sensor || !(camera.sensor->pixel_pitch_um > 0.0))
        throw NumericalError("defocus: the pixel pitch is needed");
    if (spread == FocusSpread::diffraction && (!camera.lens || !(camera.lens->wavelength_nm > 0.0)))
        throw NumericalError("defocus: the diffraction pattern needs a wavelength");
    if (edges.size() < min_edges_for_defocus)
        throw NumericalError(fmt::format("defocus: {} edges, at least {} are needed", edges.size(),
                                         min_edges_for_defocus));
}

Setting setting_of(std::span<const StraightEdge> edges, const CameraModel& camera,
                   FocusSpread spread) {
    double depth = 0.0;
    for (const StraightEdge& edge : edges)
        depth += edge.depth_term / static_cast<double>(edges.size());
    const double pitch = camera.sensor->pixel_pitch_um * 1e-3;
    return {image_distance_mm(camera), pitch,
            spread == FocusSpread::diffraction ? camera.lens->wavelength_nm * 1e-6 : 0.0, depth,
            spread};
}

// The part of an edge between two places along it.
StraightEdge piece_of(const StraightEdge& edge, double first_px, double last_px) {
    StraightEdge piece = edge;
    piece.pixels.clear();
    double sum = 0.0, squares = 0.0;
    for (const EdgePixel& pixel : edge.pixels)
        if (pixel.along_px >= first_px && pixel.along_px < last_px) {
            piece.pixels.push_back(pixel);
            sum += pixel.depth_term;
            squares += pixel.depth_term * pixel.depth_term;
        }
    const double n = std::max(1.0, static_cast<double>(piece.pixels.size()));
    piece.length_px = last_px - first_px;
    piece.depth_term = sum / n;
    piece.depth_term_variance = std::max(0.0, squares / n - piece.depth_term * piece.depth_term);
    return piece;
}

// The blur changes along an edge that runs into the depth, and is no longer one disk: edges in
// pieces of 10 px and more. (A board tilted by 46 degrees, edges of 20 px, 1.8 px of blur: whole
// edges give z_f and N wrong by one standard uncertainty of one photograph.)
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
            StraightEdge piece = piece_of(edge, first + i * length, first + (i + 1) * length);
            if (piece.pixels.size() >= min_pixels_of_a_piece)
                pieces.push_back(std::move(piece));
        }
    }
    return pieces;
}

// Blur of each edge as a Gaussian's variance, for the start. A disk of radius R has R^2/4.
Eigen::VectorXd variances(std::span<const StraightEdge> edges) {
    const BlurModel model = gaussian_width();
    Eigen::VectorXd result(static_cast<Eigen::Index>(edges.size()));
    for (std::size_t i = 0; i < edges.size(); ++i)
        result[static_cast<Eigen::Index>(i)] = fit_edges(edges.subspan(i, 1), model).parameters[0];
    return result;
}

// The variances as a parabola over 1/z: aperture^2 scale^2 / 4 (D - focus)^2 + sigma^2. Nothing
// when it does not open upwards. Relative errors of variances are alike: weights 1/variance^2.
std::optional<Eigen::Vector3d> start_of(std::span<const StraightEdge> edges,
                                        const Setting& setting) {
    const Eigen::VectorXd variance = variances(edges);
    const auto n = variance.size();
    Eigen::MatrixXd design(n, 3);
    Eigen::VectorXd right(n);
    double scale = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) {
        const StraightEdge& edge = edges[static_cast<std::size_t>(i)];
        const double x = edge.depth_term / setting.depth_scale - 1.0;
        const double weight = 1.0 / (variance[i] + 0.1);
        design.row(i) << weight, weight * x, weight * x * x;
        right[i] = weight * variance[i];
        scale += edge.px_per_unit * setting.depth_scale / static_cast<double>(n);
    }
    const Eigen::Vector3d c = design.colPivHouseholderQr().solve(right);
    if (!c.allFinite() || !(c[2] > 0.0))
        return {};
    const double focus = -c[1] / (2.0 * c[2]);
    return Eigen::Vector3d(2.0 * std::sqrt(c[2]) / scale, 1.0 + focus,
                           std::max(0.01, c[0] - c[2] * focus * focus));
}

std::string depths(std::span<const StraightEdge> edges) {
    double nearest = 0.0, farthest = std::numeric_limits<double>::infinity();
    for (const StraightEdge& edge : edges) {
        nearest = std::max(nearest, edge.depth_term);
        farthest = std::min(farthest, edge.depth_term);
    }
    return fmt::format("between {:.1f} and {:.1f} mm", 1.0 / nearest, 1.0 / farthest);
}

void count_sides(std::span<const StraightEdge> edges, const EdgeFit& fit, const Setting& setting,
                 DefocusEstimate& estimate) {
    for (std::size_t i = 0; i < edges.size(); ++i) {
        if (fit.edges[i].is_outlier)
            continue;
        const double radius = std::sqrt(
            blur_of(edges[i], setting, fit.parameters[0], fit.parameters[1]).radius_squared);
        estimate.largest_blur_px = std::max(estimate.largest_blur_px, radius);
        if (radius > min_blur_px)
            ++(edges[i].depth_term / setting.depth_scale > fit.parameters[1]
                   ? estimate.edges_nearer
                   : estimate.edges_farther);
    }
}

// Disk, point spread and half a pixel: what reaches farther carries less than 1 % of the contrast.
double reach_px(const StraightEdge& edge, const EdgeFit& fit, const Setting& setting) {
    const double radius =
        std::sqrt(blur_of(edge, setting, fit.parameters[0], fit.parameters[1]).radius_squared);
    const double sigma = fit.parameters.size() == 3 ? std::sqrt(fit.parameters[2]) : 0.0;
    return radius + 2.5 * sigma + 0.5;
}

// An edge so blurred that the next one reaches into its pixels would bend the result: such are left
// out and the others fitted again.
EdgeFit fit_within_clearance(std::vector<StraightEdge>& edges, const BlurModel& model,
                             const Setting& setting, DefocusEstimate& estimate) {
    constexpr int max_rounds = 4;
    EdgeFit fit = fit_edges(edges, model);
    for (int round = 0; round < max_rounds; ++round) {
        const auto removed = std::erase_if(edges, [&](const StraightEdge& edge) {
            return reach_px(edge, fit, setting) > edge.clearance_px;
        });
        if (removed == 0)
            break;
        estimate.too_blurred += static_cast<int>(removed);
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
void set_values(const EdgeFit& fit, const Setting& setting, DefocusEstimate& estimate) {
    const double aperture = fit.parameters[0], focus = fit.parameters[1] * setting.depth_scale;
    const double focal_length = 1.0 / (focus + 1.0 / setting.image_distance_mm);
    const double number = focal_length / (2.0 * aperture);
    Eigen::MatrixXd by_parameter = Eigen::MatrixXd::Zero(3, fit.parameters.size());
    by_parameter(0, 1) = -setting.depth_scale / (focus * focus);
    by_parameter(1, 0) = -number / aperture;
    by_parameter(1, 1) = -number * focal_length * setting.depth_scale;
    if (fit.parameters.size() == 3)
        by_parameter(2, 2) = 1.0;
    estimate.is_determined = true;
    estimate.covariance = by_parameter * fit.covariance * by_parameter.transpose();
    estimate.focus_distance_mm = 1.0 / focus;
    estimate.f_number = number;
    estimate.focus_distance_standard_uncertainty_mm = std::sqrt(estimate.covariance(0, 0));
    estimate.f_number_standard_uncertainty = std::sqrt(estimate.covariance(1, 1));
    if (fit.parameters.size() == 3) {
        const double variance = fit.parameters[2];
        estimate.sigma_px = std::sqrt(variance);
        estimate.sigma_standard_uncertainty_px =
            std::sqrt(variance + std::sqrt(estimate.covariance(2, 2))) - estimate.sigma_px;
    }
}

}  // namespace

DefocusEstimate estimate_defocus(std::span<const StraightEdge> whole_edges,
                                 const CameraModel& camera, FocusSpread spread) {
    require_usable(whole_edges, camera, spread);
    std::vector<StraightEdge> edges = in_pieces(whole_edges);
    if (edges.size() < min_edges_for_defocus)
        throw NumericalError(fmt::format("defocus: {} pieces of edges, at least {} are needed",
                                         edges.size(), min_edges_for_defocus));
    const Setting setting = setting_of(edges, camera, spread);
    DefocusEstimate estimate;
    const auto start = start_of(edges, setting);
    if (!start) {
        estimate.undetermined = fmt::format(
            "focus distance and f-number: the blur has no least value {}", depths(edges));
        return estimate;
    }
    const Eigen::Index parameters = spread == FocusSpread::gaussian ? 3 : 2;
    BlurModel model;
    model.start = start->head(parameters);
    model.lower = Eigen::Vector3d(1e-6, -std::numeric_limits<double>::max(), 0.0).head(parameters);
    model.transfer = [&](const StraightEdge& edge, const Eigen::VectorXd& p,
                         const Eigen::ArrayXd& f) { return transfer_of(edge, setting, p, f); };
    auto fitted = attempted([&] { return fit_within_clearance(edges, model, setting, estimate); });
    if (!fitted) {  // an aperture that vanishes: focus is then anywhere
        estimate.undetermined =
            fmt::format("focus distance and f-number: {} ({})", fitted.cause, depths(whole_edges));
        return estimate;
    }
    const EdgeFit& fit = *fitted;
    estimate.reduced_chi_square = fit.reduced_chi_square;
    estimate.edges = fit.used_edges;
    estimate.pixels = fit.pixels;
    estimate.degrees_of_freedom = fit.degrees_of_freedom;
    count_sides(edges, fit, setting, estimate);
    estimate.undetermined = objection(edges, fit, estimate);
    if (estimate.undetermined.empty())
        set_values(fit, setting, estimate);
    return estimate;
}

}  // namespace etalon
