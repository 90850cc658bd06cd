#include "calib/intrinsics/calibration_start.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <cmath>

#include "calib/camera/projector.h"
#include "calib/intrinsics/bundle_adjustment.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

Eigen::Vector2d middle_of(cv::Size image_size) {
    return {0.5 * (image_size.width - 1), 0.5 * (image_size.height - 1)};
}

CameraModel centred_camera(cv::Size image_size, const LensProjection& projection,
                           const Eigen::Vector2d& focal) {
    const Eigen::Vector2d principal = middle_of(image_size);
    return {.width = image_size.width,
            .height = image_size.height,
            .projection = projection,
            .intrinsics = {focal.x(), focal.y(), principal.x(), principal.y()}};
}

// Moves points to their centroid and scales them to a mean square of 2.
struct Normaliser {
    Eigen::Vector2d centre = Eigen::Vector2d::Zero();
    double scale = 1.0;

    template <typename Points>
    explicit Normaliser(const Points& points) {
        const double count = static_cast<double>(points.size());
        for (const auto& point : points)
            centre += point.template head<2>() / count;
        double squares = 0.0;
        for (const auto& point : points)
            squares += (point.template head<2>() - centre).squaredNorm() / count;
        scale = std::sqrt(2.0 / squares);
    }
    Eigen::Vector2d operator()(const Eigen::Vector2d& point) const {
        return scale * (point - centre);
    }
    Eigen::Matrix3d matrix() const {
        Eigen::Matrix3d map;
        map << scale, 0, -scale * centre.x(), 0, scale, -scale * centre.y(), 0, 0, 1;
        return map;
    }
};

// A view's plane, its points scaled, and the homography that takes them to what was seen, positive
// for points in front.
struct Plane {
    Eigen::Vector2d centre_mm;
    double scale;  // of the points
    std::vector<Eigen::Vector2d> points, seen;
    Eigen::Matrix3d homography;
    double misfit;  // mean square of the algebraic distances, relative to the view's extent
};

