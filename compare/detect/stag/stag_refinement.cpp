#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <numeric>

#include "compare/detect/stag/stag_detector.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

// How a STag marker lies in an image: a homography from the marker's plane (sides of its square,
// origin at its centre), and radial distortion about the image's centre by the division model with
// one number L (A. Fitzgibbon, CVPR 2001): offsets d from the centre, in half diagonals, are
// straight as d / (1 + L |d|^2). The homography's straight image agrees with the image at the
// marker's centre: L does not move it. Tone, overexposure and print gain move every edge alike.
class StagView {
public:
    static constexpr int parameters = 10;  // eight numbers of the homography, then these
    static constexpr int distortion_parameter = 8, shift_parameter = 9;
    using Parameters = Eigen::Matrix<double, parameters, 1>;
    using Derivatives = Eigen::Matrix<double, 2, parameters>;

    StagView(const Homography& start, const cv::Size& image)
        : image_from_marker_(start),
          image_centre_((image.width - 1) / 2.0, (image.height - 1) / 2.0),
          half_diagonal_px_(std::hypot(image.width, image.height) / 2.0),
          marker_centre_(offset(start.col(2).hnormalized())) {}

    double distortion() const { return distortion_; }
    double edge_shift_px() const { return edge_shift_px_; }  // towards the light

    Eigen::Vector2d pixel(const Eigen::Vector2d& point) const {
        const Eigen::Vector2d straight = (image_from_marker_ * point.homogeneous()).hnormalized();
        return image_centre_ + half_diagonal_px_ * bent(offset(straight), distortion_);
    }

    // Of pixel(point) by the homography's first eight numbers, the distortion, the shift (nothing).
    Derivatives derivatives(const Eigen::Vector2d& point) const {
        const Eigen::Vector3d whole = image_from_marker_ * point.homogeneous();
        const Eigen::Vector2d straight = whole.hnormalized(), d = offset(straight);
        const Eigen::RowVector3d row = point.homogeneous().transpose() / whole.z();
        const Eigen::RowVector3d none = Eigen::RowVector3d::Zero();
        Eigen::Matrix<double, 2, 8> of_homography;
        of_homography << row, none, -straight.x() * row.head<2>(),  //
            none, row, -straight.y() * row.head<2>();
        const Eigen::Vector2d seen = bent(d, distortion_);
        const Eigen::Matrix2d turn =
            slope(seen, distortion_).inverse() * slope(marker_centre_, distortion_);
        constexpr double little = 1e-5;
        const Eigen::Vector2d by_distortion = (bent(d, distortion_ + little) - seen) / little;
        Derivatives all;
        all << turn * of_homography, half_diagonal_px_ * by_distortion, Eigen::Vector2d::Zero();
        return all;
    }

    StagView moved(const Parameters& step) const {
        StagView view = *this;
        for (int i = 0; i < 8; ++i)
            view.image_from_marker_(i / 3, i % 3) += step[i];
        view.distortion_ += step[distortion_parameter];
        view.edge_shift_px_ += step[shift_parameter];
        return view;
    }

private:
    Eigen::Vector2d offset(const Eigen::Vector2d& pixel) const {
        return (pixel - image_centre_) / half_diagonal_px_;
    }
    static Eigen::Vector2d straightened(const Eigen::Vector2d& d, double distortion) {
        return d / (1.0 + distortion * d.squaredNorm());
    }
    // Of straightened(d).
    static Eigen::Matrix2d slope(const Eigen::Vector2d& d, double distortion) {
        const double scale = 1.0 / (1.0 + distortion * d.squaredNorm());
        return scale * Eigen::Matrix2d::Identity() -
               2.0 * distortion * scale * scale * d * d.transpose();
    }
    // Where an offset of the homography's image is seen; not finite where nothing is.
    Eigen::Vector2d bent(const Eigen::Vector2d& d, double distortion) const {
        const Eigen::Vector2d straight = straightened(marker_centre_, distortion) +
                                         slope(marker_centre_, distortion) * (d - marker_centre_);
        return 2.0 * straight / (1.0 + std::sqrt(1.0 - 4.0 * distortion * straight.squaredNorm()));
    }

    Homography image_from_marker_;
    Eigen::Vector2d image_centre_;
    double half_diagonal_px_;
    Eigen::Vector2d marker_centre_;
    double distortion_ = 0.0, edge_shift_px_ = 0.0;
};

// A point of a side or of the circle, in sides of the black square.
struct StagEdge {
    Eigen::Vector2d place;
    Eigen::Vector2d to_light;  // unit normal, from the dark to the light
    double dark_room = 0.0;    // free of other edges on each side of it, along the normal
    double light_room = 0.0;
    double room_along = 0.0;  // to the next corner
};

