#include "calib/intrinsics/camera_consistency.h"

#include <Eigen/QR>
#include <numeric>
#include <tuple>

#include "calib/intrinsics/bundle_adjustment.h"
#include "calib/intrinsics/calibration_outliers.h"
#include "calib/intrinsics/calibration_start.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

using Indices = std::vector<std::size_t>;

// What a second camera may have of its own: fx fy cx cy k1 k2, the first of the standard model's.
// Of a telecentric one fx fy p1 p2 k1 k2.
constexpr int own_parameters = 6;

// With the centre held, which is nowhere without distortion; p1 and p2 do in first order what it
// does.
const CalibrationModel& telecentric_model() {
    static const CalibrationModel model{
        "telecentric", {"fx", "fy", "p1", "p2", "k1", "k2", "k3"}, Projection::telecentric};
    return model;
}

constexpr double least_noise_px = 0.01;  // exact points are taken to be no better

Indices first_indices(std::size_t count) {
    Indices all(count);
    std::iota(all.begin(), all.end(), std::size_t{0});
    return all;
}

std::vector<CalibrationView> chosen(std::span<const CalibrationView> views, const Indices& which) {
    std::vector<CalibrationView> some;
    for (const std::size_t i : which)
        some.push_back(views[i]);
    return some;
}

// A camera for some views, and what they leave.
struct GroupFit {
    CameraFit fit;
    double squares = 0.0;                  // of all points
    std::vector<ViewEquations> equations;  // what they leave is R's share
    double freedom = 0.0;                  // of the points

    GroupFit(std::span<const CalibrationView> views, CameraFit of_views, double parameters)
        : fit(std::move(of_views)),
          squares(weighted_squares(views, fit)),
          equations(view_equations(views, fit)),
          freedom(2.0 * double(point_count(views)) -
                  pose_parameters(fit.model.projection) * double(views.size()) - parameters) {}

    double variance() const { return freedom > 0.0 ? squares / freedom : 0.0; }
};

GroupFit fit_first(std::span<const CalibrationView> views, cv::Size size,
                   const CalibrationModel& model) {
    return {views, fit_camera(views, size, model), double(model.parameters.size())};
}

// A camera like the first one but for its own parameters. Throws NumericalError.
GroupFit fit_second(std::span<const CalibrationView> views, const CalibrationModel& model,
                    const CameraModel& first, int own) {
    const std::vector<BundleView> all = bundle_views(views);
    std::vector<Rigid> poses;
    for (const CalibrationView& view : views)
        poses.push_back(fit_view_pose(first, view));
    std::vector<int> free;
    for (int i = 0; i < own; ++i)
        free.push_back(parameter_index(model.parameters[std::size_t(i)]));
    const auto solution = adjust_bundle(all, bundle_of(first, poses, all), {.free = free});
    if (!solution)
        throw NumericalError("no second camera fits");
    return {views, fit_from(*solution, model, views, all, first), double(own)};
}

struct Split {
    const CalibrationModel* model;
    Indices rest, aside;
    GroupFit first, second;

    double squares() const { return first.squares + second.squares; }
    std::size_t views() const { return rest.size() + aside.size(); }
    double freedom(double views) const {
        const double p = double(model->parameters.size());
        return views * p - p - double(own_parameters);
    }
    std::vector<ViewEquations> equations() const {
        std::vector<ViewEquations> all = first.equations;
        all.insert(all.end(), second.equations.begin(), second.equations.end());
        return all;
    }
    // Of the views' equations, per degree of freedom: multiplies a formal variance. A second group
    // that its camera fits worse than the first's is no better explained.
    double dispersion() const {
        double left = 0.0;
        for (const ViewEquations& view : equations())
            left += view.rhs.squaredNorm();
        const double worse = std::max(1.0, second.variance() / first.variance());
        return std::max(worse * left / freedom(double(views())), least_noise_px * least_noise_px);
    }
    // What a second camera gains by following the noise of the last of the views aside.
    double price_of_view() const { return own_parameters * dispersion() / double(aside.size()); }
    double price() const {
        return own_parameters * dispersion() * (1.0 + std::log(double(aside.size())));
    }
    bool is_better_than(const Split& other) const {
        return squares() + price() < other.squares() + other.price();
    }
};

