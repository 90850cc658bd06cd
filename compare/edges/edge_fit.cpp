#include "compare/edges/edge_fit.h"

#include <fmt/format.h>
#include <math.h>  // j1, jn: POSIX, not in namespace std

#include <Eigen/Dense>

#include "core/program/errors.h"
#include "core/statistics/covariance.h"

namespace etalon {
namespace {

using Eigen::ArrayXd;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using std::numbers::pi;

// Gauss and Legendre's rule with 8 points on [-1, 1], the positive half.
constexpr std::array<std::pair<double, double>, 4> gauss_legendre_8 = {
    {{0.1834346424956498, 0.3626837833783620},
     {0.5255324099163290, 0.3137066458778873},
     {0.7966664774136267, 0.2223810344533745},
     {0.9602898564975363, 0.1012285362903763}}};

struct Cell {
    Eigen::Index index;
    double part, sign;
};

Cell cell_of(double distance_px, Eigen::Index size) {
    const double position =
        std::min(std::abs(distance_px) / EdgeResponse::step(), static_cast<double>(size - 1));
    const auto index = std::min(static_cast<Eigen::Index>(position), size - 2);
    return {index, position - static_cast<double>(index), distance_px < 0.0 ? -1.0 : 1.0};
}

}  // namespace

ArrayXd pixel_transfer(const ArrayXd& cycles_per_px, const Eigen::Vector2d& normal) {
    const auto sinc = [](double x) {
        const double q = pi * x;
        return std::abs(q) < 1e-6 ? 1.0 : std::sin(q) / q;
    };
    return cycles_per_px.unaryExpr(
        [&](double f) { return sinc(f * normal.x()) * sinc(f * normal.y()); });
}

// d/d(r^2) of 2 J1(q)/q with dq/d(r^2) = q / (2 r^2): -J2(q) / r^2 = -(2 pi f)^2 J2(q) / q^2.
DiskTransfer disk_transfer(double frequency, double radius) {
    const double k = 2.0 * pi * frequency, q = k * radius;
    if (q < 1e-2)  // 1 - q^2/8 + q^4/192, and its derivative
        return {1.0 - q * q / 8.0 + q * q * q * q / 192.0, -k * k * (1.0 / 8.0 - q * q / 96.0)};
    return {2.0 * ::j1(q) / q, -k * k * ::jn(2, q) / (q * q)};
}

// A panel of 8 points spans at most one cycle of the fastest oscillation.
EdgeResponse::EdgeResponse(double reach_px) {
    if (!(reach_px > 0.0 && reach_px <= 100.0))
        throw NumericalError(fmt::format("no edge profile reaches {} px", reach_px));
    const auto panels = static_cast<Eigen::Index>(std::ceil(max_frequency * reach_px)) + 4;
    const double width = max_frequency / static_cast<double>(panels);
    frequencies_.resize(8 * panels);
    Eigen::ArrayXd weights(8 * panels);
    for (Eigen::Index panel = 0; panel < panels; ++panel)
        for (Eigen::Index i = 0; i < 8; ++i) {
            const auto& [node, weight] = gauss_legendre_8[static_cast<std::size_t>(i / 2)];
            const double centre = (static_cast<double>(panel) + 0.5) * width;
            frequencies_[8 * panel + i] = centre + 0.5 * width * (i % 2 == 0 ? node : -node);
            weights[8 * panel + i] = 0.5 * width * weight;
        }
    const auto distances = static_cast<Eigen::Index>(std::ceil(reach_px / step())) + 2;
    sines_.resize(distances, frequencies_.size());
    cosines_.resize(distances, frequencies_.size());
    for (Eigen::Index i = 0; i < distances; ++i) {
        const Eigen::ArrayXd phase = 2.0 * pi * static_cast<double>(i) * step() * frequencies_;
        sines_.row(i) = weights * phase.sin() / (pi * frequencies_);
        cosines_.row(i) = 2.0 * weights * phase.cos();
    }
}

EdgeValue edge_value(const Eigen::ArrayXd& odd, const Eigen::ArrayXd& even, double distance_px) {
    const auto [i, t, sign] = cell_of(distance_px, odd.size());
    const double a = odd[i], b = odd[i + 1], h = EdgeResponse::step();
    const double slope_a = h * even[i], slope_b = h * even[i + 1];
    const double cubic = 2.0 * (a - b) + slope_a + slope_b;
    const double square = 3.0 * (b - a) - 2.0 * slope_a - slope_b;
    const double value = a + t * (slope_a + t * (square + t * cubic));
    return {0.5 + sign * value, even[i] + t * (even[i + 1] - even[i])};
}

namespace {

// Prior standard deviations of an edge's own parameters, wide against what the pixels tell: light
// per px in parts of the step, and the edge's distance from where pose and print say.
constexpr double gradient_prior = 0.01, shift_prior_px = 1.0, turn_prior = 0.05;
constexpr double shift_room_px = 3.0;

constexpr int max_iterations = 50;
constexpr double outlier_ratio = 4.0;
constexpr int min_clusters = 8;
constexpr char undetermined[] = "edge fit: the edges do not determine the blur";

// What one edge contributes to the normal equations once its own six are eliminated.
struct Reduced {
    MatrixXd information;  // of the shared parameters
    VectorXd score;
    Eigen::LDLT<MatrixXd> own;
    Vector6d own_score;
    MatrixXd coupling;
    double chi_square = 0.0, squared_residuals = 0.0;
};

// Normal equations of one edge at its current own parameters; fills its residuals.
Reduced reduce(const StraightEdge& edge, const EdgeResponse& response, const BlurModel& model,
               const VectorXd& parameters, FittedEdge& fitted) {
    const Eigen::Index m = parameters.size();
    const ArrayXd pixel_box = pixel_transfer(response.frequencies(), edge.normal);
    const BlurModel::Transfer lens = model.transfer(edge, parameters, response.frequencies());
    const ArrayXd odd = response.odd_table(pixel_box * lens.value),
                  even = response.even_table(pixel_box * lens.value);
    std::vector<ArrayXd> by_parameter;
    for (Eigen::Index k = 0; k < m; ++k)
        by_parameter.push_back(response.odd_table(pixel_box * lens.derivative.col(k).array()));
    Matrix6d own = Matrix6d::Zero();
    Reduced reduced{
        MatrixXd::Zero(m, m), VectorXd::Zero(m), {}, Vector6d::Zero(), MatrixXd::Zero(6, m)};
    fitted.residuals.clear();
    VectorXd shared(m);
    for (const EdgePixel& pixel : edge.pixels) {
        const double d = pixel.distance_px, t = pixel.along_px;
        const double place = fitted.place_px(pixel), height = fitted.height(pixel);
        const EdgeValue at = edge_value(odd, even, place);
        const double expected = fitted.own[0] + height * at.response;
        const double residual = pixel.radiance - expected;
        const double weight = 1.0 / edge.noise.variance(expected);
        Vector6d row;
        row << 1.0, at.response, d * at.response, t * at.response, -height * at.spread,
            -height * at.spread * t;
        const auto [i, part, sign] = cell_of(place, odd.size());
        for (Eigen::Index k = 0; k < m; ++k) {
            const ArrayXd& table = by_parameter[static_cast<std::size_t>(k)];
            shared[k] = height * (sign * (table[i] + part * (table[i + 1] - table[i])));
        }
        own.noalias() += weight * row * row.transpose();
        reduced.own_score += weight * residual * row;
        reduced.coupling.noalias() += weight * row * shared.transpose();
        reduced.information.noalias() += weight * shared * shared.transpose();
        reduced.score += weight * residual * shared;
        reduced.chi_square += weight * residual * residual;
        reduced.squared_residuals += residual * residual;
        fitted.residuals.push_back(residual);
    }
    const double by_gradient = 1.0 / std::pow(gradient_prior * fitted.own[1], 2);
    Vector6d prior;
    prior << 0.0, 0.0, by_gradient, by_gradient, 1.0 / (shift_prior_px * shift_prior_px),
        1.0 / (turn_prior * turn_prior);
    own.diagonal() += prior;
    reduced.own_score -= prior.cwiseProduct(fitted.own);
    reduced.chi_square += prior.dot(fitted.own.cwiseAbs2());
    reduced.own.compute(MatrixXd(own));
    const MatrixXd eliminated = reduced.own.solve(reduced.coupling);
    reduced.information -= reduced.coupling.transpose() * eliminated;
    reduced.score -= eliminated.transpose() * reduced.own_score;
    return reduced;
}

FittedEdge first_guess(const StraightEdge& edge) {
    if (own_freedom(edge) <= 0)
        throw NumericalError(fmt::format("edge fit: an edge of {} pixels", edge.pixels.size()));
    const auto [dark, light] = side_levels(edge);
    if (!(light > dark))
        throw NumericalError(fmt::format("an edge at ({:.1f}, {:.1f}) px has no lighter side",
                                         edge.centre_px.x(), edge.centre_px.y()));
    FittedEdge fitted;
    fitted.own.head<2>() << dark, light - dark;
    return fitted;
}

// Least of 1/2 x^T A x - b^T x with x >= lower: Lawson and Hanson's active set from x = 0.
VectorXd bounded_step(const MatrixXd& a, const VectorXd& b, const VectorXd& lower) {
    constexpr double least_gain = 1e-9;
    VectorXd x = VectorXd::Zero(b.size());
    std::vector<Eigen::Index> free;
    for (Eigen::Index i = 0; i < b.size(); ++i)
        if (lower[i] < 0.0)
            free.push_back(i);
    for (Eigen::Index round = 0; round < 10 * b.size() + 10; ++round) {
        // To the least over the free ones; whichever meets its bound on the way stays there.
        while (!free.empty()) {
            const VectorXd gradient = b - a * x;
            const VectorXd step = MatrixXd(a(free, free)).ldlt().solve(VectorXd(gradient(free)));
            double part = 1.0;
            auto blocking = free.end();
            for (auto at = free.begin(); at != free.end(); ++at) {
                const double delta = step[at - free.begin()], room = lower[*at] - x[*at];
                if (delta < room && room / delta < part) {
                    part = room / delta;
                    blocking = at;
                }
            }
            x(free) += part * step;
            if (blocking == free.end())
                break;
            x[*blocking] = lower[*blocking];
            free.erase(blocking);
        }
        ArrayXd gain = (b - a * x).array() / a.diagonal().array().sqrt();
        for (const Eigen::Index i : free)
            gain[i] = 0.0;
        Eigen::Index best = 0;
        if (!(gain.maxCoeff(&best) > least_gain))
            break;
        free.insert(std::ranges::lower_bound(free, best), best);
    }
    return x;
}

struct Sums {
    MatrixXd information;
    VectorXd score;
    std::vector<Reduced> edges;
    double chi_square = 0.0;
};

Sums sum_up(std::span<const StraightEdge> edges, const EdgeResponse& response,
            const BlurModel& model, EdgeFit& fit) {
    const Eigen::Index m = fit.parameters.size();
    Sums sums{MatrixXd::Zero(m, m), VectorXd::Zero(m), {}, 0.0};
    double weight = 0.0;
    for (std::size_t i = 0; i < edges.size(); ++i) {
        sums.edges.emplace_back();
        if (fit.edges[i].is_outlier)
            continue;
        sums.edges.back() = reduce(edges[i], response, model, fit.parameters, fit.edges[i]);
        const Reduced& edge = sums.edges.back();
        sums.information += edge.information;
        sums.score += edge.score;
        sums.chi_square += edge.chi_square;
        weight += static_cast<double>(edges[i].pixels.size()) / edges[i].noise.variance(0.5);
    }
    if (model.are_parts) {  // a penalty: the edges' steps leave the sum of the parts open
        const double missing = 1.0 - fit.parameters.sum();
        sums.information.array() += weight;
        sums.score.array() += weight * missing;
        sums.chi_square += weight * missing * missing;
    }
    if (!sums.information.allFinite() || !sums.score.allFinite() || !std::isfinite(sums.chi_square))
        throw NumericalError("edge fit: not finite");
    return sums;
}

// One step of all parameters, shared and own, by the part `part` of Gauss and Newton's.
void take_step(const Sums& sums, const VectorXd& step, double part, EdgeFit& fit) {
    fit.parameters += part * step;
    for (std::size_t i = 0; i < fit.edges.size(); ++i) {
        if (fit.edges[i].is_outlier)
            continue;
        const Reduced& edge = sums.edges[i];
        fit.edges[i].own += part * edge.own.solve(edge.own_score - edge.coupling * step);
    }
}

// Gauss-Newton with halved steps where chi-square rises.
Sums iterate(std::span<const StraightEdge> edges, const EdgeResponse& response,
             const BlurModel& model, EdgeFit& fit) {
    constexpr double converged = 1e-9;  // of chi-square
    Sums sums = sum_up(edges, response, model, fit);
    for (int iteration = 0; iteration < max_iterations; ++iteration) {
        if (!(sums.information.diagonal().minCoeff() > 0.0))
            throw NumericalError(undetermined);
        const VectorXd step =
            bounded_step(sums.information, sums.score, model.lower - fit.parameters);
        const EdgeFit before = fit;
        double part = 1.0;
        Sums next;
        for (;; part *= 0.5) {
            take_step(sums, step, part, fit);
            next = sum_up(edges, response, model, fit);
            if (next.chi_square <= sums.chi_square * (1.0 + 1e-12) || part < 1e-6)
                break;
            fit = before;
        }
        const double gain = sums.chi_square - next.chi_square;
        sums = std::move(next);
        if (gain <= converged * sums.chi_square)
            return sums;
    }
    throw NumericalError(fmt::format("edge fit: no convergence in {} steps", max_iterations));
}

// Marks the edges that do not fit; true when there are any.
bool mark_outliers(std::span<const StraightEdge> edges, const Sums& sums, EdgeFit& fit) {
    std::vector<double> ratios;
    for (std::size_t i = 0; i < edges.size(); ++i) {
        fit.edges[i].reduced_chi_square = sums.edges[i].chi_square / own_freedom(edges[i]);
        ratios.push_back(fit.edges[i].reduced_chi_square);
    }
    const auto middle = ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2);
    std::nth_element(ratios.begin(), middle, ratios.end());
    for (FittedEdge& edge : fit.edges)
        edge.is_outlier = edge.reduced_chi_square > outlier_ratio * *middle;
    return std::ranges::any_of(fit.edges, &FittedEdge::is_outlier);
}

// Covariance as the header says: the formal one times how much larger the scatter of the edges'
// scores says it is, on average over the parameters.
MatrixXd covariance_of(const Sums& sums, const EdgeFit& fit, bool noise_is_known) {
    const auto found = covariance_from_information(sums.information, 0.0);
    if (!found || !found->allFinite())
        throw NumericalError(undetermined);
    const MatrixXd& inverse = *found;
    const double excess =
        noise_is_known ? std::max(1.0, fit.reduced_chi_square) : fit.reduced_chi_square;
    const MatrixXd covariance = excess * inverse;
    const auto m = static_cast<int>(inverse.rows());
    if (fit.used_edges < std::max(min_clusters, 2 * m))
        return covariance;
    MatrixXd scores = MatrixXd::Zero(m, m);
    for (std::size_t i = 0; i < sums.edges.size(); ++i)
        if (!fit.edges[i].is_outlier)
            scores += sums.edges[i].score * sums.edges[i].score.transpose();
    const double n = fit.used_edges;
    const MatrixXd robust = inverse * scores * inverse * (n / (n - m));
    return covariance * std::max(1.0, MatrixXd(covariance.ldlt().solve(robust)).trace() / m);
}

void summarize(std::span<const StraightEdge> edges, const BlurModel& model, const Sums& sums,
               EdgeFit& fit) {
    double squares = 0.0;
    int pixels = 0;
    for (std::size_t i = 0; i < edges.size(); ++i) {
        if (fit.edges[i].is_outlier)
            continue;
        ++fit.used_edges;
        pixels += static_cast<int>(edges[i].pixels.size());
        squares += sums.edges[i].squared_residuals / std::pow(fit.edges[i].own[1], 2);
        fit.edges[i].reduced_chi_square = sums.edges[i].chi_square / own_freedom(edges[i]);
    }
    fit.degrees_of_freedom = pixels - 6 * fit.used_edges - static_cast<int>(fit.parameters.size());
    if (fit.degrees_of_freedom <= 0)
        throw NumericalError(
            fmt::format("edge fit: {} pixels on {} edges", pixels, fit.used_edges));
    fit.reduced_chi_square = sums.chi_square / fit.degrees_of_freedom;
    fit.residual_rms = std::sqrt(squares / pixels);
    for (Eigen::Index k = 0; k < fit.parameters.size(); ++k)
        fit.is_at_bound.push_back(fit.parameters[k] <= model.lower[k]);
    fit.covariance = covariance_of(sums, fit, edges.front().noise.is_known);
}

}  // namespace

