#include "compare/edges/board_shifts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "core/statistics/random.h"

namespace etalon {
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
