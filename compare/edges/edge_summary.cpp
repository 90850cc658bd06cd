#include "compare/edges/edge_summary.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

#include "core/program/errors.h"
#include "core/statistics/distributions.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

// The rendering's own errors: no edge is known better, however little noise there is.
constexpr double min_deviation_px = 1e-4;

double variance_of(const EdgeShift& edge) {
    const double deviation = std::max(edge.shift_deviation_px, min_deviation_px);
    return deviation * deviation;
}

// Sum of squares over (variance + excess): falls with the excess.
double scaled_squares(std::span<const EdgeShift> edges, double excess) {
    double sum = 0.0;
    for (const EdgeShift& edge : edges)
        sum += edge.shift_px * edge.shift_px / (variance_of(edge) + excess);
    return sum;
}

// The excess variance at which each edge counts one on average, by bisection.
double excess_variance(std::span<const EdgeShift> edges) {
    constexpr int halvings = 60;
    const auto count = static_cast<double>(edges.size());
    if (scaled_squares(edges, 0.0) <= count)
        return 0.0;
    double low = 0.0, high = 0.0;
    for (const EdgeShift& edge : edges)
        high += edge.shift_px * edge.shift_px;  // there the sum is below 1
    for (int i = 0; i < halvings; ++i) {
        const double middle = 0.5 * (low + high);
        (scaled_squares(edges, middle) > count ? low : high) = middle;
    }
    return 0.5 * (low + high);
}

ShiftSpread spread_of(std::span<const EdgeShift> edges) {
    const double excess = excess_variance(edges), count = static_cast<double>(edges.size());
    double slope = 0.0, squares = 0.0, noise = 0.0;
    for (const EdgeShift& edge : edges) {
        slope += 1.0 / (variance_of(edge) + excess);
        squares += edge.shift_px * edge.shift_px;
        noise += edge.shift_deviation_px * edge.shift_deviation_px;
    }
    ShiftSpread spread;
    spread.rms_px = std::sqrt(excess);
    // The sum that is set to the count has twice the count as its variance, and about this slope.
    const double deviation = std::sqrt(2.0 * count) / slope;
    spread.rms_deviation_px = std::sqrt(excess + deviation) - spread.rms_px;
    spread.with_noise_px = std::sqrt(squares / count);
    spread.noise_px = std::sqrt(noise / count);
    return spread;
}

struct Mean {
    double value = 0.0, deviation = 0.0;
};

// Weighted, with the deviation from the weights times the root of the reduced chi-square where that
// is above 1 (Birge's ratio).
Mean weighted_mean(std::span<const double> values, std::span<const double> variances) {
    double weights = 0.0, sum = 0.0, squares = 0.0;
    for (std::size_t i = 0; i < values.size(); ++i) {
        weights += 1.0 / variances[i];
        sum += values[i] / variances[i];
    }
    const double mean = sum / weights;
    for (std::size_t i = 0; i < values.size(); ++i)
        squares += (values[i] - mean) * (values[i] - mean) / variances[i];
    const double freedom = std::max(1.0, static_cast<double>(values.size()) - 1.0);
    return {mean, std::sqrt(std::max(1.0, squares / freedom) / weights)};
}

void set_means(std::span<const EdgeShift> edges, EdgeSummary& summary) {
    const double excess = summary.shift.rms_px * summary.shift.rms_px;
    std::vector<double> shifts, shift_variances, blurs, blur_variances, sizes, chi_squares;
    for (const EdgeShift& edge : edges) {
        shifts.push_back(edge.shift_px);
        shift_variances.push_back(variance_of(edge) + excess);
        blurs.push_back(edge.blur_variance_px2);
        const double deviation = std::max(edge.blur_deviation_px2, min_deviation_px);
        blur_variances.push_back(deviation * deviation);
        sizes.push_back(std::abs(edge.shift_px));
        chi_squares.push_back(edge.reduced_chi_square);
    }
    const Mean shift = weighted_mean(shifts, shift_variances);
    const Mean blur = weighted_mean(blurs, blur_variances);
    summary.mean_shift_px = shift.value;
    summary.mean_shift_deviation_px = shift.deviation;
    summary.mean_blur_px2 = blur.value;
    summary.mean_blur_deviation_px2 = blur.deviation;
    summary.median_shift_px = 1.4826 * median(std::move(sizes));
    summary.median_chi_square = median(std::move(chi_squares));
}

EdgeParts parts_of(std::span<const EdgeShift> edges, int pixels) {
    EdgeShares sum;
    for (const EdgeShift& edge : edges) {
        sum.shift += edge.shares.shift;
        sum.blur += edge.shares.blur;
        sum.photometric += edge.shares.photometric;
        sum.rest += edge.shares.rest;
    }
    const auto root = [&](double share) {
        return std::copysign(std::sqrt(std::abs(share) / pixels), share);
    };
    return {root(sum.shift), root(sum.blur), root(sum.photometric), root(sum.rest),
            root(sum.total())};
}