int own_freedom(const StraightEdge& edge) {
    return static_cast<int>(edge.pixels.size()) - 6;
}

EdgeFit fit_edges(std::span<const StraightEdge> edges, const BlurModel& model) {
    if (edges.empty())
        throw NumericalError("edge fit: no edges");
    const EdgeResponse response(reach_px(edges) + shift_room_px);
    EdgeFit fit;
    fit.parameters = model.start;
    for (const StraightEdge& edge : edges)
        fit.edges.push_back(first_guess(edge));
    Sums sums = iterate(edges, response, model, fit);
    if (mark_outliers(edges, sums, fit))
        sums = iterate(edges, response, model, fit);
    summarize(edges, model, sums, fit);
    return fit;
}

namespace {

constexpr double start_variance_px2 = 0.3;

// Gauss and Legendre's rule with 5 points on [0, 1].
constexpr std::array<std::pair<double, double>, 5> gauss_legendre_pairs = {
    {{0.0469100770306680, 0.1184634425280945},
     {0.2307653449471585, 0.2393143352496832},
     {0.5, 0.2844444444444444},
     {0.7692346550528415, 0.2393143352496832},
     {0.9530899229693320, 0.1184634425280945}}};

}  // namespace

double disk_radius_squared(const StraightEdge& edge, double aperture_mm, double focus) {
    const double defocus = edge.depth_term - focus, scale = aperture_mm * edge.px_per_unit;
    return scale * scale * (defocus * defocus + edge.depth_term_variance);
}

