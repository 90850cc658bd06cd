#include "study/pair_matrix.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/program/errors.h"
#include "core/statistics/median.h"

namespace etalon {
namespace {

// Never empty, and a little larger than [low, high].
PairAxis padded(double low, double high, double share) {
    const double room = high > low ? share * (high - low) : std::max(0.5, 0.1 * std::abs(low));
    return {low - room, high + room};
}

PairAxis bulk(const std::vector<double>& values) {
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    const double middle = median(values);
    const double reach = PairMatrix::robust_deviations * median_deviation(values);
    // More than half of the values alike say nothing of the others' scatter.
    if (reach == 0.0)
        return padded(*low, *high, 0.04);
    return padded(std::max(*low, middle - reach), std::min(*high, middle + reach), 0.04);
}

std::size_t cell(const PairAxis& axis, double value, std::size_t cells) {
    const double place = (value - axis.low) / (axis.high - axis.low) * static_cast<double>(cells);
    return static_cast<std::size_t>(std::clamp(place, 0.0, static_cast<double>(cells) - 1.0));
}

// Row 0 above the axis, 1 to PairMatrix::rows inside it, the next below.
std::size_t row(const PairAxis& axis, double error) {
    if (error > axis.high)
        return 0;
    if (error < axis.low)
        return PairMatrix::rows + 1;
    return PairMatrix::rows - cell(axis, error, PairMatrix::rows);
}

PairPanel empty_panel(const PairAxis& freedom) {
    PairPanel panel;
    panel.counts.resize(PairMatrix::columns * (PairMatrix::rows + 2));
    panel.bins.resize(PairMatrix::bins);
    const double width = (freedom.high - freedom.low) / PairMatrix::bins;
    for (std::size_t i = 0; i < PairMatrix::bins; ++i) {
        panel.bins[i].low = freedom.low + width * static_cast<double>(i);
        panel.bins[i].high = panel.bins[i].low + width;
    }
    return panel;
}

void add(PairPanel& panel, const PairAxis& freedom, double place, const PairAxis& axis,
         double error) {
    const std::size_t r = row(axis, error);
    ++panel.counts[r * PairMatrix::columns + cell(freedom, place, PairMatrix::columns)];
    PairBin& bin = panel.bins[cell(freedom, place, PairMatrix::bins)];
    bin.all.add(error);
    if (r > 0 && r <= PairMatrix::rows)
        bin.inside.add(error);
}

void find_axes(PairMatrix& matrix, std::span<const PoseComponents> truth,
               const DetectorErrors& errors) {
    for (std::size_t k = 0; k < pose_component_count; ++k) {
        const auto [low, high] = std::minmax_element(
            truth.begin(), truth.end(),
            [k](const PoseComponents& one, const PoseComponents& two) { return one[k] < two[k]; });
        matrix.freedoms[k] = padded((*low)[k], (*high)[k], 0.0);
        std::vector<double> values;
        for (const auto& error : errors)
            if (error)
                values.push_back(error->measures[k]);
        matrix.errors[k] = bulk(values);
    }
}

void count_beyond(PairMatrix& matrix, const DetectedError& error) {
    for (std::size_t e = 0; e < pose_component_count; ++e) {
        matrix.above[e] += error.measures[e] > matrix.errors[e].high;
        matrix.below[e] += error.measures[e] < matrix.errors[e].low;
    }
}

}  // namespace

std::uint32_t PairMatrix::highest_count() const {
    std::uint32_t highest = 0;
    for (const auto& line : panels)
        for (const PairPanel& panel : line)
            for (const std::uint32_t count : panel.counts)
                highest = std::max(highest, count);
    return highest;
}

PairMatrix pair_matrix(const std::string& detector, std::span<const PoseComponents> truth,
                       const DetectorErrors& errors) {
    if (truth.size() != errors.size())
        throw NumericalError(
            fmt::format("pair matrix: {} true poses and {} errors", truth.size(), errors.size()));
    PairMatrix matrix;
    matrix.detector = detector;
    matrix.poses = errors.size();
    matrix.detected = static_cast<std::size_t>(std::count_if(
        errors.begin(), errors.end(), [](const auto& error) { return error.has_value(); }));
    if (matrix.detected == 0)
        return matrix;
    find_axes(matrix, truth, errors);
    for (std::size_t e = 0; e < pose_component_count; ++e)
        for (std::size_t f = 0; f < pose_component_count; ++f)
            matrix.panels[e][f] = empty_panel(matrix.freedoms[f]);
    for (std::size_t i = 0; i < errors.size(); ++i) {
        if (!errors[i])
            continue;
        count_beyond(matrix, *errors[i]);
        for (std::size_t e = 0; e < pose_component_count; ++e)
            for (std::size_t f = 0; f < pose_component_count; ++f)
                add(matrix.panels[e][f], matrix.freedoms[f], truth[i][f], matrix.errors[e],
                    errors[i]->measures[e]);
    }
    return matrix;
}

std::string freedom_label(std::size_t component) {
    constexpr std::array names{"x", "y", "z", "roll", "pitch", "yaw"};
    return fmt::format("true {} / {}", names.at(component), error_measures.at(component).unit);
}

std::string error_label(std::size_t component) {
    return fmt::format("{} error / {}", error_measures.at(component).name,
                       error_measures.at(component).unit);
}

}  // namespace etalon