constexpr int edges_a_side = 40, edges_around = 120;

// The outer ring of code discs begins at 0.35, the next one at 0.27.
constexpr double room_to_outer_ring = stag_circle_radius - 0.35;
constexpr double room_to_next_ring = stag_circle_radius - 0.28;

// The four turns of an edge of the upper side.
void add_sides(std::vector<StagEdge>& edges) {
    for (int i = 0; i < edges_a_side; ++i) {
        const double x = (i + 0.5) / edges_a_side - 0.5;
        const double square = stag_circle_radius * stag_circle_radius - x * x;
        const double to_circle = 0.5 - std::sqrt(std::max(square, 0.0));
        StagEdge edge{{x, -0.5}, {0.0, -1.0}, to_circle, stag_border, 0.5 - std::abs(x)};
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

// Where the step is, in samples from the middle of a profile from dark to light.
std::optional<double> step_place(const std::vector<double>& profile, double contrast) {
    const auto end_samples =
        static_cast<std::ptrdiff_t>(std::max<std::size_t>(1, profile.size() / 6));
    const auto mean = [&](auto from) {
        return std::accumulate(from, from + end_samples, 0.0) / static_cast<double>(end_samples);
    };
    const double dark = mean(profile.begin()), light = mean(profile.end() - end_samples);
    if (!(light - dark > contrast / 3.0))
        return std::nullopt;
    double area = 0.0;  // of the light part, by the trapezium rule
    for (std::size_t i = 0; i + 1 < profile.size(); ++i)
        area += (0.5 * (profile[i] + profile[i + 1]) - dark) / (light - dark);
    return 0.5 * static_cast<double>(profile.size() - 1) - area;
}

// An edge where the image has it, compared with where the view has it.
struct MeasuredEdge {
    Eigen::Vector2d normal;  // unit, in the image, from the dark to the light
    double offset_px = 0.0;  // along it, from view.pixel(place) and the view's shift
};

// From the gray profile along the edge's normal, `reach_px` to either side at most: the area under
// it says where the step is. Nothing for less than a third of the marker's `contrast`, too near
// another edge, and not wholly in the image.
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
    std::vector<double> profile;
    for (int i = -steps; i <= steps; ++i) {
        const auto value = bilinear(image, expected + i * (spacing * normal));
        if (!value)
            return std::nullopt;
        profile.push_back(*value);
    }
    const auto place = step_place(profile, contrast);
    if (!place)
        return std::nullopt;
    return MeasuredEdge{normal, *place * spacing};
}

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

const Quad square_corners{Eigen::Vector2d(-0.5, -0.5), {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}};

Quad corners_of(const StagView& view) {
    Quad corners;
    for (std::size_t i = 0; i < 4; ++i)
        corners[i] = view.pixel(square_corners[i]);
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

// Prior standard deviations of the distortion at the image's corners and of the edges' shift, with
// edges of 0.1 px: they decide only where the marker cannot tell.
constexpr double usual_distortion = 0.3, usual_shift_px = 0.3, usual_edge_px = 0.1;

std::optional<Solution> solve(const std::vector<Row>& rows, const StagView& view) {
    Information information = Information::Zero();
    Parameters gradient = Parameters::Zero();
    const auto add_prior = [&](int parameter, double value, double usual) {
        const double weight = std::pow(usual_edge_px / usual, 2);
        information(parameter, parameter) += weight;
        gradient[parameter] -= weight * value;
    };
    add_prior(StagView::distortion_parameter, view.distortion(), usual_distortion);
    add_prior(StagView::shift_parameter, view.edge_shift_px(), usual_shift_px);
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
    for (const Eigen::Vector2d& corner : square_corners) {
        const auto derivatives = view.derivatives(corner);
        largest = std::max(
            largest,
            (derivatives * solution.covariance * derivatives.transpose()).diagonal().maxCoeff());
    }
    return solution.rms_px * std::sqrt(largest);
}

}  // namespace

std::optional<Quad> refine_stag(const cv::Mat& image, const Homography& start, StagCode code,
                                double contrast) {
    constexpr int max_rounds = 12, full_steps = 3;
    constexpr double settled_px = 0.003, settled_part = 0.2, max_shift = 0.15, max_rms_px = 0.5,
                     max_sigma_px = 0.25;
    std::vector<StagEdge> edges;
    add_sides(edges);
    add_circle(code, edges);
    StagView view(start, image.size());
    const Quad first = corners_of(view);
    double around = 0.0;
    for (std::size_t i = 0; i < 4; ++i)
        around += (first[(i + 1) % 4] - first[i]).norm();
    const double side = around / 4.0, reach_px = std::clamp(0.08 * side, 2.0, 8.0);
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
        return corners;
    }
    return std::nullopt;
}

}  // namespace etalon