BlurTransfer blur_transfer(const StraightEdge& edge, double variance_px2, double radius_squared_px2,
                           const ArrayXd& cycles_per_px) {
    const double radius = std::sqrt(radius_squared_px2);
    const Eigen::Index n = cycles_per_px.size();
    BlurTransfer result{ArrayXd(n), ArrayXd(n), ArrayXd(n)};
    for (Eigen::Index i = 0; i < n; ++i) {
        const double q = cycles_per_px[i] * edge.px_per_pitch, fall = -2.0 * pi * pi * q * q;
        const DiskTransfer disk = disk_transfer(cycles_per_px[i], radius);
        const double gaussian = std::exp(fall * variance_px2);
        result.value[i] = gaussian * disk.value;
        result.by_variance[i] = fall * result.value[i];
        result.by_radius_squared[i] = gaussian * disk.by_radius_squared;
    }
    return result;
}

BlurModel gaussian_blur(const Aperture& aperture) {
    BlurModel model;
    model.start = VectorXd::Constant(1, start_variance_px2);
    model.lower = VectorXd::Zero(1);
    model.transfer = [=](const StraightEdge& edge, const VectorXd& parameters,
                         const ArrayXd& frequencies) {
        const double focus =
            aperture.faces_rays ? aperture.focus_on_axis : aperture.focus(edge.undistorted);
        const BlurTransfer blur = blur_transfer(
            edge, parameters[0], disk_radius_squared(edge, aperture.radius_mm, focus), frequencies);
        return BlurModel::Transfer{blur.value, blur.by_variance};
    };
    return model;
}

