// Calibrations that are hard for arithmetic: correlations of 0.9999, condition numbers of 1e6,
// focal lengths from 5 to 500 000 px, lengths from micrometres to kilometres. The fit in double,
// from the views alone, against normal equations in long double, from the truth.
#include <fmt/format.h>

#include <numeric>

#include "bench/stability/stability_case.h"
#include "calib/camera/projector.h"
#include "calib/intrinsics/camera_fit.h"
#include "core/program/errors.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

constexpr double bound_of_u = 1e-6;

// Boards of 9x6 points, all inside the image, at the depth where they fill `share` of its width.
struct BoardViews {
    int count = 12;
    double share = 0.6;
    double tilt = 0.6;  // rad
    double noise_px = 0.1;
    double depth_mm = 500.0;
    double origin_mm = 0.0;  // of the target's frame, from the board along its x
};

struct Problem {
    CameraModel camera;
    std::string model;
    BoardViews boards;
    double least_condition = 0.0;    // that makes the case what its name says
    double least_correlation = 0.0;  // of two of k1..k6
};

CameraModel camera_of(int width, int height, double focal_px, const Distortion& distortion) {
    return camera_without_lens(
        width, height, {focal_px, 0.97 * focal_px, 0.52 * width, 0.47 * height}, distortion);
}

// A barrel of a tenth at the image's corner, whatever the focal length.
Distortion barrel(int width, int height, double focal_px) {
    const double s = 0.25 * (width * width + height * height) / (focal_px * focal_px);
    return {.k1 = -0.12 / s,
            .k2 = 0.03 / (s * s),
            .p1 = 0.002 / std::sqrt(s),
            .p2 = -0.001 / std::sqrt(s),
            .k3 = -0.01 / (s * s * s)};
}

// Tilted every way, the board's middle at nine places of the image in turn.
Rigid board_pose(const CameraModel& camera, const BoardViews& boards, int view, double square_mm) {
    const Intrinsics& i = camera.intrinsics;
    const double turn = 2.4 * view;  // the golden angle: no two views alike
    const Eigen::Vector3d tilt(boards.tilt * std::cos(turn), boards.tilt * std::sin(turn),
                               0.3 * std::sin(5 * turn));
    const Eigen::Quaterniond rotation = rotation_from_vector(tilt);
    const double room = 0.5 * (0.9 - boards.share);
    const double depth = boards.depth_mm * (1.0 + 0.1 * std::sin(3 * turn));
    const Eigen::Vector2d place(room * camera.width * (view % 3 - 1) / i.fx,
                                room * camera.height * (view / 3 % 3 - 1) / i.fy);
    const Eigen::Vector3d middle(4.0 * square_mm + boards.origin_mm, 2.5 * square_mm, 0.0);
    const Eigen::Vector3d there(depth * place.x(), depth * place.y(), depth);
    return {rotation, there - rotation * middle};
}

struct Views {
    std::vector<CalibrationView> views;
    std::vector<Rigid> camera_from_target;
};

Views views_of(const Problem& problem) {
    const BoardViews& boards = problem.boards;
    const Projector projector(problem.camera);
    const double square_mm =
        boards.share * problem.camera.width / problem.camera.intrinsics.fx * boards.depth_mm / 8.0;
    Views all;
    for (int v = 0; v < boards.count; ++v) {
        const Rigid pose = board_pose(problem.camera, boards, v, square_mm);
        RandomStream random(7, 5, v);
        CalibrationView view;
        for (int row = 0; row < 6; ++row)
            for (int column = 0; column < 9; ++column) {
                const Eigen::Vector3d point(boards.origin_mm + square_mm * column, square_mm * row,
                                            0.0);
                const auto pixel = projector.project(pose * point);
                if (!pixel)
                    throw NumericalError("a point of the case is not seen");
                const Eigen::Vector2d noise{random.normal(), random.normal()};
                view.points_mm.push_back(point);
                view.pixels.push_back(*pixel + boards.noise_px * noise);
            }
        all.views.push_back(view);
        all.camera_from_target.push_back(pose);
    }
    return all;
}

// The reference: Gauss-Newton from the truth by normal equations, which the fit never forms, in
// long double. Their condition is 1e12 at most here, of long double's 1e19.

using Real = long double;
using RealVector = Eigen::Matrix<Real, 3, 1>;
using RealColumn = Eigen::Matrix<Real, Eigen::Dynamic, 1>;
using RealModel = PixelModel<Real>;

struct NormalEquations {
    Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic> matrix;
    RealColumn right;

    // A row of the Jacobian: its values, where they stand, and the residual.
    void add(const std::vector<Eigen::Index>& columns, const RealColumn& row, Real residual) {
        right(columns) += residual * row;
        matrix(columns, columns) += row * row.transpose();
    }
};