Plane plane_of(const std::vector<Eigen::Vector3d>& points_mm,
               const std::vector<Eigen::Vector2d>& seen) {
    const Normaliser of_points(points_mm), of_seen(seen);
    Plane plane{of_points.centre, of_points.scale, {}, seen, {}, 0.0};
    Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
    for (std::size_t i = 0; i < seen.size(); ++i) {
        plane.points.push_back(of_points(points_mm[i].head<2>()));
        const Eigen::RowVector3d p(plane.points[i].x(), plane.points[i].y(), 1.0);
        const Eigen::Vector2d q = of_seen(seen[i]);
        Eigen::Matrix<double, 2, 9> rows;
        rows << p, Eigen::RowVector3d::Zero(), -q.x() * p,  //
            Eigen::RowVector3d::Zero(), p, -q.y() * p;
        normal += rows.transpose() * rows;
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen{Eigen::MatrixXd(normal)};
    const Eigen::Matrix3d transposed =
        Eigen::Map<const Eigen::Matrix3d>(eigen.eigenvectors().col(0).data());
    plane.homography = of_seen.matrix().inverse() * transposed.transpose();
    if (plane.homography(2, 2) < 0.0)
        plane.homography = -plane.homography;
    plane.misfit = eigen.eigenvalues()[0] / static_cast<double>(seen.size());
    return plane;
}

// The camera from the scaled plane.
struct PlanePose {
    Eigen::Matrix3d rotation;
    Eigen::Vector3d translation;

    Eigen::Vector3d operator()(const Eigen::Vector2d& point) const {
        return rotation.leftCols<2>() * point + translation;
    }
};

// Both poses in which a plane's middle is seen at v with the derivatives J. Seen along its line of
// sight, what a rotation shows of the plane's axes is the derivative over its larger singular
// value, 1 / depth; what lies along the line of sight is known but for a sign.
std::array<PlanePose, 2> poses_of(const Eigen::Vector2d& v, const Eigen::Matrix2d& derivatives) {
    const Eigen::Matrix3d to_sight =
        rotation_between(Eigen::Vector3d::UnitZ(), v.homogeneous()).toRotationMatrix();
    Eigen::Matrix<double, 2, 3> projected;
    projected << 1, 0, -v.x(), 0, 1, -v.y();
    const Eigen::Matrix2d across = (projected * to_sight).leftCols<2>();
    const Eigen::Matrix2d scaled = across.inverse() * derivatives;
    const Eigen::Matrix2d gram = scaled.transpose() * scaled;
    const double mean = 0.5 * gram.trace();
    const double largest =
        std::sqrt(mean + std::sqrt(std::max(mean * mean - gram.determinant(), 0.0)));
    const Eigen::Matrix2d shown = scaled / largest;
    const Eigen::Matrix2d hidden = Eigen::Matrix2d::Identity() - shown.transpose() * shown;
    Eigen::RowVector2d along(std::sqrt(std::max(hidden(0, 0), 0.0)),
                             std::sqrt(std::max(hidden(1, 1), 0.0)));
    if (hidden(0, 1) < 0.0)
        along.y() = -along.y();
    std::array<PlanePose, 2> poses;
    for (int k = 0; k < 2; ++k) {
        Eigen::Matrix3d rotation;
        rotation.topLeftCorner<2, 2>() = shown;
        rotation.bottomLeftCorner<1, 2>() = k == 0 ? along : Eigen::RowVector2d(-along);
        rotation.col(2) = rotation.col(0).cross(rotation.col(1));
        poses[k] = {to_sight * rotation, v.homogeneous() / largest};
    }
    return poses;
}

struct PlaneFit {
    PlanePose pose;
    double error = std::numeric_limits<double>::infinity();  // squared px; infinite when behind
};

double projection_error(const Plane& plane, const PlanePose& pose, const Eigen::Vector2d& focal,
                        const Eigen::Vector2d& principal) {
    double squares = 0.0;
    for (std::size_t i = 0; i < plane.points.size(); ++i) {
        const Eigen::Vector3d p = pose(plane.points[i]);
        if (!(p.z() > 0.0))
            return std::numeric_limits<double>::infinity();
        const Eigen::Vector2d pixel = focal.cwiseProduct(p.head<2>()) / p.z() + principal;
        squares += (pixel - plane.seen[i]).squaredNorm();
    }
    return squares;
}

PlaneFit fit_plane(const Plane& plane, const Eigen::Vector2d& focal,
                   const Eigen::Vector2d& principal) {
    const Eigen::Matrix3d& h = plane.homography;
    const Eigen::Vector2d pixel = h.col(2).hnormalized();
    const Eigen::Matrix2d of_pixel =
        (h.topLeftCorner<2, 2>() - pixel * h.bottomLeftCorner<1, 2>()) / h(2, 2);
    const Eigen::Vector2d v = (pixel - principal).cwiseQuotient(focal);
    PlaneFit best;
    for (const PlanePose& pose : poses_of(v, focal.cwiseInverse().asDiagonal() * of_pixel)) {
        const double error = projection_error(plane, pose, focal, principal);
        if (error < best.error)
            best = {pose, error};
    }
    return best;
}

// The best of a grid with steps of a quarter. Pixels are taken to be square unless others halve the
// error: what is left of the distortion would choose any.
Eigen::Vector2d searched_focal(const std::vector<Plane>& planes, double diagonal_px,
                               const Eigen::Vector2d& principal) {
    double best = std::numeric_limits<double>::infinity();
    Eigen::Vector2d focal = Eigen::Vector2d::Zero();
    const auto search = [&](double root_of_ratio, double least_gain) {
        for (double f = 0.01 * diagonal_px; f < 1e4 * diagonal_px; f *= 1.25) {
            const Eigen::Vector2d candidate(f * root_of_ratio, f / root_of_ratio);
            double error = 0.0;
            for (const Plane& plane : planes)
                error += fit_plane(plane, candidate, principal).error;
            if (error * least_gain < best) {
                best = error * least_gain;
                focal = candidate;
            }
        }
    };
    search(1.0, 1.0);
    for (const double root_of_ratio : {0.7071, 0.8409, 1.1892, 1.4142})
        search(root_of_ratio, 2.0);
    if (!std::isfinite(best))
        throw NumericalError("no focal length puts all points in front of the camera");
    return focal;
}

// Of pixels q about the principal point over 1 + lambda |q|^2.
std::vector<Plane> planes_of(std::span<const CalibrationView> views,
                             const Eigen::Vector2d& principal, double lambda) {
    std::vector<Plane> planes;
    for (const CalibrationView& view : views) {
        std::vector<Eigen::Vector2d> undistorted;
        for (const Eigen::Vector2d& pixel : view.pixels) {
            const Eigen::Vector2d arm = pixel - principal;
            undistorted.push_back(principal + arm / (1.0 + lambda * arm.squaredNorm()));
        }
        planes.push_back(plane_of(view.points_mm, undistorted));
    }
    return planes;
}

// The views as planes after the division that makes them most nearly planes.
std::vector<Plane> undistorted_planes(std::span<const CalibrationView> views,
                                      const Eigen::Vector2d& principal) {
    double largest = 0.0;
    for (const CalibrationView& view : views)
        for (const Eigen::Vector2d& pixel : view.pixels)
            largest = std::max(largest, (pixel - principal).squaredNorm());
    double best = std::numeric_limits<double>::infinity(), best_share = 0.0;
    std::vector<Plane> best_planes;
    const auto consider = [&](double share) {
        std::vector<Plane> planes = planes_of(views, principal, share / largest);
        double misfit = 0.0;
        for (const Plane& plane : planes)
            misfit += plane.misfit;
        if (misfit < best) {
            best = misfit;
            best_share = share;
            best_planes = std::move(planes);
        }
    };
    for (int i = -7; i <= 7; ++i)
        consider(0.1 * i);
    for (double step = 0.05; step > 0.002; step *= 0.5) {
        const double middle = best_share;
        consider(middle - step);
        consider(middle + step);
    }
    if (!std::isfinite(best))
        throw NumericalError("the pixels of a view do not make a plane");
    return best_planes;
}

Rigid rigid_of(const Plane& plane, const PlanePose& pose) {
    const Eigen::Quaterniond rotation = Eigen::Quaterniond(pose.rotation).normalized();
    const Eigen::Vector3d centre(plane.centre_mm.x(), plane.centre_mm.y(), 0.0);
    return {rotation, pose.translation / plane.scale - rotation * centre};
}

// Parameters of a projection to begin with: what lenses of 100 to 200 degrees have.
std::vector<LensProjection> first_guesses(Projection kind) {
    switch (kind) {
        case Projection::field_of_view:
            return {{kind, 0.5}, {kind, 0.9}, {kind, 1.2}};
        case Projection::unified:
            return {{kind, 0.5}, {kind, 1.0}, {kind, 2.0}};
        case Projection::extended_unified:
            return {{kind, 1.0, 0.3}, {kind, 1.0, 0.6}};
        case Projection::double_sphere:
            return {{kind, -0.2, 0.55}, {kind, 0.0, 0.55}, {kind, 0.3, 0.65}};
        default:
            return {{kind}};
    }
}

// Poses of all views for a camera without distortion, and the sum of the squared distances that
// they leave, px; nothing when it does not see all of them.
struct PosedViews {
    std::vector<Rigid> camera_from_target;
    double squares = 0.0;
};
std::optional<PosedViews> posed_views(std::span<const CalibrationView> views,
                                      const std::vector<BundleView>& bundle_views,
                                      const CameraModel& camera) {
    PosedViews posed;
    for (std::size_t v = 0; v < views.size(); ++v) {
        std::vector<Eigen::Vector2d> plane;
        for (const Eigen::Vector2d& pixel : views[v].pixels)
            plane.push_back(camera.intrinsics.on_plane(pixel));
        const auto pose = pose_from_plane(views[v].points_mm, plane, camera.projection);
        if (!pose)
            return std::nullopt;
        const std::vector<BundleView> one{bundle_views[v]};
        const Bundle bundle = bundle_of(camera, {&*pose, 1}, one);
        const auto cost = bundle_cost(one, bundle, {});
        if (!cost)
            return std::nullopt;
        posed.camera_from_target.push_back(poses_of(bundle, one).front());
        posed.squares += *cost;
    }
    return posed;
}

constexpr double max_noise_over_scatter = 1.5, either_angle_deg = 40.0, wide_angle_deg = 50.0;

// Infinite where there is no fit.
struct Misfit {
    double rms_px = std::numeric_limits<double>::infinity();
    double scatter_px = 0.0;  // of neighbouring residuals
    double angle_deg = 0.0;   // of the outermost point to the axis
};

double outermost_angle_deg(std::span<const CalibrationView> views, const CameraFit& fit) {
    double least_cosine = 1.0;
    for (std::size_t v = 0; v < views.size(); ++v)
        for (const Eigen::Vector3d& point : views[v].points_mm)
            least_cosine =
                std::min(least_cosine, (fit.camera_from_target[v] * point).normalized().z());
    return std::acos(std::clamp(least_cosine, -1.0, 1.0)) * 180.0 / std::numbers::pi;
}

Misfit misfit_of(const std::string& model, std::span<const CalibrationView> views, cv::Size size) {
    const auto fit = attempted([&] { return fit_camera(views, size, calibration_model(model)); });
    if (!fit)
        return {};
    return {fit.value->rms_px(), corner_scatter_px(views, fit.value->residuals_px),
            outermost_angle_deg(views, *fit.value)};
}

constexpr double nearly_flat_rad = 0.035;  // 2 degrees

// A view's affine map, about the middle of its points.
struct AffineView {
    Eigen::Vector3d centre_mm;
    Eigen::Vector2d middle;  // where the centre is seen
    Eigen::Matrix2d map;     // d seen / d (x, y)
    double reach_mm;         // of the farthest point
};

AffineView affine_view(const std::vector<Eigen::Vector3d>& points_mm,
                       const std::vector<Eigen::Vector2d>& seen) {
    const double count = static_cast<double>(seen.size());
    AffineView view{Eigen::Vector3d::Zero(), Eigen::Vector2d::Zero(), {}, 0.0};
    for (std::size_t i = 0; i < seen.size(); ++i) {
        view.centre_mm += points_mm[i] / count;
        view.middle += seen[i] / count;
    }
    Eigen::Matrix2d seen_by_point = Eigen::Matrix2d::Zero(), scatter = Eigen::Matrix2d::Zero();
    for (std::size_t i = 0; i < seen.size(); ++i) {
        const Eigen::Vector2d arm = (points_mm[i] - view.centre_mm).head<2>();
        seen_by_point += (seen[i] - view.middle) * arm.transpose();
        scatter += arm * arm.transpose();
        view.reach_mm = std::max(view.reach_mm, arm.norm());
    }
    view.map = seen_by_point * scatter.inverse();
    return view;
}

double larger_singular_value(const Eigen::Matrix2d& map) {
    return Eigen::JacobiSVD<Eigen::Matrix2d>(map).singularValues()[0];
}

// What the views make of the magnification along x where that along y is `ratio` times it.
struct Magnification {
    double mean = 0.0, scatter = std::numeric_limits<double>::infinity();  // relative, squared
};

Magnification magnification(const std::vector<AffineView>& views, double ratio) {
    const double count = static_cast<double>(views.size());
    double mean = 0.0, squares = 0.0;
    for (const AffineView& view : views) {
        const double value =
            larger_singular_value(Eigen::Vector2d(1.0, 1.0 / ratio).asDiagonal() * view.map);
        mean += value / count;
        squares += value * value / count;
    }
    return {mean, squares / (mean * mean) - 1.0};
}

// Square pixels, unless others halve the scatter: what is left of the distortion would choose any.
double searched_ratio(const std::vector<AffineView>& views) {
    double ratio = 1.0, least = 0.5 * magnification(views, 1.0).scatter;
    const auto consider = [&](double candidate) {
        const double scatter = magnification(views, candidate).scatter;
        if (scatter < least) {
            least = scatter;
            ratio = candidate;
        }
    };
    for (int i = -70; i <= 70; ++i)
        consider(std::exp2(i / 70.0));
    for (double step = 0.005; step > 1e-5; step *= 0.5) {
        const double middle = ratio;
        consider(middle * (1.0 - step));
        consider(middle * (1.0 + step));
    }
    return ratio;
}

// Of a plane seen by the view's map in mm. Below `flat_rad` no tilt at all.
Rigid pose_of(const AffineView& view, double flat_rad) {
    const Eigen::JacobiSVD<Eigen::Matrix2d> svd(view.map,
                                                Eigen::ComputeFullU | Eigen::ComputeFullV);
    const double larger = svd.singularValues()[0];
    double cosine = larger > 0.0 ? svd.singularValues()[1] / larger : 0.0;
    if (cosine >= std::cos(flat_rad))
        cosine = 1.0;
    const double sine = std::sqrt((1.0 - cosine) * (1.0 + cosine));
    const auto turned = [](const Eigen::Matrix2d& in_plane) {
        Eigen::Matrix3d turn = Eigen::Matrix3d::Zero();
        turn.topLeftCorner<2, 2>() = in_plane;
        turn(2, 2) = in_plane.determinant() > 0.0 ? 1.0 : -1.0;
        return turn;
    };
    Eigen::Matrix3d tilt;
    tilt << 1, 0, 0, 0, cosine, -sine, 0, sine, cosine;
    const Eigen::Quaterniond rotation(
        Eigen::Matrix3d(turned(svd.matrixU()) * tilt * turned(svd.matrixV()).transpose()));
    const Eigen::Vector3d place(view.middle.x(), view.middle.y(), 2.0 * view.reach_mm);
    const Rigid pose{rotation.normalized(), place - rotation.normalized() * view.centre_mm};
    return cosine < 1.0 ? pose : flat_on(pose, view.centre_mm);
}

}  // namespace

