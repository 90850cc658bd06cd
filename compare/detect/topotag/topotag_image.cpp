#include "compare/detect/topotag/topotag_image.h"

#include <cmath>
#include <numbers>

#include "core/statistics/distributions.h"

namespace etalon {
namespace {

// The normal distribution and its density, from a table: right to 1e-5. Nothing is left of an edge
// beyond four sigmas (3e-5).
struct StepResponse {
    double value, slope;
};

class StepTable {
public:
    static constexpr int far_away = 4;

    StepTable() {
        for (int i = 0; i <= 2 * far_away * a_sigma + 1; ++i) {
            const double x = static_cast<double>(i) / a_sigma - far_away;
            steps_.push_back({normal_probability(x),
                              std::exp(-0.5 * x * x) / std::sqrt(2.0 * std::numbers::pi)});
        }
    }

    StepResponse at(double x) const {
        if (x <= -far_away)
            return {0.0, 0.0};
        if (x >= far_away)
            return {1.0, 0.0};
        const double place = (x + far_away) * a_sigma;
        const auto i = static_cast<std::size_t>(place);
        const double part = place - static_cast<double>(i);
        const StepResponse &low = steps_[i], &high = steps_[i + 1];
        return {low.value + part * (high.value - low.value),
                low.slope + part * (high.slope - low.slope)};
    }

private:
    static constexpr int a_sigma = 64;
    std::vector<StepResponse> steps_;
};

StepResponse step_at(double x) {
    static const StepTable table;
    return table.at(x);
}

// A strip of half width h at the distance d from its middle, both in sigmas of its blur: the value
// and its derivatives by d, by ln sigma and by h.
Eigen::Vector4d strip(double d, double h) {
    const double a = h - d, b = h + d;
    const StepResponse right = step_at(a), left = step_at(b);
    return {right.value + left.value - 1.0, left.slope - right.slope,
            -a * right.slope - b * left.slope, right.slope + left.slope};
}

Shade square_cover(const Eigen::Vector2d& d, double h, double growth, const SeenEdges& edges) {
    const Eigen::Vector4d x = strip(d.x() / edges.sigma.x(), h / edges.sigma.x() + growth);
    if (x[0] == 0.0)
        return {};
    const Eigen::Vector4d y = strip(d.y() / edges.sigma.y(), h / edges.sigma.y() + growth);
    return {x[0] * y[0],
            {x[1] * y[0] / edges.sigma.x(), x[0] * y[1] / edges.sigma.y(),
             x[2] * y[0] + x[0] * y[2], x[3] * y[0] + x[0] * y[3]}};
}

// The edge as if it were straight, times what makes the middle of a small disk right.
Shade disk_cover(const Eigen::Vector2d& d, double h, double growth, const SeenEdges& edges) {
    const double r = d.norm();
    const Eigen::Vector2d out = r > 1e-9 ? Eigen::Vector2d(d / r) : Eigen::Vector2d(1, 0);
    const double sigma = std::sqrt(out.dot(edges.covariance * out));
    const double a = (h - r) / sigma + growth;
    const StepResponse edge = step_at(a);
    if (edge.value == 0.0)
        return {};
    const double middle = 1.0 - std::exp(-0.5 * h * h / edges.area);
    const double height = middle / step_at(h / sigma).value;
    const Eigen::Vector2d slope = -height * edge.slope / sigma * out;
    return {height * edge.value,
            {slope.x(), slope.y(), -height * a * edge.slope, height * edge.slope}};
}

}  // namespace

// What is white grows and what is black shrinks; the last derivative is that by the growth.
Shade cover(const TopotagShape& shape, const Eigen::Vector2d& cell, const SeenEdges& edges) {
    const Eigen::Vector2d d = cell - shape.centre;
    const double sign = shape.is_white ? 1.0 : -1.0, growth = sign * edges.growth_in_sigmas;
    Shade result = shape.is_round ? disk_cover(d, shape.half_side, growth, edges)
                                  : square_cover(d, shape.half_side, growth, edges);
    result.slope[3] *= sign / edges.blur_px;
    return result;
}

std::vector<TopotagShape> shapes_between(const Eigen::Vector2d& low, const Eigen::Vector2d& high,
                                         std::span<const TopotagShape> shapes,
                                         const SeenEdges& edges) {
    const double tail = StepTable::far_away * edges.sigma.maxCoeff();
    std::vector<TopotagShape> seen;
    for (const TopotagShape& shape : shapes) {
        const Eigen::Array2d reach = Eigen::Array2d::Constant(shape.half_side + tail);
        if ((shape.centre.array() + reach > low.array()).all() &&
            (shape.centre.array() - reach < high.array()).all())
            seen.push_back(shape);
    }
    return seen;
}

Shade shade(std::span<const TopotagShape> shapes, const Eigen::Vector2d& cell,
            const SeenEdges& edges) {
    Shade result;
    for (const TopotagShape& shape : shapes) {
        const Shade over = cover(shape, cell, edges);
        const double colour = shape.is_white ? 1.0 : 0.0;
        result.slope = result.slope * (1.0 - over.value) + (colour - result.value) * over.slope;
        result.value += (colour - result.value) * over.value;
    }
    return result;
}

}  // namespace etalon