std::optional<Split> fitted(std::span<const CalibrationView> views, cv::Size size,
                            const CalibrationModel& model, Indices rest, Indices aside) {
    if (rest.size() < aside.size())
        std::swap(rest, aside);
    auto split = attempted([&] {
        GroupFit first = fit_first(chosen(views, rest), size, model);
        GroupFit second = fit_second(chosen(views, aside), model, first.fit.camera, own_parameters);
        return Split{&model, rest, aside, std::move(first), std::move(second)};
    });
    return split.value;
}

double cost_of(const CalibrationView& view, const CameraModel& camera) {
    auto squares = attempted([&] {
        double sum = 0.0;
        const auto residuals = view_residuals(camera, fit_view_pose(camera, view), view);
        for (std::size_t i = 0; i < residuals.size(); ++i)
            sum += (residuals[i] / view.sigma(i)).squaredNorm();
        return sum;
    });
    return squares.value.value_or(std::numeric_limits<double>::infinity());
}

// Each view where it fits better, until none moves.
Split settled(std::span<const CalibrationView> views, cv::Size size, Split split) {
    constexpr int max_rounds = 8;
    for (int round = 0; round < max_rounds; ++round) {
        Indices rest, aside;
        for (std::size_t i = 0; i < views.size(); ++i) {
            const double here = cost_of(views[i], split.first.fit.camera),
                         there = cost_of(views[i], split.second.fit.camera);
            (there + split.price_of_view() < here ? aside : rest).push_back(i);
        }
        if (aside.empty() || rest.empty() || aside == split.aside || aside == split.rest)
            break;
        auto next = fitted(views, size, *split.model, std::move(rest), std::move(aside));
        if (!next || !next->is_better_than(split))
            break;
        split = std::move(*next);
    }
    return split;
}

// What is left of the common equations when the views aside have parameters of their own.
double equations_left(std::span<const ViewEquations> equations, const Indices& aside) {
    const Eigen::Index p = equations.front().triangle.cols(), n = std::ssize(equations);
    Eigen::MatrixXd stack = Eigen::MatrixXd::Zero(n * p, p + own_parameters);
    Eigen::VectorXd right(n * p);
    for (Eigen::Index v = 0; v < n; ++v) {
        const ViewEquations& view = equations[static_cast<std::size_t>(v)];
        stack.block(v * p, 0, p, p) = view.triangle;
        right.segment(v * p, p) = view.rhs;
        if (std::ranges::binary_search(aside, static_cast<std::size_t>(v)))
            stack.block(v * p, p, p, own_parameters) = view.triangle.leftCols(own_parameters);
    }
    const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(stack);
    return (stack * qr.solve(right) - right).squaredNorm();
}

// The views in the order in which each alone would change the parameters along a direction, those
// that hardly say shrunk towards no change.
Indices by_own_wish(std::span<const ViewEquations> equations, const Eigen::VectorXd& direction) {
    std::vector<double> wishes, informations;
    for (const ViewEquations& view : equations) {
        const Eigen::VectorXd seen = view.triangle * direction;
        wishes.push_back(seen.dot(view.rhs));
        informations.push_back(seen.squaredNorm());
    }
    const double mean = std::accumulate(informations.begin(), informations.end(), 0.0) /
                        double(informations.size());
    for (std::size_t i = 0; i < wishes.size(); ++i)
        wishes[i] /= informations[i] + mean;
    Indices order = first_indices(equations.size());
    std::ranges::stable_sort(order, {}, [&](std::size_t i) { return wishes[i]; });
    return order;
}