double plane_misfit(const CalibrationView& view) {
    return std::sqrt(std::max(plane_of(view.points_mm, view.pixels).misfit, 0.0));
}

std::optional<Rigid> pose_from_homography(const std::vector<Eigen::Vector3d>& points_mm,
                                          const std::vector<Eigen::Vector2d>& normalised) {
    const Plane plane = plane_of(points_mm, normalised);
    const PlaneFit fit = fit_plane(plane, Eigen::Vector2d::Ones(), Eigen::Vector2d::Zero());
    if (!std::isfinite(fit.error))
        return std::nullopt;
    return rigid_of(plane, fit.pose);
}

std::optional<Rigid> pose_from_plane(const std::vector<Eigen::Vector3d>& points_mm,
                                     const std::vector<Eigen::Vector2d>& undistorted,
                                     const LensProjection& projection) {
    std::vector<Eigen::Vector3d> rays;
    for (const Eigen::Vector2d& point : undistorted) {
        const auto ray = from_plane(projection, point);
        if (!ray)
            return std::nullopt;
        rays.push_back(*ray);
    }
    const Eigen::Quaterniond turn = rotation_to_mean_direction(rays);
    const VisibleProjection seen = seen_across(turn, rays);
    if (seen.kept.size() < min_view_points)
        return std::nullopt;
    std::vector<Eigen::Vector3d> points;
    for (const std::size_t i : seen.kept)
        points.push_back(points_mm[i]);
    const auto pose = pose_from_homography(points, seen.points);
    if (!pose || !pose->translation.allFinite())
        return std::nullopt;
    return Rigid{turn.conjugate() * pose->rotation, turn.conjugate() * pose->translation};
}

