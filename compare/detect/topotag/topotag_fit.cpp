#include <Eigen/Dense>
#include <span>

#include "compare/detect/detector_adaptors.h"
#include "compare/detect/topotag/topotag_detector.h"
#include "core/statistics/distributions.h"
#include "sim/marker/topotag_pattern.h"

namespace etalon {
namespace {

// How a TopoTag's shapes are seen around a node: behind a normal blur, painted over each other as
// if each had been blurred alone.

// With derivatives by the place on the tag (per cell), ln blur and white's growth (per px).
struct Shade {
    double value = 0.0;  // 0 black, 1 white
    Eigen::Vector4d slope = Eigen::Vector4d::Zero();
};

// Edges as they are seen around a node, in cells: blurred, and all moved towards the black.
struct SeenEdges {
    SeenEdges(double blur, double growth_px, const Eigen::Matrix2d& cell_per_px)
        : covariance(blur * blur * cell_per_px * cell_per_px.transpose()),
          sigma(covariance.diagonal().cwiseSqrt()),
          area(std::sqrt(covariance.determinant())),
          blur_px(blur),
          growth_in_sigmas(growth_px / blur) {}

    Eigen::Matrix2d covariance;
    Eigen::Vector2d sigma;  // along the tag's axes
    double area, blur_px, growth_in_sigmas;
};

// The normal distribution and its density, from a table: right to 1e-5; 0 or 1 beyond four sigmas.
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

// A strip of half width h at d from its middle, in sigmas: value, derivatives by d, ln sigma and h.
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

// How much of a point (in cells) a shape covers. What is white grows and what is black shrinks.
Shade cover(const TopotagShape& shape, const Eigen::Vector2d& cell, const SeenEdges& edges) {
    const Eigen::Vector2d d = cell - shape.centre;
    const double sign = shape.is_white ? 1.0 : -1.0, growth = sign * edges.growth_in_sigmas;
    Shade result = shape.is_round ? disk_cover(d, shape.half_side, growth, edges)
                                  : square_cover(d, shape.half_side, growth, edges);
    result.slope[3] *= sign / edges.blur_px;
    return result;
}

// Those shapes of which something is seen between two corners, in the order of painting.
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

// All painted over each other on black.
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

// The tag around one node. The baseline's two vertices share a window.
struct Window {
    std::size_t first_vertex = 0;
    std::vector<TopotagShape> dots;  // at the vertices, whether they are there or not
    Eigen::Vector2d centre_cell, low_cell, high_cell;
    Eigen::Vector2d offset_px = Eigen::Vector2d::Zero();  // from where the homography puts it
};

struct WindowFit {
    double step = 0.0;  // white - black
    Eigen::Vector2d shift_px = Eigen::Vector2d::Zero();
    double blur_growth = 0.0;  // of the logarithm
    double white_growth_px = 0.0;
    double dot = 0.0;  // how much more of its dots is there than the pattern says
    double dot_deviation = 0.0;
    double residual_square = 0.0, variance = 0.0;
};

struct TagView {
    Eigen::Matrix3d pixel_from_cell, cell_from_pixel;
    std::vector<TopotagShape> shapes;
    double blur_px, white_growth_px;
};

// The pixels that may be in a window; nothing when the image does not hold all of them.
std::optional<cv::Rect> pixels_of(const Window& window, const TagView& view, const cv::Size& size) {
    Eigen::Array2d low = Eigen::Array2d::Constant(1e9), high = -low;
    for (const double x : {window.low_cell.x(), window.high_cell.x()})
        for (const double y : {window.low_cell.y(), window.high_cell.y()}) {
            const Eigen::Vector2d corner = seen_at(view.pixel_from_cell, {x, y}) + window.offset_px;
            low = low.min(corner.array());
            high = high.max(corner.array());
        }
    if (!(low.minCoeff() >= 0.0 && high.x() <= size.width - 1.0 && high.y() <= size.height - 1.0))
        return std::nullopt;
    const Eigen::Array2i first = low.ceil().cast<int>(), last = high.floor().cast<int>();
    return cv::Rect(first.x(), first.y(), last.x() - first.x() + 1, last.y() - first.y() + 1);
}

// Linear least squares in the order of the terms: dark, step, its change along x and y, the shift
// times the step (x, y), and times it the growths of blur and white and the dots.
class WindowEquations {
public:
    static constexpr int terms = 9;
    using Terms = Eigen::Matrix<double, terms, 1>;

