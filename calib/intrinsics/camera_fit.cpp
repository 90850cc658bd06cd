#include "calib/intrinsics/camera_fit.h"

#include <fmt/format.h>

#include <Eigen/QR>
#include <Eigen/SVD>
#include <cmath>
#include <numeric>

#include "calib/intrinsics/bundle_adjustment.h"
#include "calib/intrinsics/calibration_covariance.h"
#include "calib/intrinsics/calibration_start.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr std::size_t min_pose_points = 4;

using Views = std::vector<BundleView>;
using Solution = BundleSolution;

std::vector<int> indices_of(const CalibrationModel& model) {
    std::vector<int> indices;
    for (const std::string& name : model.parameters)
        indices.push_back(parameter_index(name));
    return indices;
}

void check_input(std::span<const CalibrationView> views, cv::Size size,
                 const CalibrationModel& model) {
    if (size.width <= 0 || size.height <= 0)
        throw NumericalError(fmt::format("no image has {} x {} px", size.width, size.height));
    check_views(views);
    const std::size_t unknowns =
        model.parameters.size() +
        static_cast<std::size_t>(pose_parameters(model.projection)) * views.size();
    const std::size_t observations = 2 * point_count(views);
    if (observations < unknowns)
        throw NumericalError(fmt::format("{} coordinates for {} unknowns of model {}", observations,
                                         unknowns, model.name));
}

// Also of poses and equations that are asked for: what Eigen would read beyond, or NaN.
void check_camera(const CameraModel& camera, std::span<const Rigid> poses, std::size_t views) {
    require_possible(camera.projection);
    const CameraParameters parameters = all_parameters(camera);
    if (!parameters.allFinite() || !(parameters[0] > 0.0) || !(parameters[1] > 0.0))
        throw NumericalError(
            fmt::format("no camera has fx {} and fy {}", parameters[0], parameters[1]));
    if (poses.size() != views)
        throw NumericalError(fmt::format("{} poses for {} views", poses.size(), views));
    for (const Rigid& pose : poses)
        if (!pose.rotation.coeffs().allFinite() || !pose.translation.allFinite() ||
            !(pose.rotation.norm() > 0.0))
            throw NumericalError("a pose is not finite");
}

[[noreturn]] void refuse_start() {
    throw NumericalError(
        "the start puts a point behind the camera, or where the distortion folds over");
}

// With the bundle's camera.
std::optional<BundleSolution> adjusted_pose(const BundleView& view, const Bundle& bundle,
                                            const BundlePose& pose,
                                            const BundleOptions& options = {}) {
    return adjust_bundle({view}, {bundle.projection, bundle.camera, {pose}}, options);
}

// A pose to try in place of another, and by what factor its cost must be below the other's.
struct RivalPose {
    BundlePose pose;
    double less = 0.999;
};

// A telecentric camera sees tilts of either sign alike, near zero in second order only: where no
// tilt fits better, flat on is the minimum, to which and from which no steps lead.
std::vector<RivalPose> telecentric_others(const BundlePose& pose) {
    const Eigen::Vector3d origin = Eigen::Vector3d::Zero();
    const auto tilted = [&](double about_x, double about_y) -> RivalPose {
        return {{rotation_from_vector({about_x, about_y, 0.0}) * pose.rotation, pose.translation}};
    };
    if (is_flat_on(pose.rotation))
        return {tilted(0.03, 0.01), tilted(-0.01, 0.03)};
    if (tilt_rad(pose.rotation) > hardly_tilted_rad)
        return {};
    return {{bundle_pose(flat_on(rigid_from(pose, origin), origin), origin), 1.0 + 1e-6}};
}

// A plane seen without much perspective has two poses; the start may have taken the wrong one.
std::vector<RivalPose> other_poses(const BundlePose& pose, Projection projection) {
    if (projection == Projection::telecentric)
        return telecentric_others(pose);
    const Eigen::Vector3d origin = Eigen::Vector3d::Zero();
    return {{bundle_pose(mirrored_pose(rigid_from(pose, origin), origin), origin)}};
}

// Returns whether one was better than the one that there was.
bool choose_other_poses(const Views& views, Bundle& bundle, double huber) {
    const BundleOptions options{.free = {}, .huber = huber, .most_iterations = 8};
    bool changed = false;
    for (std::size_t i = 0; i < views.size(); ++i) {
        const auto others = other_poses(bundle.poses[i], bundle.projection.kind);
        if (others.empty())
            continue;
        auto best = adjusted_pose(views[i], bundle, bundle.poses[i], options);
        for (const RivalPose& each : others) {
            auto other = adjusted_pose(views[i], bundle, each.pose, options);
            if (!best || !other || !(other->cost < each.less * best->cost))
                continue;
            best = std::move(other);
            bundle.poses[i] = best->bundle.poses.front();
            changed = true;
        }
    }
    return changed;
}