std::vector<Indices> orders(std::span<const ViewEquations> equations, const CameraModel& camera) {
    const Eigen::Index p = equations.front().triangle.cols();
    Eigen::VectorXd zoom = Eigen::VectorXd::Zero(p);
    zoom[0] = camera.intrinsics.fx;
    zoom[1] = camera.intrinsics.fy;
    return {first_indices(equations.size()), by_own_wish(equations, zoom),
            by_own_wish(equations, Eigen::VectorXd::Unit(p, 2)),
            by_own_wish(equations, Eigen::VectorXd::Unit(p, 3))};
}

// The best split of each order at one place.
std::vector<Indices> starts(std::span<const ViewEquations> equations, const CameraModel& camera) {
    std::vector<Indices> best;
    for (const Indices& order : orders(equations, camera)) {
        double least = std::numeric_limits<double>::infinity();
        Indices of_order;
        for (std::size_t count = 1; count < order.size(); ++count) {
            Indices aside(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count));
            std::ranges::sort(aside);
            const double left = equations_left(equations, aside);
            if (left < least)
                std::tie(least, of_order) = std::tuple(left, std::move(aside));
        }
        if (std::ranges::find(best, of_order) == best.end())
            best.push_back(std::move(of_order));
    }
    return best;
}

std::optional<Split> best_split(std::span<const CalibrationView> views, cv::Size size,
                                const CalibrationModel& model, const GroupFit& common) {
    std::optional<Split> best;
    for (const Indices& aside : starts(common.equations, common.fit.camera)) {
        Indices rest;
        for (std::size_t i = 0; i < views.size(); ++i)
            if (!std::ranges::binary_search(aside, i))
                rest.push_back(i);
        auto split = fitted(views, size, model, rest, aside);
        if (!split)
            continue;
        split = settled(views, size, std::move(*split));
        if (!best || split->is_better_than(*best))
            best = std::move(split);
    }
    return best;
}

// The number of views that would say as much of the dispersion if all erred alike: of normal
// equations with p rows each (sum y)^2 / sum y^2 is n p / (p + 2).
double alike_views(const Split& split) {
    double sum = 0.0, of_squares = 0.0;
    for (const ViewEquations& view : split.equations()) {
        sum += view.rhs.squaredNorm();
        of_squares += std::pow(view.rhs.squaredNorm(), 2);
    }
    const double p = double(split.model->parameters.size());
    return std::min(double(split.views()), (1.0 + 2.0 / p) * sum * sum / of_squares);
}

double log_binomial(double n, double m) {
    return std::lgamma(n + 1) - std::lgamma(m + 1) - std::lgamma(n - m + 1);
}

// How unlikely so large a drop of the sum of squares is when one camera took all views.
double log_chance(const Split& split, double squares_of_one) {
    const double freedom = split.freedom(alike_views(split));
    if (!(freedom > 0.0))
        return 0.0;
    const double f = (squares_of_one - split.squares()) / own_parameters / split.dispersion();
    return std::log(fisher_tail(f, own_parameters, freedom));
}

bool is_needed(const Split& split, double squares_of_one) {
    const double n = double(split.views()), m = double(split.aside.size());
    const double splits = std::floor(n / 2.0) * std::exp(log_binomial(n, m));
    return log_chance(split, squares_of_one) < std::log(mixed_views_false_alarms / splits);
}

// The split that was found, with the richest model: where a lens does what the first model does not
// follow, photos alike in place and tilt err alike.
bool is_needed_with_richest(std::span<const CalibrationView> views, cv::Size size,
                            const Split& split) {
    const CalibrationModel& model = split.model->projection == Projection::perspective
                                        ? calibration_models().back()
                                        : *split.model;
    auto common = attempted([&] { return fit_first(views, size, model); });
    const auto richest = fitted(views, size, model, split.rest, split.aside);
    return !common || !richest ||
           log_chance(*richest, common->squares) < std::log(mixed_views_false_alarms);
}

CameraGroup described(Indices which, const Intrinsics& camera, double variance, double of_focal) {
    return {std::move(which), 0.5 * (camera.fx + camera.fy), std::sqrt(variance * of_focal)};
}

