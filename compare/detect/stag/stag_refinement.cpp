#include "compare/detect/stag/stag_refinement.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <vector>

#include "compare/detect/stag/stag_edges.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

using Parameters = StagView::Parameters;
using Information = Eigen::Matrix<double, StagView::parameters, StagView::parameters>;

// One row of the equations: how an edge moves along its normal, and how far it has to.
struct Row {
    Parameters derivative;
    double offset_px = 0.0;
    double weight = 1.0;
};

struct Solution {
    Parameters step;
    Information covariance;  // of the parameters, for edges of 1 px
    double weight = 0.0;     // of all edges
    double rms_px = 0.0;
};

const std::array<Eigen::Vector2d, 4>& square() {
    static const std::array<Eigen::Vector2d, 4> corners{
        Eigen::Vector2d(-0.5, -0.5), {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}};
    return corners;
}

Quad corners_of(const StagView& view) {
    Quad corners;
    for (std::size_t i = 0; i < 4; ++i)
        corners[i] = view.pixel(square()[i]);
    return corners;
}

std::vector<Row> measure(const cv::Mat& image, const StagView& view,
                         const std::vector<StagEdge>& edges, double reach_px, double contrast) {
    std::vector<Row> rows;
    for (const StagEdge& edge : edges)
        if (const auto found = measure_edge(image, view, edge, reach_px, contrast)) {
            Parameters derivative = view.derivatives(edge.place).transpose() * found->normal;
            derivative[StagView::shift_parameter] = 1.0;
            rows.push_back({derivative, found->offset_px});
        }
    return rows;
}

// What is usual, as the standard deviation of a belief, held against edges of a tenth of a pixel:
// distortion at the image's corners, and how far a tone curve moves edges. It decides only where
// the marker cannot tell.
constexpr double usual_distortion = 0.3, usual_shift_px = 0.3, usual_edge_px = 0.1;

void believe(int parameter, double value, double usual, Information& information,
             Parameters& gradient) {
    const double weight = std::pow(usual_edge_px / usual, 2);
    information(parameter, parameter) += weight;
    gradient[parameter] -= weight * value;
}

// Least squares.
std::optional<Solution> solve(const std::vector<Row>& rows, const StagView& view) {
    Information information = Information::Zero();
    Parameters gradient = Parameters::Zero();
    believe(StagView::distortion_parameter, view.distortion(), usual_distortion, information,
            gradient);
    believe(StagView::shift_parameter, view.edge_shift_px(), usual_shift_px, information, gradient);
    for (const Row& row : rows) {
        information += row.weight * row.derivative * row.derivative.transpose();
        gradient += row.weight * row.derivative * row.offset_px;
    }
    const Parameters scale = information.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::LDLT<Eigen::MatrixXd> factors{
        Eigen::MatrixXd(scale.asDiagonal() * information * scale.asDiagonal())};
    constexpr double min_pivot = 1e-9;
    if (!scale.allFinite() || !(factors.vectorD().minCoeff() > min_pivot))
        return std::nullopt;
    Solution solution;
    const Eigen::VectorXd step = factors.solve(Eigen::VectorXd(scale.cwiseProduct(gradient)));
    const Eigen::MatrixXd inverse =
        factors.solve(Eigen::MatrixXd(Eigen::MatrixXd::Identity(scale.size(), scale.size())));
    solution.step = scale.cwiseProduct(step);
    solution.covariance = scale.asDiagonal() * inverse * scale.asDiagonal();
    double squares = 0.0;
    for (const Row& row : rows) {
        solution.weight += row.weight;
        squares += row.weight * std::pow(row.offset_px - row.derivative.dot(solution.step), 2);
    }
    solution.rms_px = std::sqrt(squares / std::max(solution.weight, 1.0));
    return solution;
}

// Tukey's weights for what a solution leaves of each edge: none for what covers the marker.
void weigh(const Solution& solution, std::vector<Row>& rows) {
    constexpr double tuning = 4.685, min_px = 0.05;
    std::vector<double> rests;
    for (const Row& row : rows)
        rests.push_back(row.offset_px - row.derivative.dot(solution.step));
    const double reach = tuning * std::max(min_px, median_deviation(rests));
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const double part = rests[i] / reach;
        rows[i].weight = std::abs(part) < 1.0 ? std::pow(1.0 - part * part, 2) : 0.0;
    }
}

std::optional<Solution> solve_robustly(std::vector<Row> rows, const StagView& view) {
    constexpr int rounds = 3;
    constexpr double min_weight = 40.0;
    if (rows.empty())
        return std::nullopt;
    auto solution = solve(rows, view);
    for (int round = 0; solution && round < rounds; ++round) {
        weigh(*solution, rows);
        solution = solve(rows, view);
        if (solution && solution->weight < min_weight)
            return std::nullopt;
    }
    return solution;
}

double largest_distance(const Quad& a, const Quad& b) {
    double largest = 0.0;
    for (std::size_t i = 0; i < 4; ++i)
        largest = std::max(largest, (a[i] - b[i]).norm());
    return largest;
}

// The standard deviation of the worst corner's coordinate, from the edges' rests.
double corner_sigma(const StagView& view, const Solution& solution) {
    double largest = 0.0;
    for (const Eigen::Vector2d& corner : square()) {
        const auto derivatives = view.derivatives(corner);
        largest = std::max(
            largest,
            (derivatives * solution.covariance * derivatives.transpose()).diagonal().maxCoeff());
    }
    return solution.rms_px * std::sqrt(largest);
}

double mean_side(const Quad& corners) {
    double sum = 0.0;
    for (std::size_t i = 0; i < 4; ++i)
        sum += (corners[(i + 1) % 4] - corners[i]).norm();
    return sum / 4.0;
}

}  // namespace

std::optional<StagRefinement> refine_stag(const cv::Mat& image, const Homography& start,
                                          StagCode code, double contrast) {
    constexpr int max_rounds = 12, full_steps = 3;
    constexpr double settled_px = 0.003, settled_part = 0.2, max_shift = 0.15, max_rms_px = 0.5,
                     max_sigma_px = 0.25;
    const std::vector<StagEdge> edges = stag_edges(code);
    StagView view(start, image.size());
    const Quad first = corners_of(view);
    const double side = mean_side(first), reach_px = std::clamp(0.08 * side, 2.0, 8.0);
    for (int round = 0; round < max_rounds; ++round) {
        const auto solution = solve_robustly(measure(image, view, edges, reach_px, contrast), view);
        if (!solution)
            return std::nullopt;
        // Where an edge is measured depends on where it is expected: short steps end a to and fro.
        const StagView next = view.moved(solution->step * (round < full_steps ? 1.0 : 0.5));
        const Quad corners = corners_of(next);
        if (!(largest_distance(corners, first) <= std::max(3.0, max_shift * side)))
            return std::nullopt;
        const double shift = largest_distance(corners, corners_of(view));
        const double sigma = corner_sigma(next, *solution);
        view = next;
        if (shift > std::max(settled_px, settled_part * sigma))
            continue;
        if (!(solution->rms_px <= max_rms_px && sigma <= max_sigma_px))
            return std::nullopt;
        return StagRefinement{corners, view.edge_shift_px(), solution->rms_px, sigma};
    }
    return std::nullopt;
}

}  // namespace etalon