std::vector<EdgeShift> edges_within_range(std::span<const EdgeShift> edges) {
    std::vector<EdgeShift> within;
    for (const EdgeShift& edge : edges)
        if (!edge.is_beyond_range)
            within.push_back(edge);
    return within;
}

// Nothing where the directions of the edges do not determine a vector.
std::optional<ShiftVector> vector_of(std::span<const EdgeShift> edges) {
    constexpr std::size_t min_edges = 4;
    // Of the normal equations' eigenvalues: edges of one direction, seen in perspective, have 0.
    constexpr double min_ratio = 0.05;
    if (edges.size() < min_edges)
        return {};
    Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    ShiftVector found;
    for (const EdgeShift& edge : edges) {
        const Eigen::Vector2d row = edge.normal / std::sqrt(variance_of(edge));
        information += row * row.transpose();
        right += edge.shift_px / std::sqrt(variance_of(edge)) * row;
        found.position_px += edge.middle_px / static_cast<double>(edges.size());
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(information);
    if (!(solver.eigenvalues()[0] > min_ratio * solver.eigenvalues()[1]))
        return {};
    found.shift_px = information.inverse() * right;
    found.edges = static_cast<int>(edges.size());
    double squares = 0.0;
    for (const EdgeShift& edge : edges) {
        const double rest = edge.shift_px - edge.normal.dot(found.shift_px);
        squares += rest * rest / variance_of(edge);
    }
    const double freedom = static_cast<double>(edges.size()) - 2.0;
    found.covariance_px2 = std::max(1.0, squares / freedom) * information.inverse();
    return found;
}

std::vector<EdgeBin> binned(std::span<const EdgeShift> edges, double low, double high, int bins,
                            double (*value)(const EdgeShift&)) {
    if (bins < 1)
        throw NumericalError(fmt::format("edges: {} bins", bins));
    if (edges.empty())
        return {};
    std::vector<std::vector<EdgeShift>> sorted(static_cast<std::size_t>(bins));
    for (const EdgeShift& edge : edges) {
        const double place = high > low ? (value(edge) - low) / (high - low) * bins : 0.0;
        sorted[static_cast<std::size_t>(std::clamp(static_cast<int>(place), 0, bins - 1))]
            .push_back(edge);
    }
    std::vector<EdgeBin> result;
    for (int bin = 0; bin < bins; ++bin)
        result.push_back({std::lerp(low, high, static_cast<double>(bin) / bins),
                          std::lerp(low, high, (bin + 1.0) / bins),
                          edge_summary(sorted[static_cast<std::size_t>(bin)])});
    return result;
}

}  // namespace

EdgeSummary edge_summary(std::span<const EdgeShift> edges) {
    const std::vector<EdgeShift> within = edges_within_range(edges);
    EdgeSummary summary;
    summary.edges = static_cast<int>(within.size());
    summary.beyond_range = static_cast<int>(edges.size() - within.size());
    if (within.empty())
        return summary;
    for (const EdgeShift& edge : within)
        summary.pixels += edge.pixels;
    summary.shift = spread_of(within);
    set_means(within, summary);
    summary.parts = parts_of(within, summary.pixels);
    return summary;
}

std::vector<EdgeShift> edges_of(std::span<const EdgeShift> edges, PixelUse use) {
    std::vector<EdgeShift> half;
    for (const EdgeShift& edge : edges)
        if (edge.use == use)
            half.push_back(edge);
    return half;
}

std::vector<ShiftVector> shift_field(std::span<const EdgeShift> edges, cv::Size image,
                                     double spacing_px) {
    if (!(spacing_px > 0.0) || !std::isfinite(spacing_px) || image.width < 1 || image.height < 1)
        throw NumericalError(fmt::format("edges: a field every {} px over {} x {} px", spacing_px,
                                         image.width, image.height));
    std::map<std::pair<long, long>, std::vector<EdgeShift>> squares;  // by row and column
    for (const EdgeShift& edge : edges)
        if (!edge.is_beyond_range)
            squares[{std::lround(std::floor((edge.middle_px.y() + 0.5) / spacing_px)),
                     std::lround(std::floor((edge.middle_px.x() + 0.5) / spacing_px))}]
                .push_back(edge);
    std::vector<ShiftVector> field;
    for (const auto& [place, inside] : squares)
        if (const auto vector = vector_of(inside))
            field.push_back(*vector);
    return field;
}

std::vector<EdgeBin> edges_by_radius(std::span<const EdgeShift> edges, cv::Size image, int bins) {
    return binned(edges, 0.0, 0.5 * std::hypot(image.width - 1.0, image.height - 1.0), bins,
                  [](const EdgeShift& edge) { return edge.radius_px; });
}

