#include "station/stage_terms.h"

#include "core/errors.h"
#include "stage/kinematics.h"

namespace etalon {
namespace {

constexpr double relative_size = 1e-4;  // small enough for first order, far above rounding
constexpr double squareness_rad = 1e-4;

std::vector<Rigid> transforms(std::span<const Axis> axes,
                              const std::vector<std::vector<double>>& positions) {
    std::vector<Rigid> all;
    for (const auto& q : positions)
        all.push_back(base_from_carriage(axes, q));
    return all;
}

DeclaredStageTerm scale_term(std::span<const Axis> axes, std::size_t axis,
                             std::vector<std::vector<double>> positions) {
    for (auto& q : positions)
        q.at(axis) *= 1.0 + relative_size;
    DeclaredStageTerm term;
    term.error = {"stage scale " + axes[axis].name, "1", relative_size,
                  transforms(axes, positions)};
    term.is_linear_scale = axes[axis].kind == Axis::Kind::linear;
    term.in_budget = true;
    term.standard_uncertainty = axes[axis].scale_uncertainty;
    return term;
}

// The second axis leans towards the first one.
DeclaredStageTerm squareness_term(std::span<const Axis> axes, std::size_t first, std::size_t second,
                                  const std::vector<std::vector<double>>& positions) {
    std::vector<Axis> leaning(axes.begin(), axes.end());
    leaning[second].direction =
        (axes[second].direction + squareness_rad * axes[first].direction).normalized();
    DeclaredStageTerm term;
    term.error = {"stage squareness " + axes[first].name + axes[second].name, "rad", squareness_rad,
                  transforms(leaning, positions)};
    return term;
}

std::vector<double> middle(const std::vector<std::vector<double>>& positions) {
    std::vector<double> low = positions.front(), high = positions.front();
    for (const auto& q : positions)
        for (std::size_t i = 0; i < q.size(); ++i) {
            low[i] = std::min(low[i], q[i]);
            high[i] = std::max(high[i], q[i]);
        }
    for (std::size_t i = 0; i < low.size(); ++i)
        low[i] = (low[i] + high[i]) / 2.0;
    return low;
}

}  // namespace

std::vector<DeclaredStageTerm> declared_stage_terms(
    std::span<const Axis> axes, const std::vector<std::vector<double>>& positions) {
    std::vector<DeclaredStageTerm> terms;
    for (std::size_t i = 0; i < axes.size(); ++i)
        terms.push_back(scale_term(axes, i, positions));
    for (std::size_t i = 0; i < axes.size(); ++i)
        for (std::size_t j = i + 1; j < axes.size(); ++j)
            if (axes[i].kind == Axis::Kind::linear && axes[j].kind == Axis::Kind::linear)
                terms.push_back(squareness_term(axes, i, j, positions));
    return terms;
}

std::vector<DeclaredRepeatability> declared_repeatability(
    std::span<const Axis> axes, const std::vector<std::vector<double>>& positions,
    const Rigid& carriage_from_marker) {
    std::vector<DeclaredRepeatability> terms;
    if (positions.empty())
        return terms;
    const std::vector<double> q = middle(positions);
    const Eigen::Vector3d centre = carriage_from_marker.translation;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        DeclaredRepeatability term{axes[i].name, std::nullopt};
        if (axes[i].repeatability) {
            std::vector<double> moved = q;
            moved[i] += *axes[i].repeatability;
            term.marker_mm =
                (base_from_carriage(axes, moved) * centre - base_from_carriage(axes, q) * centre)
                    .norm();
        }
        terms.push_back(term);
    }
    return terms;
}

}  // namespace etalon