Rigid mirrored_pose(const Rigid& camera_from_target, const Eigen::Vector3d& centre_mm) {
    const Eigen::Vector3d centre = camera_from_target * centre_mm;
    const Eigen::Vector3d sight = centre.normalized();
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - 2.0 * sight * sight.transpose();
    const Eigen::Matrix3d rotation = across * camera_from_target.rotation.toRotationMatrix() *
                                     Eigen::Vector3d(1, 1, -1).asDiagonal();
    const Eigen::Quaterniond turned = Eigen::Quaterniond(rotation).normalized();
    return {turned, centre - turned * centre_mm};
}

CameraStart calibration_start(std::span<const CalibrationView> views, cv::Size image_size) {
    const Eigen::Vector2d principal = middle_of(image_size);
    const std::vector<Plane> planes = undistorted_planes(views, principal);
    const Eigen::Vector2d focal =
        searched_focal(planes, std::hypot(image_size.width, image_size.height), principal);
    CameraStart start{centred_camera(image_size, {}, focal), {}};
    std::vector<BundleView> undistorted;
    for (std::size_t i = 0; i < views.size(); ++i) {
        CalibrationView view = views[i];
        view.pixels = planes[i].seen;
        undistorted.push_back(bundle_view(view));
        start.camera_from_target.push_back(
            rigid_of(planes[i], fit_plane(planes[i], focal, principal).pose));
    }
    constexpr int few = 20;
    Bundle bundle = bundle_of(start.camera, start.camera_from_target, undistorted);
    if (const auto solution =
            adjust_bundle(undistorted, bundle, {.free = {0, 1}, .most_iterations = few}))
        bundle = solution->bundle;
    set_all_parameters(start.camera, bundle.camera);
    start.camera_from_target = poses_of(bundle, undistorted);
    return start;
}