// Everything else free.
CameraGroup described(const Indices& which, const GroupFit& group, double variance) {
    const Eigen::MatrixXd inverse = inverse_information(group.equations, group.fit.model);
    return described(which, group.fit.camera.intrinsics, variance,
                     0.25 * inverse.topLeftCorner(2, 2).sum());
}

// Of views too few for a camera of their own: the first one, zoomed until it fits best.
CameraGroup described_by_zoom(const Split& split, std::span<const CalibrationView> views) {
    constexpr int steps = 10;
    CameraModel camera = split.first.fit.camera;
    double score = 0.0, information = 0.0;
    for (int step = 0; step < steps; ++step) {
        const GroupFit held = fit_second(views, *split.model, camera, 0);
        const Eigen::Vector2d zoom(camera.intrinsics.fx, camera.intrinsics.fy);
        score = information = 0.0;
        for (const ViewEquations& view : held.equations) {
            const Eigen::VectorXd seen = view.triangle.leftCols<2>() * zoom / zoom.mean();
            score += seen.dot(view.rhs);
            information += seen.squaredNorm();
        }
        const double factor = std::clamp(1.0 + score / information / zoom.mean(), 0.5, 2.0);
        camera.intrinsics.zoom(factor);
    }
    return described(split.aside, camera.intrinsics, split.dispersion(), 1.0 / information);
}

CameraGroup described_aside(std::span<const CalibrationView> views, cv::Size size,
                            const Split& split) {
    const auto some = chosen(views, split.aside);
    auto own = attempted([&] {
        return described(split.aside, fit_first(some, size, *split.model), split.dispersion());
    });
    return own ? std::move(*own) : described_by_zoom(split, some);
}

CameraGroup of_indices(CameraGroup group, const Indices& indices) {
    for (std::size_t& view : group.views)
        view = indices[view];
    return group;
}

// As camera_groups(), of views that show planes, in any order.
std::vector<CameraGroup> groups_among(std::span<const CalibrationView> views, cv::Size size,
                                      const CalibrationModel& model) {
    const Indices all = first_indices(views.size());
    auto common = attempted([&] { return fit_first(views, size, model); });
    if (!common || views.size() < min_mixed_views)
        return {{all}};
    const auto split = best_split(views, size, model, *common);
    if (!split || !is_needed(*split, common->squares) ||
        !is_needed_with_richest(views, size, *split))
        return {{all}};
    std::vector<CameraGroup> groups;
    const auto rest = described(split->rest, split->first, split->dispersion());
    for (const CameraGroup& part : {rest, described_aside(views, size, *split)}) {
        const auto parts = groups_among(chosen(views, part.views), size, model);
        if (parts.size() == 1)
            groups.push_back(part);
        else
            for (const CameraGroup& each : parts)
                groups.push_back(of_indices(each, part.views));
    }
    return groups;
}

}  // namespace

std::vector<CameraGroup> camera_groups(std::span<const CalibrationView> views, cv::Size size,
                                       bool is_telecentric) {
    const std::vector<bool> no_plane = are_no_planes(views);
    Indices planes, others;
    for (std::size_t i = 0; i < views.size(); ++i)
        (no_plane[i] ? others : planes).push_back(i);
    const bool is_wide =
        !is_telecentric && views.size() >= min_views && lens_angle(views, size) == LensAngle::wide;
    const CalibrationModel& model =
        is_telecentric ? telecentric_model()
                       : calibration_model(is_wide ? "kannala_brandt" : "standard");
    std::vector<CameraGroup> groups;
    for (const CameraGroup& group : groups_among(chosen(views, planes), size, model))
        groups.push_back(of_indices(group, planes));
    std::ranges::stable_sort(groups, std::ranges::greater{},
                             [](const CameraGroup& group) { return group.views.size(); });
    Indices& largest = groups.front().views;
    largest.insert(largest.end(), others.begin(), others.end());
    std::ranges::sort(largest);
    return groups;
}

}  // namespace etalon