// Adjusts until no other pose fits better.
std::optional<Solution> adjust_with_other_poses(const Views& views, const Bundle& start,
                                                const BundleOptions& options) {
    constexpr int max_rounds = 4;
    auto solution = adjust_bundle(views, start, options);
    for (int round = 0; solution && round < max_rounds; ++round) {
        if (!choose_other_poses(views, solution->bundle, options.huber))
            break;
        solution = adjust_bundle(views, solution->bundle, options);
    }
    return solution;
}

// The largest distance of a point from the axis, where the distance from the lens is 1.
double outermost(const Views& views, const Bundle& bundle) {
    double most = 0.0;
    for (std::size_t v = 0; v < views.size(); ++v) {
        const BundlePose& pose = bundle.poses[v];
        const Eigen::Matrix3Xd seen =
            (pose.rotation.toRotationMatrix() * views[v].points_mm).colwise() + pose.translation;
        const Eigen::ArrayXd squares = seen.topRows<2>().colwise().squaredNorm().transpose();
        most = std::max(most, (squares / seen.row(2).transpose().array().square()).maxCoeff());
    }
    return std::sqrt(most);
}

// One over the standard deviations that parameters have before a point is seen; 0: any.
CameraParameters prior_precisions(double r) {
    CameraParameters precisions = CameraParameters::Zero();
    const auto set = [&](const char* name, double precision) {
        precisions[parameter_index(name)] = precision;
    };
    set("k4", r * r / rational_deviation);
    set("k5", std::pow(r, 4) / rational_deviation);
    set("k6", std::pow(r, 6) / rational_deviation);
    for (const char* name : {"s1", "s3"})
        set(name, r / prism_deviation);
    for (const char* name : {"s2", "s4"})
        set(name, std::pow(r, 3) / prism_deviation);
    for (const char* name : {"tau_x", "tau_y"})
        set(name, r / tilt_deviation);
    return precisions;
}

// For points that scatter as they do about this bundle. Models of wide and telecentric lenses have
// none of these parameters.
CameraParameters pull_of(const Views& views, const Bundle& bundle, const BundleOptions& options) {
    if (bundle.projection.kind != Projection::perspective)
        return CameraParameters::Zero();
    BundleOptions of_points = options;
    of_points.pull.setZero();
    const auto cost = bundle_cost(views, bundle, of_points);
    double observations = 0.0;
    for (const BundleView& view : views)
        observations += 2.0 * static_cast<double>(view.pixels.cols());
    const double count = static_cast<double>(views.size()),
                 freedom = observations - static_cast<double>(options.free.size()) - 6.0 * count;
    if (!cost || !(freedom > 0.0))
        return CameraParameters::Zero();
    return std::sqrt(*cost / freedom / count) * prior_precisions(outermost(views, bundle));
}

// The first pull is that of a simpler model, which may fit far worse: until it and the points'
// scatter agree.
Solution with_its_own_pull(const Views& views, Solution solution, BundleOptions& options) {
    constexpr int max_rounds = 20;
    constexpr double settled = 0.01;
    for (int round = 0; round < max_rounds; ++round) {
        const CameraParameters next = pull_of(views, solution.bundle, options);
        if ((next - options.pull).norm() <= settled * next.norm())
            break;
        options.pull = next;
        solution = adjust_bundle(views, solution.bundle, options).value_or(std::move(solution));
    }
    return solution;
}

std::optional<Solution> better(std::optional<Solution> one, std::optional<Solution> other) {
    const bool other_is_better = other && (!one || other->cost < one->cost);
    return other_is_better ? std::move(other) : std::move(one);
}

// What is free, step by step. Perspective: models from the simplest distortion on; wide: first what
// every camera has; telecentric: magnification, distortion, then its centre.
std::vector<std::vector<int>> stages_of(const CalibrationModel& model) {
    const std::vector<int> all = indices_of(model);
    if (model.projection == Projection::telecentric) {
        if (all.size() == 2)
            return {all};
        std::vector<int> centred = all;
        std::erase_if(centred, [](int i) { return i == 2 || i == 3; });
        return {{0, 1}, centred, all};
    }
    std::vector<std::size_t> ends;
    if (model.projection == Projection::perspective)
        for (const CalibrationModel& simpler : calibration_models())
            ends.push_back(simpler.parameters.size());
    else
        ends = {4, camera_parameter_count};
    std::vector<std::vector<int>> stages;
    for (const std::size_t end : ends) {
        std::vector<int> free = all;
        std::erase_if(free, [&](int i) { return i >= static_cast<int>(end); });
        stages.push_back(free);
        if (free.size() == all.size())
            break;
    }
    return stages;
}