std::vector<CameraStart> wide_calibration_starts(std::span<const CalibrationView> views,
                                                 cv::Size image_size, Projection projection) {
    const double diagonal = std::hypot(image_size.width, image_size.height);
    const std::vector<BundleView> all = bundle_views(views);
    std::vector<CameraStart> starts;
    for (const LensProjection& guess : first_guesses(projection)) {
        std::optional<PosedViews> best;
        CameraStart start;
        for (double f = 0.05 * diagonal; f < 5.0 * diagonal; f *= 1.1) {
            const CameraModel camera = centred_camera(image_size, guess, {f, f});
            auto posed = posed_views(views, all, camera);
            if (!posed || (best && posed->squares >= best->squares))
                continue;
            best = std::move(posed);
            start = {camera, best->camera_from_target};
        }
        if (best)
            starts.push_back(std::move(start));
    }
    if (starts.empty())
        throw NumericalError(
            fmt::format("no {} lens sees all points as a plane", name_of(projection).name));
    return starts;
}

LensAngle lens_angle(std::span<const CalibrationView> views, cv::Size image_size) {
    Misfit perspective;
    for (const char* model : {"standard", "rational"}) {
        const Misfit misfit = misfit_of(model, views, image_size);
        if (misfit.rms_px < perspective.rms_px)
            perspective = misfit;
        if (misfit.rms_px <= max_noise_over_scatter * misfit.scatter_px)
            return perspective.angle_deg < either_angle_deg ? LensAngle::ordinary
                                                            : LensAngle::either;
    }
    for (const CalibrationModel& model : wide_calibration_models()) {
        const Misfit misfit = misfit_of(model.name, views, image_size);
        if (misfit.rms_px < 0.5 * perspective.rms_px && misfit.angle_deg > wide_angle_deg)
            return LensAngle::wide;
    }
    return perspective.angle_deg < either_angle_deg ? LensAngle::ordinary : LensAngle::either;
}