// Of a view: its target's points from their centre, and where that is.
struct RealView {
    std::vector<RealVector> points;
    Eigen::Quaternion<Real> rotation;
    RealVector translation;

    RealView(const CalibrationView& view, const Rigid& camera_from_target) {
        const auto one_of = static_cast<double>(view.points_mm.size());
        Eigen::Vector3d centre = Eigen::Vector3d::Zero();
        for (const Eigen::Vector3d& point : view.points_mm)
            centre += point / one_of;
        for (const Eigen::Vector3d& point : view.points_mm)
            points.push_back((point - centre).cast<Real>());
        rotation = camera_from_target.rotation.cast<Real>().normalized();
        translation = rotation * centre.cast<Real>() + camera_from_target.translation.cast<Real>();
    }

    // By a small turn about the camera's axes and a shift.
    void move(const RealVector& turn, const RealVector& shift) {
        const Real angle = turn.norm();
        const RealVector axis = angle > 0 ? RealVector(turn / angle) : RealVector::UnitX();
        rotation = Eigen::Quaternion<Real>(Eigen::AngleAxis<Real>(angle, axis)) * rotation;
        rotation.normalize();
        translation += shift;
    }
};

// The view's rows: its pixels', and of each parameter that is pulled towards zero.
void add_view(const RealView& at, const CalibrationView& view, Eigen::Index first_of_pose,
              const RealModel& model, const std::vector<int>& free, const CameraParameters& pull,
              NormalEquations& equations) {
    const auto lens = std::ssize(free);
    std::vector<Eigen::Index> columns(free.size() + 6);
    std::iota(columns.begin(), columns.begin() + lens, 0);
    std::iota(columns.begin() + lens, columns.end(), first_of_pose);
    RealModel::OfParameters of_parameters;
    for (std::size_t p = 0; p < at.points.size(); ++p) {
        const RealVector turned = at.rotation * at.points[p];
        const auto seen = model.with_derivatives(turned + at.translation, of_parameters);
        const Real weight = 1 / static_cast<Real>(view.sigma(p));
        for (int axis = 0; axis < 2; ++axis) {
            const RealVector of_point = seen.of.row(axis).transpose();
            const RealVector of_turn = turned.cross(of_point);
            RealColumn row(lens + 6);
            row << of_parameters(axis, free).transpose(), of_turn, of_point;
            equations.add(columns, weight * row,
                          weight * (view.pixels[p][axis] - seen.pixel[axis]));
        }
    }
    for (Eigen::Index i = 0; i < lens; ++i)
        if (const Real weight = pull[free[i]]; weight > 0)
            equations.add({i}, RealColumn::Constant(1, weight),
                          -weight * model.parameters()[free[i]]);
}

// Steps until one is below 1e-9 standard deviations of a pixel's noise, by the linear model.
Eigen::VectorXd long_double_solution(const Problem& problem, const Views& views,
                                     const CalibrationModel& model, const CameraParameters& pull) {
    constexpr int most_steps = 200;
    const Real least = 1e-18L * problem.boards.noise_px * problem.boards.noise_px;
    std::vector<int> free;
    for (const std::string& name : model.parameters)
        free.push_back(parameter_index(name));
    const auto lens = std::ssize(free);
    RealModel::Parameters parameters = all_parameters(problem.camera).cast<Real>();
    std::vector<RealView> at;
    for (std::size_t v = 0; v < views.views.size(); ++v)
        at.emplace_back(views.views[v], views.camera_from_target[v]);
    for (int step = 0; step < most_steps; ++step) {
        NormalEquations equations;
        equations.matrix.setZero(lens + 6 * std::ssize(at), lens + 6 * std::ssize(at));
        equations.right.setZero(lens + 6 * std::ssize(at));
        const RealModel model_now(problem.camera.projection, parameters);
        for (std::size_t v = 0; v < at.size(); ++v)
            add_view(at[v], views.views[v], lens + 6 * static_cast<Eigen::Index>(v), model_now,
                     free, pull, equations);
        const RealColumn x = equations.matrix.ldlt().solve(equations.right);
        parameters(free) += x.head(lens);
        for (std::size_t v = 0; v < at.size(); ++v) {
            const auto of_pose = x.segment<6>(lens + 6 * static_cast<Eigen::Index>(v));
            at[v].move(of_pose.head<3>(), of_pose.tail<3>());
        }
        const Real motion = x.dot(equations.right);
        if (motion > least || !std::isfinite(motion))
            continue;
        CameraModel camera = problem.camera;
        set_all_parameters(camera, parameters.cast<double>());
        return parameters_of(camera, model);
    }
    throw NumericalError("the long-double solve did not converge");
}

double largest_correlation_of_radial(const Eigen::MatrixXd& covariance,
                                     const CalibrationModel& model) {
    double largest = 0.0;
    for (Eigen::Index i = 0; i < covariance.rows(); ++i)
        for (Eigen::Index j = 0; j < i; ++j)
            if (model.parameters[i].starts_with('k') && model.parameters[j].starts_with('k'))
                largest = std::max(largest, std::abs(covariance(i, j)) /
                                                std::sqrt(covariance(i, i) * covariance(j, j)));
    return largest;
}