// Each stage from the one before, so that none fits worse than a model it contains, and each from
// the start at once, for lenses of 160 degrees.
std::optional<Solution> adjust_in_stages(const Views& views, const Bundle& start,
                                         const BundleOptions& options,
                                         const CalibrationModel& model) {
    std::optional<Solution> solution;
    for (const std::vector<int>& free : stages_of(model)) {
        BundleOptions stage = options;
        stage.free = free;
        if (solution)
            stage.pull = pull_of(views, solution->bundle, stage);
        const auto from_simpler =
            solution ? adjust_with_other_poses(views, solution->bundle, stage) : std::nullopt;
        solution = better(from_simpler, adjust_with_other_poses(views, start, stage));
    }
    return solution;
}

std::vector<CameraStart> starts_of(std::span<const CalibrationView> views, cv::Size size,
                                   Projection projection) {
    switch (projection) {
        case Projection::perspective:
            return {calibration_start(views, size)};
        case Projection::telecentric:
            return {telecentric_calibration_start(views, size)};
        default:
            return wide_calibration_starts(views, size, projection);
    }
}

std::optional<Solution> solve(std::span<const CalibrationView> views, cv::Size size,
                              const CalibrationModel& model, const Views& all,
                              const CameraFitOptions& options,
                              const BundleOptions& bundle_options) {
    if (options.start) {
        const CameraStart& start = *options.start;
        check_camera(start.camera, start.camera_from_target, views.size());
        if (start.camera.projection.kind != model.projection)
            throw NumericalError(fmt::format("model {} cannot start from a camera that is {}",
                                             model.name,
                                             name_of(start.camera.projection.kind).name));
        const Bundle bundle = bundle_of(start.camera, start.camera_from_target, all);
        BundleOptions pulled = bundle_options;
        pulled.pull = pull_of(all, bundle, bundle_options);
        return model.projection == Projection::telecentric
                   ? adjust_with_other_poses(all, bundle, pulled)
                   : adjust_bundle(all, bundle, pulled);
    }
    std::optional<Solution> best;
    for (const CameraStart& start : starts_of(views, size, model.projection))
        best = better(std::move(best),
                      adjust_in_stages(all, bundle_of(start.camera, start.camera_from_target, all),
                                       bundle_options, model));
    return best;
}

// The equations of all views below each other, columns scaled to length 1, after one more QR.
struct ScaledTriangle {
    Eigen::MatrixXd triangle;
    Eigen::VectorXd lengths;
};

ScaledTriangle scaled_triangle(std::span<const ViewEquations> equations,
                               const CalibrationModel& model) {
    const Eigen::Index free = static_cast<Eigen::Index>(model.parameters.size());
    const Eigen::Index views = static_cast<Eigen::Index>(equations.size());
    Eigen::MatrixXd stack(std::max<Eigen::Index>(views, 1) * free, free);
    stack.topRows(free).setZero();
    for (Eigen::Index v = 0; v < views; ++v)
        stack.middleRows(v * free, free) = equations[v].triangle;
    ScaledTriangle scaled;
    scaled.lengths = stack.colwise().norm().transpose();
    if (!scaled.lengths.allFinite() || !(scaled.lengths.array() > 0.0).all())
        throw NumericalError("these views say nothing about a parameter of model " + model.name);
    stack *= scaled.lengths.cwiseInverse().asDiagonal();
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(stack);
    scaled.triangle = qr.matrixQR().topRows(free).triangularView<Eigen::Upper>();
    return scaled;
}

std::string combination_of(const Eigen::VectorXd& direction, const CalibrationModel& model) {
    constexpr double min_part = 0.1;
    std::vector<int> order(direction.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(),
                     [&](int a, int b) { return std::abs(direction[a]) > std::abs(direction[b]); });
    const double sign = direction[order.front()] < 0.0 ? -1.0 : 1.0;
    std::string words;
    for (const int i : order) {
        const double part = sign * direction[i];
        if (std::abs(part) >= min_part)
            words += words.empty() ? fmt::format("{:.2f} {}", part, model.parameters[i])
                                   : fmt::format(" {} {:.2f} {}", part < 0.0 ? '-' : '+',
                                                 std::abs(part), model.parameters[i]);
    }
    return words;
}