CameraStart telecentric_calibration_start(std::span<const CalibrationView> views,
                                          cv::Size image_size) {
    std::vector<AffineView> affine;
    for (const CalibrationView& view : views)
        affine.push_back(affine_view(view.points_mm, view.pixels));
    const double ratio = searched_ratio(affine);
    const double fx = magnification(affine, ratio).mean, fy = ratio * fx;
    if (!std::isfinite(fx) || !(fx > 0.0))
        throw NumericalError("the pixels of a view do not make a plane");
    CameraStart start{centred_camera(image_size, {Projection::telecentric}, {fx, fy}), {}};
    const Eigen::Vector2d principal = middle_of(image_size), to_mm(1.0 / fx, 1.0 / fy);
    for (AffineView& view : affine) {
        view.map = to_mm.asDiagonal() * view.map;
        view.middle = to_mm.cwiseProduct(view.middle - principal);
        start.camera_from_target.push_back(pose_of(view, nearly_flat_rad));
    }
    return start;
}

Rigid pose_from_affine(const std::vector<Eigen::Vector3d>& points_mm,
                       const std::vector<Eigen::Vector2d>& undistorted_mm) {
    return pose_of(affine_view(points_mm, undistorted_mm), 0.0);
}

Rigid flat_on(const Rigid& camera_from_target, const Eigen::Vector3d& centre_mm) {
    Eigen::Quaterniond rotation = camera_from_target.rotation;
    const bool from_behind = (rotation * Eigen::Vector3d::UnitZ()).z() < 0.0;
    if (from_behind)
        rotation.z() = rotation.w() = 0.0;
    else
        rotation.x() = rotation.y() = 0.0;
    rotation.normalize();
    return {rotation, camera_from_target * centre_mm - rotation * centre_mm};
}

bool is_flat_on(const Eigen::Quaterniond& rotation) {
    return (rotation.x() == 0.0 && rotation.y() == 0.0) ||
           (rotation.z() == 0.0 && rotation.w() == 0.0);
}

double tilt_rad(const Eigen::Quaterniond& rotation) {
    const Eigen::Vector3d normal = rotation * Eigen::Vector3d::UnitZ();
    return std::atan2(normal.head<2>().norm(), std::abs(normal.z()));
}

}  // namespace etalon
