#include "compare/detect/stag/stag_edges.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "compare/detect/stag/stag_reading.h"
#include "sim/marker/stag_pattern.h"

namespace etalon {
namespace {

constexpr int edges_a_side = 40, edges_around = 120;

// Inside the circle the outer ring of code discs begins at 0.35; where its discs are white, the
// next ring at 0.27.
constexpr double room_to_outer_ring = stag_circle_radius - 0.35;
constexpr double room_to_next_ring = stag_circle_radius - 0.28;

// How far a point of the upper side is from the circle below it.
double dark_below(double x) {
    const double square = stag_circle_radius * stag_circle_radius - x * x;
    return square > 0.0 ? 0.5 - std::sqrt(square) : 0.5;
}

// The four turns of an edge of the upper side.
void add_sides(std::vector<StagEdge>& edges) {
    for (int i = 0; i < edges_a_side; ++i) {
        const double x = (i + 0.5) / edges_a_side - 0.5;
        StagEdge edge{{x, -0.5}, {0.0, -1.0}, dark_below(x), stag_border, 0.5 - std::abs(x)};
        for (int quarter = 0; quarter < 4; ++quarter) {
            edges.push_back(edge);
            edge.place = {-edge.place.y(), edge.place.x()};
            edge.to_light = {-edge.to_light.y(), edge.to_light.x()};
        }
    }
}

// Whether a black disc of the outer ring, or what joins it to others, may be next to a direction.
bool black_towards(StagCode code, const Eigen::Vector2d& direction) {
    constexpr double outer_ring = 0.29, half_width = 0.065;
    const auto& points = stag_code_points();
    for (std::size_t i = 0; i < points.size(); ++i) {
        const double along = points[i].dot(direction);
        if ((code >> i & 1) != 0 && along > outer_ring - 0.01 &&
            (points[i] - along * direction).norm() < half_width)
            return true;
    }
    return false;
}

void add_circle(StagCode code, std::vector<StagEdge>& edges) {
    for (int i = 0; i < edges_around; ++i) {
        const double angle = 2.0 * std::numbers::pi * (i + 0.5) / edges_around;
        const Eigen::Vector2d outwards(std::cos(angle), std::sin(angle));
        const double to_side = 0.5 / outwards.lpNorm<Eigen::Infinity>() - stag_circle_radius;
        const double inside =
            black_towards(code, outwards) ? room_to_outer_ring : room_to_next_ring;
        edges.push_back({stag_circle_radius * outwards, -outwards, to_side, inside, 1.0});
    }
}

// Bilinear values at places in a row.
std::optional<std::vector<double>> profile_along(const cv::Mat& image,
                                                 const Eigen::Vector2d& middle,
                                                 const Eigen::Vector2d& step, int steps) {
    std::vector<double> values;
    for (int i = -steps; i <= steps; ++i) {
        const auto value = bilinear(image, middle + i * step);
        if (!value)
            return std::nullopt;
        values.push_back(*value);
    }
    return values;
}

double mean(std::vector<double>::const_iterator begin, std::vector<double>::const_iterator end) {
    double sum = 0.0;
    for (auto value = begin; value != end; ++value)
        sum += *value;
    return sum / static_cast<double>(end - begin);
}

// Where the step is, in samples from the middle of a profile from dark to light.
std::optional<double> step_place(const std::vector<double>& profile, double contrast) {
    const auto end_samples =
        static_cast<std::ptrdiff_t>(std::max<std::size_t>(1, profile.size() / 6));
    const double dark = mean(profile.begin(), profile.begin() + end_samples);
    const double light = mean(profile.end() - end_samples, profile.end());
    if (!(light - dark > contrast / 3.0))
        return std::nullopt;
    double area = 0.0;  // of the light part, by the trapezium rule
    for (std::size_t i = 0; i + 1 < profile.size(); ++i)
        area += (0.5 * (profile[i] + profile[i + 1]) - dark) / (light - dark);
    return 0.5 * static_cast<double>(profile.size() - 1) - area;
}

}  // namespace

std::vector<StagEdge> stag_edges(StagCode code) {
    std::vector<StagEdge> edges;
    add_sides(edges);
    add_circle(code, edges);
    return edges;
}

std::optional<MeasuredEdge> measure_edge(const cv::Mat& image, const StagView& view,
                                         const StagEdge& edge, double reach_px, double contrast) {
    constexpr double min_reach_px = 1.0, sample_px = 0.5, corner_px = 2.0, little = 1e-3;
    const Eigen::Vector2d middle = view.pixel(edge.place);
    const Eigen::Vector2d tangent(-edge.to_light.y(), edge.to_light.x());
    const Eigen::Vector2d along = (view.pixel(edge.place + little * tangent) - middle) / little;
    const Eigen::Vector2d across =
        (view.pixel(edge.place + little * edge.to_light) - middle) / little;
    Eigen::Vector2d normal = Eigen::Vector2d(-along.y(), along.x()).normalized();
    if (normal.dot(across) < 0.0)
        normal = -normal;
    const double room_px = normal.dot(across) * std::min(edge.dark_room, edge.light_room);
    const double reach = std::min(reach_px, 0.8 * room_px);
    if (!(reach >= min_reach_px) || edge.room_along * along.norm() < corner_px + reach)
        return std::nullopt;
    const int steps = static_cast<int>(std::ceil(reach / sample_px));
    const double spacing = reach / steps;
    const Eigen::Vector2d expected = middle + view.edge_shift_px() * normal;
    const auto profile = profile_along(image, expected, spacing * normal, steps);
    if (!profile)
        return std::nullopt;
    const auto place = step_place(*profile, contrast);
    if (!place)
        return std::nullopt;
    return MeasuredEdge{normal, *place * spacing};
}

}  // namespace etalon