std::vector<EdgeBin> edges_by_depth(std::span<const EdgeShift> edges, int bins) {
    const auto nearer = [](const EdgeShift& a, const EdgeShift& b) {
        return a.depth_mm < b.depth_mm;
    };
    if (edges.empty())
        return binned(edges, 0.0, 0.0, bins, nullptr);
    const auto [nearest, farthest] = std::minmax_element(edges.begin(), edges.end(), nearer);
    return binned(edges, nearest->depth_mm, farthest->depth_mm, bins,
                  [](const EdgeShift& edge) { return edge.depth_mm; });
}

namespace {

// Which of the board's edges: across which axis, which quarter of a cell, which cell along it.
using EdgeName = std::array<int, 3>;

struct EdgeOnBoard {
    EdgeName name;
    double shift_mm;  // along the axis
};

std::optional<EdgeOnBoard> on_board(const EdgeShift& edge, const Rigid& camera_from_marker,
                                    const Projector& projector, const ComparedArea& area) {
    constexpr double min_px_per_mm = 1e-6;
    const auto ray = projector.ray(edge.middle_px);
    if (!ray)
        return std::nullopt;
    const Eigen::Vector3d normal = camera_from_marker.rotation * Eigen::Vector3d::UnitZ();
    const double depth = normal.dot(camera_from_marker.translation) / normal.dot(*ray);
    const Eigen::Vector3d point = camera_from_marker.inverse() * (depth * *ray);
    const Eigen::Array2d cells =
        (point.head<2>() - area.cell_corner_mm).array() / area.cell_mm.array();
    const auto moved_px = [&](int axis) {  // along the edge's normal, by a mm
        const auto pixel = projector.project(camera_from_marker *
                                             Eigen::Vector3d(point + Eigen::Vector3d::Unit(axis)));
        return pixel ? (*pixel - edge.middle_px).dot(edge.normal) : 0.0;
    };
    const std::array px_per_mm{moved_px(0), moved_px(1)};
    const int axis = std::abs(px_per_mm[0]) > std::abs(px_per_mm[1]) ? 0 : 1;
    if (!(std::abs(px_per_mm[axis]) > min_px_per_mm))
        return std::nullopt;
    return EdgeOnBoard{{axis, static_cast<int>(std::lround(4.0 * cells[axis])),
                        static_cast<int>(std::floor(cells[1 - axis]))},
                       edge.shift_px / px_per_mm[axis]};
}

// Of what all pairs of photographs share, with the sign that each is given: the sum over the pairs.
double shared(const Eigen::MatrixXd& products, const Eigen::VectorXd& signs) {
    return 0.5 * (signs.dot(products * signs) - products.trace());
}

double chance_of(const Eigen::MatrixXd& products) {
    constexpr int draws = 4095;
    const Eigen::Index photos = products.rows();
    const double seen = shared(products, Eigen::VectorXd::Ones(photos));
    RandomStream random(1, 1);
    int as_much = 1;  // the one that was seen
    Eigen::VectorXd signs(photos);
    for (int draw = 0; draw < draws; ++draw) {
        for (double& sign : signs)
            sign = random.uniform() < 0.5 ? -1.0 : 1.0;
        as_much += shared(products, signs) >= seen ? 1 : 0;
    }
    return as_much / (draws + 1.0);
}

}  // namespace

std::optional<BoardShifts> board_shifts(std::span<const EdgesOfPhoto> photos,
                                        const Projector& projector, const ComparedArea& area) {
    if (photos.size() < min_board_photos)
        return std::nullopt;
    const auto count = static_cast<Eigen::Index>(photos.size());
    std::map<EdgeName, std::vector<std::pair<Eigen::Index, double>>> by_name;
    for (Eigen::Index i = 0; i < count; ++i) {
        const EdgesOfPhoto& photo = photos[static_cast<std::size_t>(i)];
        for (const EdgeShift& edge : photo.edges)
            if (const auto found = edge.is_beyond_range
                                       ? std::nullopt
                                       : on_board(edge, photo.camera_from_marker, projector, area))
                by_name[found->name].emplace_back(i, found->shift_mm);
    }
    Eigen::MatrixXd products = Eigen::MatrixXd::Zero(count, count);
    double squares = 0.0, edges = 0.0, pairs = 0.0;
    for (const auto& [name, shifts] : by_name)
        for (const auto& [i, a] : shifts) {
            squares += a * a;
            edges += 1.0;
            for (const auto& [k, b] : shifts)
                if (i != k) {
                    products(i, k) += a * b;
                    pairs += 0.5;
                }
        }
    if (pairs == 0.0 || !(squares > 0.0))
        return std::nullopt;
    const double common = shared(products, Eigen::VectorXd::Ones(count)) / pairs;  // mm^2
    BoardShifts result;
    result.share = std::clamp(common / (squares / edges), 0.0, 1.0);
    result.rms_mm = std::sqrt(std::max(common, 0.0));
    result.chance = chance_of(products);
    return result;
}

}  // namespace etalon