WeakestDirection weakest_direction(const ScaledTriangle& scaled, const CalibrationModel& model) {
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(scaled.triangle, Eigen::ComputeThinV);
    const Eigen::VectorXd& values = svd.singularValues();
    const Eigen::Index last = values.size() - 1;
    return {combination_of(svd.matrixV().col(last), model), values[0] / values[last]};
}

Eigen::MatrixXd inverse_root(const ScaledTriangle& scaled, const CalibrationModel& model) {
    constexpr double max_condition = 1e11;  // leaves five digits of a step, of a deviation too
    const WeakestDirection weakest = weakest_direction(scaled, model);
    if (!(weakest.condition_number < max_condition))
        throw NumericalError(
            fmt::format("these views do not determine the camera: {} is free (condition number "
                        "{:.2g}); views of different tilt, or a simpler model, are needed",
                        weakest.combination, weakest.condition_number));
    const Eigen::Index size = scaled.triangle.cols();
    const Eigen::MatrixXd root =
        scaled.triangle.triangularView<Eigen::Upper>().solve(Eigen::MatrixXd::Identity(size, size));
    return scaled.lengths.cwiseInverse().asDiagonal() * root;
}

double variance_of(std::span<const CalibrationView> views, double squares,
                   const CalibrationModel& model) {
    const double freedom =
        2.0 * static_cast<double>(point_count(views)) -
        static_cast<double>(model.parameters.size()) -
        static_cast<double>(pose_parameters(model.projection)) * static_cast<double>(views.size());
    return freedom > 0.0 ? squares / freedom : 0.0;
}

CameraModel plain_camera(cv::Size size, Projection projection) {
    CameraModel camera;
    camera.projection.kind = projection;
    camera.width = size.width;
    camera.height = size.height;
    return camera;
}

// The undistorted points of pixels by Newton's method from the distorted ones; where it does not
// converge they stay near. For a start only.
std::vector<Eigen::Vector2d> roughly_undistorted(const CameraModel& camera,
                                                 const std::vector<Eigen::Vector2d>& pixels) {
    constexpr int steps = 8;
    const PixelModel<double> model(camera.projection, all_parameters(camera));
    std::vector<Eigen::Vector2d> undistorted;
    for (const Eigen::Vector2d& pixel : pixels) {
        Eigen::Vector2d u = camera.intrinsics.on_plane(pixel);
        for (int step = 0; step < steps; ++step) {
            const auto seen = model.on_plane(u);
            if (!seen.is_regular)
                break;
            u += seen.of.inverse() * (pixel - seen.pixel);
        }
        undistorted.push_back(u);
    }
    return undistorted;
}

std::optional<Rigid> rough_pose(const CameraModel& camera, const CalibrationView& view) {
    const std::vector<Eigen::Vector2d> undistorted = roughly_undistorted(camera, view.pixels);
    switch (camera.projection.kind) {
        case Projection::perspective:
            return pose_from_homography(view.points_mm, undistorted);
        case Projection::telecentric:
            return pose_from_affine(view.points_mm, undistorted);
        default:
            return pose_from_plane(view.points_mm, undistorted, camera.projection);
    }
}

}  // namespace

CameraFit fit_camera(std::span<const CalibrationView> views, cv::Size image_size,
                     const CalibrationModel& model, const CameraFitOptions& options) {
    check_input(views, image_size, model);
    BundleOptions bundle_options{indices_of(model), options.huber};
    const Views all = bundle_views(views);
    auto solution = solve(views, image_size, model, all, options, bundle_options);
    if (!solution)
        refuse_start();
    if (model.projection == Projection::perspective &&
        model.parameters.size() > calibration_model("standard").parameters.size())
        solution = with_its_own_pull(all, std::move(*solution), bundle_options);
    CameraFit fit = fit_from(
        *solution, model, views, all,
        options.start ? options.start->camera : plain_camera(image_size, model.projection));
    fit.pull = bundle_options.pull;
    fit.variance = variance_of(views, weighted_squares(views, fit), model);
    const std::vector<ViewEquations> equations = view_equations(views, fit);
    fit.condition_number = weakest_direction(equations, model).condition_number;
    check_identifiability(views, fit, equations);
    return fit;
}

CameraFit refit_camera(std::span<const CalibrationView> views, const CameraFit& fit,
                       std::vector<Rigid> poses) {
    return fit_camera(views, {fit.camera.width, fit.camera.height}, fit.model,
                      {.start = CameraStart{fit.camera, std::move(poses)}});
}

double sum_of_squares(std::span<const Eigen::Vector2d> residuals) {
    double sum = 0.0;
    for (const Eigen::Vector2d& residual : residuals)
        sum += residual.squaredNorm();
    return sum;
}

