#include "study/study_sizes.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "compare/expect/error_intervals.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

struct Bounds {
    double from_px;
    std::optional<double> to_px;

    bool hold(double size_px) const { return size_px >= from_px && (!to_px || size_px < *to_px); }
};
constexpr std::array<Bounds, 7> classes{
    {{0, 25}, {25, 40}, {40, 60}, {60, 100}, {100, {}}, {60, {}}, {0, {}}}};

// By rank: the smallest value that 95 % of them do not exceed.
double quantile_95(std::vector<double> values) {
    const std::size_t rank = (95 * values.size() + 99) / 100;
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(rank - 1);
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

void judge_corners(SizeClass& one, std::vector<double> corners_px) {
    if (corners_px.empty())
        return;
    if (corners_px.size() >= min_quantile_values)
        one.corner_quantile_px = quantile_95(corners_px);
    one.median_corner_px = median_estimate(corners_px);
}

}  // namespace

std::vector<SizeClass> size_classes(const DetectorErrors& errors, std::span<const double> sizes_px,
                                    std::span<const std::optional<double>> corner_rms_px) {
    if (sizes_px.size() != errors.size() || corner_rms_px.size() != errors.size())
        throw NumericalError(fmt::format("size classes: {} sizes and {} corner errors for {} poses",
                                         sizes_px.size(), corner_rms_px.size(), errors.size()));
    std::vector<SizeClass> result;
    for (const Bounds& bounds : classes) {
        SizeClass& one = result.emplace_back(SizeClass{bounds.from_px, bounds.to_px});
        std::size_t detected = 0;
        std::vector<double> corners_px;
        for (std::size_t i = 0; i < errors.size(); ++i) {
            if (!bounds.hold(sizes_px[i]))
                continue;
            ++one.poses;
            detected += errors[i].has_value();
            if (corner_rms_px[i])
                corners_px.push_back(*corner_rms_px[i]);
        }
        if (one.poses > 0)
            one.detected = wilson_share(detected, one.poses);
        judge_corners(one, std::move(corners_px));
    }
    return result;
}

std::string size_words(const SizeClass& one) {
    if (one.to_px)
        return one.from_px > 0.0 ? fmt::format("{:g} to {:g}", one.from_px, *one.to_px)
                                 : fmt::format("below {:g}", *one.to_px);
    return one.from_px > 0.0 ? fmt::format("from {:g}", one.from_px) : "all";
}

}  // namespace etalon