EdgeWidth edge_width(const StraightEdge& edge) {
    const EdgeFit fit = fit_edges({&edge, 1}, gaussian_blur());
    const double along_normal = edge.px_per_pitch * edge.px_per_pitch;
    return {along_normal * fit.parameters[0], along_normal * std::sqrt(fit.covariance(0, 0))};
}

// The mean of uniform disks of the radii s between its own two, by their energy s^2.
double SlopingDisks::transfer(Eigen::Index k, double frequency) const {
    const double a = inner(k), b = outer(k);
    double sum = 0.0, energy = 0.0;
    for (const auto& [node, weight] : gauss_legendre_pairs) {
        const double s = a + (b - a) * node;
        sum += weight * s * s * disk_transfer(frequency, s).value;
        energy += weight * s * s;
    }
    return sum / energy;
}

MatrixXd SlopingDisks::density_by_part() const {
    MatrixXd density = MatrixXd::Zero(parts() + 1, parts());
    for (Eigen::Index k = 0; k < parts(); ++k) {
        const double a = inner(k), b = outer(k), volume = pi / 3.0 * (a * a + a * b + b * b);
        density.col(k).head(k + 1).setConstant(1.0 / volume);
    }
    return density;
}

// The transfers are tabulated once: an edge only scales their frequencies by a little.
BlurModel SlopingDisks::model() const {
    constexpr double min_step = 1.0 / 256.0;  // cycles per px
    constexpr double room = 1.5;              // for pixels that are not square
    const auto rows = static_cast<Eigen::Index>(room * max_frequency / min_step) + 2;
    MatrixXd table(rows, parts());
    for (Eigen::Index i = 0; i < rows; ++i)
        for (Eigen::Index k = 0; k < parts(); ++k)
            table(i, k) = transfer(k, static_cast<double>(i) * min_step);
    BlurModel model;
    model.start = VectorXd::Constant(parts(), 1.0 / static_cast<double>(parts()));
    model.lower = VectorXd::Zero(parts());
    model.are_parts = true;
    model.transfer = [table = std::move(table)](const StraightEdge& edge,
                                                const VectorXd& parameters,
                                                const ArrayXd& frequencies) {
        BlurModel::Transfer result{{}, MatrixXd(frequencies.size(), parameters.size())};
        for (Eigen::Index i = 0; i < frequencies.size(); ++i) {
            const double at = frequencies[i] * edge.px_per_pitch / min_step;
            const auto cell = std::min(static_cast<Eigen::Index>(at), table.rows() - 2);
            const double part = std::min(at - static_cast<double>(cell), 1.0);
            result.derivative.row(i) = (1.0 - part) * table.row(cell) + part * table.row(cell + 1);
        }
        result.value = (result.derivative * parameters).array();
        return result;
    };
    return model;
}

}  // namespace etalon