StabilityOutcome agrees_with_long_double(const Problem& problem) {
    const CalibrationModel& model = calibration_model(problem.model);
    const Views views = views_of(problem);
    const CameraFit fit =
        fit_camera(views.views, {problem.camera.width, problem.camera.height}, model);
    const Eigen::MatrixXd covariance =
        fit.variance * inverse_information(view_equations(views.views, fit), model);
    const Eigen::VectorXd u = covariance.diagonal().cwiseSqrt();
    const Eigen::VectorXd difference =
        parameters_of(fit.camera, model) - long_double_solution(problem, views, model, fit.pull);
    const double correlation = largest_correlation_of_radial(covariance, model);
    const double figure = difference.cwiseQuotient(u).cwiseAbs().maxCoeff();
    const bool is_hard =
        fit.condition_number >= problem.least_condition && correlation >= problem.least_correlation;
    return {fit.converged && is_hard && figure <= bound_of_u, figure, bound_of_u,
            fmt::format("condition number {:.2g}, two of k1..k6 correlated to {:.6f}, u(fx) {:.2g} "
                        "px, {} iterations, converged: {}",
                        fit.condition_number, correlation, u[0], fit.iterations, fit.converged)};
}

// The same lens and boards in other lengths: the intrinsics do not know of them.
StabilityOutcome same_for_every_length(const Problem& problem) {
    const CalibrationModel& model = calibration_model(problem.model);
    const auto fitted = [&](double scale) {
        Problem scaled = problem;
        scaled.boards.depth_mm *= scale;
        return fit_camera(views_of(scaled).views, {problem.camera.width, problem.camera.height},
                          model);
    };
    const CameraFit fit = fitted(1.0);
    double worst = 0.0;
    const Views views = views_of(problem);
    const Eigen::VectorXd u =
        (fit.variance * inverse_information(view_equations(views.views, fit), model))
            .diagonal()
            .cwiseSqrt();
    for (const double scale : {1e-6, 1e-3, 1e3, 1e6}) {
        const Eigen::VectorXd difference =
            parameters_of(fitted(scale).camera, model) - parameters_of(fit.camera, model);
        worst = std::max(worst, difference.cwiseQuotient(u).cwiseAbs().maxCoeff());
    }
    return at_most(bound_of_u, worst, "boards of 0.4 um to 400 km beside one of 400 mm");
}

}  // namespace

std::vector<StabilityCase> calibration_cases() {
    std::vector<StabilityCase> cases;
    const auto add = [&](const std::string& name, const Problem& problem) {
        cases.push_back(without_render("calibrating: " + name, "long double, in u",
                                       [=] { return agrees_with_long_double(problem); }));
    };
    const CameraModel webcam = camera_of(640, 480, 540.0, barrel(640, 480, 540.0));
    add("f = 5 px", {camera_of(16, 12, 5.0, barrel(16, 12, 5.0)),
                     "standard",
                     {.share = 0.4, .tilt = 0.35, .noise_px = 0.003}});
    add("f = 540 px", {webcam, "standard", {}});
    add("f = 20 000 px", {camera_of(4000, 3000, 2e4, barrel(4000, 3000, 2e4)), "standard", {}});
    add("f = 500 000 px", {camera_of(4000, 3000, 5e5, barrel(4000, 3000, 5e5)),
                           "standard",
                           {.count = 24, .tilt = 1.0}});
    add("origin 1 km away", {webcam, "standard", {.origin_mm = 1e6}});
    const CameraModel wide =
        camera_of(1000, 800, 300.0,
                  {.k1 = 735.0 / 945, .k2 = 64.0 / 945, .k4 = 1050.0 / 945, .k5 = 225.0 / 945});
    add("k1..k6 to 0.9999",
        {wide, "rational", {.share = 0.5, .tilt = 0.5, .noise_px = 0.001}, 0.0, 0.9999});
    add("all 18 parameters", {camera_of(700, 500, 420.0, every_distortion()),
                              "tilted",
                              {.count = 16, .share = 0.5, .noise_px = 0.001},
                              0.0,
                              0.9999});
    const CameraModel narrow =
        camera_of(640, 480, 540.0,
                  {.k1 = 0.31, .k2 = -0.12, .k3 = 0.05, .k4 = 0.41, .k5 = -0.08, .k6 = 0.03});
    add("condition 1e6", {narrow, "rational", {.noise_px = 1e-4}, 1e6});
    cases.push_back(without_render("calibrating: um to km", "same camera, in u", [=] {
        return same_for_every_length({webcam, "standard", {}});
    }));
    return cases;
}

}  // namespace etalon