double CameraFit::rms_px() const {
    double squares = 0.0, points = 0.0;
    for (const auto& residuals : residuals_px) {
        squares += sum_of_squares(residuals);
        points += static_cast<double>(residuals.size());
    }
    return std::sqrt(squares / points);
}

double weighted_squares(std::span<const CalibrationView> views, const CameraFit& fit) {
    double squares = 0.0;
    for (std::size_t v = 0; v < views.size(); ++v)
        for (std::size_t i = 0; i < views[v].pixels.size(); ++i)
            squares += (fit.residuals_px[v][i] / views[v].sigma(i)).squaredNorm();
    return squares;
}

Rigid fit_view_pose(const CameraModel& camera, const CalibrationView& view) {
    check_camera(camera, {}, 0);
    check_view(view, 0, min_pose_points);
    const auto start = rough_pose(camera, view);
    if (!start)
        throw NumericalError("no pose fits the view: its points would be behind the camera");
    const Bundle bundle{camera.projection, all_parameters(camera), {}};
    const BundleView of_view = bundle_view(view);
    const BundlePose pose = bundle_pose(*start, of_view.centre_mm);
    auto best = adjusted_pose(of_view, bundle, pose);
    for (const RivalPose& each : other_poses(pose, camera.projection.kind)) {
        auto other = adjusted_pose(of_view, bundle, each.pose);
        if (!best || (other && other->cost <= best->cost))
            best = std::move(other);
    }
    if (!best)
        throw NumericalError("no pose fits the view: the camera's distortion folds over in it");
    return rigid_from(best->bundle.poses.front(), of_view.centre_mm);
}

std::vector<Eigen::Vector2d> view_residuals(const CameraModel& camera,
                                            const Rigid& camera_from_target,
                                            const CalibrationView& view) {
    const PixelModel<double> model(camera.projection, all_parameters(camera));
    std::vector<Eigen::Vector2d> residuals;
    for (std::size_t i = 0; i < view.pixels.size(); ++i) {
        const auto seen = model(camera_from_target * view.true_point_mm(i));
        if (!seen.is_regular)
            throw NumericalError(fmt::format(
                "the distortion folds over inside the image: no ray near pixel ({:.1f}, "
                "{:.1f})",
                view.pixels[i].x(), view.pixels[i].y()));
        residuals.push_back(view.pixels[i] - seen.pixel);
    }
    return residuals;
}

Eigen::Matrix2Xd parameter_jacobian(const CameraModel& camera, const Eigen::Vector3d& ray,
                                    const CalibrationModel& model) {
    PixelModel<double>::OfParameters all;
    PixelModel<double>(camera.projection, all_parameters(camera)).with_derivatives(ray, all);
    Eigen::Matrix2Xd jacobian(2, model.parameters.size());
    for (std::size_t i = 0; i < model.parameters.size(); ++i)
        jacobian.col(i) = all.col(parameter_index(model.parameters[i]));
    return jacobian;
}

std::vector<ViewEquations> view_equations(std::span<const CalibrationView> views,
                                          const CameraFit& fit) {
    check_camera(fit.camera, fit.camera_from_target, views.size());
    const PixelModel<double> pixel_model(fit.camera.projection, all_parameters(fit.camera));
    const BundleOptions options{.free = indices_of(fit.model), .pull = fit.pull};
    const Eigen::Index free = std::ssize(fit.model.parameters);
    std::vector<ViewEquations> equations;
    for (std::size_t v = 0; v < views.size(); ++v) {
        const BundleView view = bundle_view(views[v]);
        const Eigen::MatrixXd triangle = view_triangle(
            view, pixel_model, bundle_pose(fit.camera_from_target[v], view.centre_mm), options);
        equations.push_back({triangle.block(6, 6, free, free),
                             triangle.col(6 + free).segment(6, free),
                             triangle(6 + free, 6 + free) * triangle(6 + free, 6 + free)});
    }
    return equations;
}

Eigen::MatrixXd inverse_information(std::span<const ViewEquations> equations,
                                    const CalibrationModel& model) {
    const Eigen::MatrixXd root = inverse_information_root(equations, model);
    return root * root.transpose();
}

Eigen::MatrixXd inverse_information_root(std::span<const ViewEquations> equations,
                                         const CalibrationModel& model) {
    return inverse_root(scaled_triangle(equations, model), model);
}

WeakestDirection weakest_direction(std::span<const ViewEquations> equations,
                                   const CalibrationModel& model) {
    return weakest_direction(scaled_triangle(equations, model), model);
}

}  // namespace etalon