    void add(const Terms& row, double value) {
        normal_.selfadjointView<Eigen::Lower>().rankUpdate(row);
        right_ += row * value;
        sum_ += value;
        square_ += value * value;
        ++count_;
    }

    std::optional<WindowFit> solve() const {
        if (count_ < 2 * terms)
            return std::nullopt;
        const Eigen::LDLT<Eigen::MatrixXd> solver{Eigen::MatrixXd(normal_)};
        const Eigen::VectorXd found = solver.solve(Eigen::VectorXd(right_)),
                              dot = solver.solve(Eigen::VectorXd(Terms::Unit(terms - 1)));
        if (!found.allFinite() || !dot.allFinite() || !(found[1] > 0.0))
            return std::nullopt;
        WindowFit fit;
        fit.step = found[1];
        fit.shift_px = found.segment<2>(4) / fit.step;
        fit.blur_growth = found[6] / fit.step;
        fit.white_growth_px = found[7] / fit.step;
        fit.dot = found[8] / fit.step;
        fit.residual_square = std::max(0.0, square_ - found.dot(right_));
        const double noise_square = fit.residual_square / (count_ - terms);
        fit.dot_deviation = std::sqrt(noise_square * std::max(0.0, dot[8])) / fit.step;
        fit.variance = square_ - sum_ * sum_ / count_;
        return fit;
    }

private:
    Eigen::Matrix<double, terms, terms> normal_ = Eigen::Matrix<double, terms, terms>::Zero();
    Terms right_ = Terms::Zero();
    double sum_ = 0.0, square_ = 0.0;
    int count_ = 0;
};

std::optional<WindowFit> fit_window(const cv::Mat& pixels, const Window& window,
                                    const TagView& view) {
    constexpr double max_a_side = 32.0;  // pixels; of larger windows only every n-th
    const auto area = pixels_of(window, view, pixels.size());
    const Eigen::Matrix2d cell_per_px =
        jacobian_at(view.cell_from_pixel, seen_at(view.pixel_from_cell, window.centre_cell));
    const SeenEdges edges(view.blur_px, view.white_growth_px, cell_per_px);
    if (!area || !(edges.sigma.allFinite() && edges.sigma.minCoeff() > 0.0))
        return std::nullopt;
    const std::vector<TopotagShape> shapes =
        shapes_between(window.low_cell, window.high_cell, view.shapes, edges);
    const int stride =
        static_cast<int>(std::ceil(std::max(area->width, area->height) / max_a_side));
    WindowEquations equations;
    for (int y = area->y; y < area->br().y; y += stride)
        for (int x = area->x; x < area->br().x; x += stride) {
            const Eigen::Vector2d cell =
                seen_at(view.cell_from_pixel, Eigen::Vector2d(x, y) - window.offset_px);
            if (!((cell.array() >= window.low_cell.array()).all() &&
                  (cell.array() <= window.high_cell.array()).all()))
                continue;
            const Shade m = shade(shapes, cell, edges);
            const Eigen::Vector2d slope = cell_per_px.transpose() * m.slope.head<2>();
            const Eigen::Vector2d away = cell - window.centre_cell;
            double dots = 0.0;
            for (const TopotagShape& shape : window.dots)
                dots += cover(shape, cell, edges).value;
            WindowEquations::Terms row;
            row << 1.0, m.value, m.value * away.x(), m.value * away.y(), -slope.x(), -slope.y(),
                m.slope[2], m.slope[3], dots;
            equations.add(row, pixels.at<float>(y, x));
        }
    return equations.solve();
}

// Windows reach to the middle of the gap to the next node.
std::vector<Window> windows_of(int order, bool is_round) {
    const Eigen::Vector2d reach = Eigen::Vector2d::Constant(topotag_spacing / 2.0);
    const std::vector<Eigen::Vector2d> cells = topotag_vertices(order);
    std::vector<Window> windows;
    for (std::size_t i = 0; i < cells.size(); i += windows.back().dots.size()) {
        const std::size_t count = i == 0 ? 2 : 1;
        const Eigen::Vector2d& last = cells[i + count - 1];
        Window window{i, {}, (cells[i] + last) / 2.0, cells[i] - reach, last + reach};
        for (std::size_t j = i; j < i + count; ++j)
            window.dots.push_back({cells[j], topotag_dot_half_side, is_round, true});
        windows.push_back(std::move(window));
    }
    return windows;
}

// The id with which the dots agree; nothing for one that no int holds.
std::optional<int> read_id(const std::vector<WindowFit>& fits, int id, int count) {
    long long result = 0;
    for (std::size_t i = 1; i < fits.size(); ++i) {  // the first is the baseline's
        const std::size_t weight = fits.size() - 1 - i;
        const double dot = static_cast<double>((static_cast<long long>(id) >> weight) & 1);
        if (dot + fits[i].dot > 0.5)
            result |= 1LL << weight;
    }
    if (result >= count)
        return std::nullopt;
    return static_cast<int>(result);
}

// All windows are within the frame, the first shape: without it they start black, as they should.
std::optional<TagView> view_of(const std::string& family, const TopotagFit& tag) {
    const auto h = homography(topotag_vertices(topotag_order(family)), tag.vertices);
    if (!h)
        return std::nullopt;
    std::vector<TopotagShape> shapes = topotag_shapes(family, tag.id);
    shapes.erase(shapes.begin());
    return TagView{*h, h->inverse(), std::move(shapes), tag.blur_px, tag.white_growth_px};
}

// Blur, step and how much is explained, of all windows together.
void summarise(const std::vector<WindowFit>& fits, TopotagFit& result) {
    constexpr double min_blur_px = 0.28;  // that of a pixel's box alone
    constexpr double max_growth = 0.5;
    std::vector<double> steps, growths, whites;
    double residual = 0.0, variance = 0.0;
    for (const WindowFit& fit : fits) {
        steps.push_back(fit.step);
        growths.push_back(fit.blur_growth);
        whites.push_back(fit.white_growth_px);
        residual += fit.residual_square;
        variance += fit.variance;
    }
    const double growth = std::clamp(median(growths), -max_growth, max_growth);
    result.blur_px = std::max(min_blur_px, result.blur_px * std::exp(growth));
    result.white_growth_px = std::clamp(result.white_growth_px + median(whites), -1.0, 1.0);
    result.step = median(steps);
    result.explained = 1.0 - residual / variance;
}

// Black nodes on white as strong as the others', and dots that are there or are not.
bool looks_like_a_tag(const std::vector<WindowFit>& fits, const TopotagFit& tag) {
    constexpr double min_explained = 0.8, min_step = 0.4;  // of the median
    constexpr double max_doubt = 0.35, max_dot_deviation = 0.1;
    return tag.explained > min_explained &&
           std::all_of(fits.begin(), fits.end(), [&](const WindowFit& fit) {
               return fit.step > min_step * tag.step && std::abs(fit.dot) < max_doubt &&
                      fit.dot_deviation < max_dot_deviation;
           });
}

}  // namespace

std::optional<TopotagFit> fit_topotag(const cv::Mat& pixels, const std::string& family,
                                      const std::vector<Eigen::Vector2d>& vertices) {
    constexpr int iterations = 3;
    constexpr double start_blur_px = 0.6;
    const int order = topotag_order(family), count = topotag_count(family);
    TopotagFit result{0, vertices};
    result.blur_px = start_blur_px;
    std::vector<Window> windows = windows_of(order, topotag_shapes(family, 0).back().is_round);
    std::vector<WindowFit> fits;
    for (int iteration = 0; iteration < iterations; ++iteration) {
        const auto view = view_of(family, result);
        if (!view)
            return std::nullopt;
        fits.clear();
        for (Window& window : windows) {
            const auto own =
                std::span(result.vertices).subspan(window.first_vertex, window.dots.size());
            const auto expected = [&](std::size_t i) {
                return seen_at(view->pixel_from_cell, window.dots[i].centre);
            };
            Eigen::Vector2d offsets = Eigen::Vector2d::Zero();
            for (std::size_t i = 0; i < own.size(); ++i)
                offsets += own[i] - expected(i);
            window.offset_px = offsets / static_cast<double>(own.size());
            const auto fit = fit_window(pixels, window, *view);
            if (!fit)
                return std::nullopt;
            fits.push_back(*fit);
            for (std::size_t i = 0; i < own.size(); ++i)
                own[i] = expected(i) + window.offset_px + fit->shift_px;
        }
        summarise(fits, result);
        const auto id = read_id(fits, result.id, count);
        if (!id)
            return std::nullopt;
        result.id = *id;
    }
    return looks_like_a_tag(fits, result) ? std::optional(result) : std::nullopt;
}

}  // namespace etalon
