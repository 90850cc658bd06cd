#include "compare/edges/edge_summary.h"

#include <fmt/format.h>

#include <Eigen/Dense>

#include "compare/edges/edge_fit.h"
#include "core/program/errors.h"
#include "core/statistics/covariance.h"
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

// Weighted by the elements' own variances; the deviation with Birge's ratio where above 1.
template <class Element, class Value, class Variance>
Mean weighted_mean(std::span<const Element> elements, Value value, Variance variance) {
    double weights = 0.0, sum = 0.0, squares = 0.0;
    for (const Element& element : elements) {
        weights += 1.0 / variance(element);
        sum += value(element) / variance(element);
    }
    const double mean = sum / weights;
    for (const Element& element : elements)
        squares += std::pow(value(element) - mean, 2) / variance(element);
    const double freedom = std::max(1.0, static_cast<double>(elements.size()) - 1.0);
    return {mean, std::sqrt(std::max(1.0, squares / freedom) / weights)};
}

// Equal ranges of a value from `first` to `last`: low <= value < high, the last one's end included.
template <class Element, class Value>
std::vector<std::vector<Element>> in_bins(std::span<const Element> elements, double first,
                                          double last, int bins, Value value) {
    if (bins < 1)
        throw NumericalError(fmt::format("edges: {} bins", bins));
    std::vector<std::vector<Element>> sorted(static_cast<std::size_t>(bins));
    for (const Element& element : elements) {
        const double place = first != last ? (value(element) - first) / (last - first) * bins : 0.0;
        sorted[static_cast<std::size_t>(std::clamp(static_cast<int>(place), 0, bins - 1))]
            .push_back(element);
    }
    return sorted;
}

void set_means(std::span<const EdgeShift> edges, EdgeSummary& summary) {
    const double excess = summary.shift.rms_px * summary.shift.rms_px;
    std::vector<double> sizes;
    for (const EdgeShift& edge : edges)
        sizes.push_back(std::abs(edge.shift_px));
    const Mean shift = weighted_mean(
        edges, [](const EdgeShift& edge) { return edge.shift_px; },
        [&](const EdgeShift& edge) { return variance_of(edge) + excess; });
    const Mean blur = weighted_mean(
        edges, [](const EdgeShift& edge) { return edge.blur_variance_px2; },
        [](const EdgeShift& edge) {
            return std::pow(std::max(edge.blur_deviation_px2, min_deviation_px), 2);
        });
    summary.mean_shift_px = shift.value;
    summary.mean_shift_deviation_px = shift.deviation;
    summary.mean_blur_px2 = blur.value;
    summary.mean_blur_deviation_px2 = blur.deviation;
    summary.median_shift_px = 1.4826 * median(std::move(sizes));
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

std::vector<EdgeBin> summarized(std::span<const EdgeShift> edges, double low, double high, int bins,
                                double EdgeShift::*value) {
    const auto sorted = in_bins(edges, low, high, bins, std::mem_fn(value));
    std::vector<EdgeBin> result;
    for (int bin = 0; bin < bins && !edges.empty(); ++bin)
        result.push_back({std::lerp(low, high, static_cast<double>(bin) / bins),
                          std::lerp(low, high, (bin + 1.0) / bins),
                          edge_summary(sorted[static_cast<std::size_t>(bin)])});
    return result;
}

}  // namespace

EdgeSummary edge_summary(std::span<const EdgeShift> edges) {
    std::vector<EdgeShift> within(edges.begin(), edges.end());
    std::erase_if(within, std::mem_fn(&EdgeShift::is_beyond_range));
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
    return summarized(edges, 0.0, 0.5 * std::hypot(image.width - 1.0, image.height - 1.0), bins,
                      &EdgeShift::radius_px);
}

std::vector<EdgeBin> edges_by_depth(std::span<const EdgeShift> edges, int bins) {
    if (edges.empty())
        return summarized(edges, 0.0, 0.0, bins, &EdgeShift::depth_mm);
    const auto [nearest, farthest] = std::ranges::minmax_element(edges, {}, &EdgeShift::depth_mm);
    return summarized(edges, nearest->depth_mm, farthest->depth_mm, bins, &EdgeShift::depth_mm);
}

namespace {

// An edge that was measured in both images.
struct Width {
    double inverse_depth;  // mean along the edge, 1/mm
    double measured_px2, deviation_px2;
    double rendered_px2;
};

// Both lists are in the grid's order; each may lack edges that the other has.
std::vector<Width> widths_of(std::span<const StraightEdge> photo,
                             std::span<const StraightEdge> rendering) {
    constexpr double min_deviation_px2 = 1e-4;  // the measurement's own errors
    std::vector<Width> widths;
    auto next = rendering.begin();
    for (const StraightEdge& edge : photo) {
        const auto same = std::find_if(next, rendering.end(), [&](const StraightEdge& other) {
            return other.centre_px == edge.centre_px;
        });
        if (same == rendering.end())
            continue;
        next = same + 1;
        const EdgeWidth measured = edge_width(edge);
        widths.push_back({edge.depth_term, measured.variance_px2,
                          std::max(measured.deviation_px2, min_deviation_px2),
                          edge_width(*same).variance_px2});
    }
    return widths;
}

// The lowest point of the weighted least-squares parabola through (inverse depth, width).
WidthMinimum minimum_of(std::span<const Width> widths, double Width::*width) {
    constexpr std::size_t min_edges = 12;
    constexpr double max_uncertainty = 0.1;  // of the range of inverse depths
    if (widths.size() < min_edges)
        return {false, fmt::format("{} edges, at least {} are needed", widths.size(), min_edges)};
    const auto [far, near] = std::ranges::minmax(widths, {}, &Width::inverse_depth);
    const double middle = 0.5 * (near.inverse_depth + far.inverse_depth);
    const double scale = 0.5 * (near.inverse_depth - far.inverse_depth);
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
    if (!(scale > 0.0) || !inverse)
        return {false, "the edges are all at one depth"};
    const Eigen::Vector3d c = *inverse * (design.transpose() * right);
    const double chi_square =
        (right - design * c).squaredNorm() / static_cast<double>(widths.size() - 3);
    const Eigen::Matrix3d covariance = std::max(1.0, chi_square) * *inverse;
    const double place = -0.5 * c[1] / c[2];  // in units of the range
    const Eigen::Vector3d by_c(0.0, -0.5 / c[2], 0.5 * c[1] / (c[2] * c[2]));
    const double uncertainty = std::sqrt(by_c.dot(covariance * by_c));
    if (!(c[2] > 3.0 * std::sqrt(covariance(2, 2))) || !(std::abs(place) < 1.0) ||
        !(uncertainty < 2.0 * max_uncertainty))
        return {false,
                fmt::format("the edges' width has no least value between {:.1f} and {:.1f} mm",
                            1.0 / near.inverse_depth, 1.0 / far.inverse_depth)};
    const double focus_mm = 1.0 / (middle + scale * place);
    return {true, {}, focus_mm, uncertainty * scale * focus_mm * focus_mm};
}

// Widths differ within a bin as the rendered ones do: the scatter is that of the differences.
void set_means(std::span<const Width> widths, DepthBin& bin) {
    const auto variance = [](const Width& one) { return one.deviation_px2 * one.deviation_px2; };
    const auto mean = [&](auto value) { return weighted_mean(widths, value, variance); };
    bin.depth_mm = 1.0 / mean(std::mem_fn(&Width::inverse_depth)).value;
    bin.measured_px2 = mean(std::mem_fn(&Width::measured_px2)).value;
    bin.rendered_px2 = mean(std::mem_fn(&Width::rendered_px2)).value;
    bin.measured_deviation_px2 =
        mean([](const Width& one) { return one.measured_px2 - one.rendered_px2; }).deviation;
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

std::vector<DepthBin> depth_bins(std::span<const Width> widths, std::span<const EdgeShift> shifts) {
    constexpr int bins = 8;
    const auto [far, near] = std::ranges::minmax(widths, {}, &Width::inverse_depth);
    const auto sorted = in_bins(widths, near.inverse_depth, far.inverse_depth, bins,
                                std::mem_fn(&Width::inverse_depth));
    std::vector<DepthBin> result;
    for (int i = 0; i < bins; ++i) {
        const auto edge_mm = [&, near = near.inverse_depth, far = far.inverse_depth](double part) {
            return 1.0 / std::lerp(near, far, part / bins);
        };
        const std::vector<Width>& inside = sorted[static_cast<std::size_t>(i)];
        DepthBin bin{edge_mm(i), edge_mm(i + 1), static_cast<int>(inside.size())};
        if (!inside.empty())
            set_means(inside, bin);
        bin.residual_rms_gray = residual_rms(shifts, bin.low_mm, bin.high_mm);
        result.push_back(bin);
    }
    return result;
}

}  // namespace

DefocusProfile defocus_profile(const CodeImage& photo, const Radiance& rendering,
                               const Projector& projector, const CellGrid& grid,
                               const Rigid& camera_from_marker, const ComparedArea& area,
                               std::span<const EdgeShift> shifts, const EdgeSelection& selection) {
    require_point_of_view(projector.camera(), "a profile of defocus");
    const LinearPhoto measured = linear_photo(photo, projector.camera());
    const LinearPhoto rendered{rendering, cv::Mat::zeros(rendering.size(), CV_8UC1),
                               measured.noise};
    const auto edges_in = [&](const LinearPhoto& image) {
        return target_edges(image, projector, grid, camera_from_marker, area, selection);
    };
    const std::vector<Width> widths = widths_of(edges_in(measured), edges_in(rendered));
    DefocusProfile profile;
    profile.edges = static_cast<int>(widths.size());
    profile.photo = minimum_of(widths, &Width::measured_px2);
    profile.rendering = minimum_of(widths, &Width::rendered_px2);
    if (!widths.empty())
        profile.bins = depth_bins(widths, shifts);
    return profile;
}

namespace {

// Which of the board's edges: across which axis, which quarter of a cell, which cell along it.
using EdgeName = std::array<int, 3>;

// With its shift along the axis, mm.
std::optional<std::pair<EdgeName, double>> on_board(const EdgeShift& edge,
                                                    const Rigid& camera_from_marker,
                                                    const Projector& projector,
                                                    const ComparedArea& area) {
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
    return std::pair(EdgeName{axis, static_cast<int>(std::lround(4.0 * cells[axis])),
                              static_cast<int>(std::floor(cells[1 - axis]))},
                     edge.shift_px / px_per_mm[axis]);
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
    constexpr std::size_t min_photos = 8;  // 2^7 signs: a chance of 1/128 can be seen
    if (photos.size() < min_photos)
        return std::nullopt;
    const auto count = static_cast<Eigen::Index>(photos.size());
    std::map<EdgeName, std::vector<std::pair<Eigen::Index, double>>> by_name;
    for (Eigen::Index i = 0; i < count; ++i) {
        const EdgesOfPhoto& photo = photos[static_cast<std::size_t>(i)];
        for (const EdgeShift& edge : photo.edges)
            if (const auto found = edge.is_beyond_range
                                       ? std::nullopt
                                       : on_board(edge, photo.camera_from_marker, projector, area))
                by_name[found->first].emplace_back(i, found->second);
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
