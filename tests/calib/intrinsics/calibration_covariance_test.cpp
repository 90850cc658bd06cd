#include "calib/intrinsics/calibration_covariance.h"

#include <Eigen/Dense>
#include <Eigen/Eigenvalues>

#include "calib/intrinsics/projection_uncertainty.h"
#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

const CalibrationModel three_parameters{"three", {"fx", "fy", "cx"}};

// A regression with clusters, without poses: rows X, errors e, solved in one piece.
struct Regression {
    std::vector<Eigen::MatrixXd> x;
    std::vector<Eigen::VectorXd> y;

    Eigen::Matrix3d inverse() const {
        Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
        for (const Eigen::MatrixXd& each : x)
            information += each.transpose() * each;
        return information.inverse();
    }
    std::vector<Eigen::VectorXd> residuals() const {
        Eigen::Vector3d score = Eigen::Vector3d::Zero();
        for (std::size_t g = 0; g < x.size(); ++g)
            score += x[g].transpose() * y[g];
        const Eigen::Vector3d solution = inverse() * score;
        std::vector<Eigen::VectorXd> all;
        for (std::size_t g = 0; g < x.size(); ++g)
            all.push_back(y[g] - x[g] * solution);
        return all;
    }
    // What view_equations() would give at the solution.
    std::vector<ViewEquations> equations() const {
        std::vector<ViewEquations> all;
        const auto r = residuals();
        for (std::size_t g = 0; g < x.size(); ++g) {
            const Eigen::HouseholderQR<Eigen::MatrixXd> qr(x[g]);
            ViewEquations view;
            view.triangle =
                Eigen::MatrixXd(qr.matrixQR().topRows(3).triangularView<Eigen::Upper>());
            view.rhs = (qr.householderQ().transpose() * r[g]).head(3);
            all.push_back(view);
        }
        return all;
    }
};

Regression regression(int seed, double noise) {
    RandomStream design(77, 1), errors(seed, 2);
    Regression made;
    for (const int rows : {7, 5, 11, 6, 4}) {
        Eigen::MatrixXd x(rows, 3);
        for (double& each : x.reshaped())
            each = design.normal();
        x.col(1) *= 1e3;  // units differ
        Eigen::VectorXd y(rows);
        for (double& each : y)
            each = noise * errors.normal();
        made.x.push_back(x);
        made.y.push_back(y);
    }
    return made;
}

// Bell and McCaffrey's formula on all rows, without any QR.
TEST(ClusterRobust, IsTheDenseFormulas) {
    const Regression data = regression(5, 0.7);
    const auto residuals = data.residuals();
    const Eigen::Matrix3d inverse = data.inverse();
    Eigen::Matrix3d middle = Eigen::Matrix3d::Zero();
    for (std::size_t g = 0; g < data.x.size(); ++g) {
        const Eigen::MatrixXd rest = Eigen::MatrixXd::Identity(data.x[g].rows(), data.x[g].rows()) -
                                     data.x[g] * inverse * data.x[g].transpose();
        const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(rest);
        const Eigen::Vector3d score =
            data.x[g].transpose() * (eigen.operatorInverseSqrt() * residuals[g]);
        middle += score * score.transpose();
    }
    const Eigen::Matrix3d dense = inverse * middle * inverse;
    const Eigen::MatrixXd ours =
        covariances_of(data.equations(), three_parameters, 0.49).cluster_robust;
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k)
            EXPECT_NEAR(ours(i, k) / std::sqrt(dense(i, i) * dense(k, k)),
                        dense(i, k) / std::sqrt(dense(i, i) * dense(k, k)), 1e-9);
}

// Of independent errors with variance s^2 the correction makes the mean s^2 (X^T X)^-1 exactly,
// however few clusters. Mean of 4000, each a sum of five squares with a relative deviation below
// sqrt(2): standard error below 0.0224; 3.5 of it.
TEST(ClusterRobust, IsUnbiasedForFiveClusters) {
    const int runs = 4000;
    const double noise = 0.7;
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (int run = 0; run < runs; ++run)
        mean += covariances_of(regression(1000 + run, noise).equations(), three_parameters, 0.49)
                    .cluster_robust.diagonal() /
                runs;
    const Eigen::Matrix3d truth = noise * noise * regression(0, noise).inverse();
    for (int i = 0; i < 3; ++i)
        EXPECT_NEAR(mean[i] / truth(i, i), 1.0, 3.5 * 0.0224) << i;
}

TEST(FormalCovariance, IsTheVarianceTimesTheInverseInformation) {
    const Regression data = regression(5, 0.7);
    const Eigen::Matrix3d expected = 0.49 * data.inverse();
    const Eigen::MatrixXd ours = covariances_of(data.equations(), three_parameters, 0.49).formal;
    for (int i = 0; i < 3; ++i)
        EXPECT_NEAR(ours(i, i) / expected(i, i), 1.0, 1e-9);
}

// Draws 1, 2, 4 of one parameter: mean 7/3, squares 42/9, over 2 degrees of freedom 7/3; times
// 8/7 for eight views.
TEST(Bootstrap, CovarianceIsTheScatterOfTheDraws) {
    Bootstrap bootstrap;
    for (const double draw : {1.0, 2.0, 4.0})
        bootstrap.parameters.push_back(Eigen::VectorXd::Constant(1, draw));
    EXPECT_NEAR(bootstrap.covariance(8)(0, 0), 8.0 / 7.0 * 7.0 / 3.0, 1e-12);
}

TEST(ParameterDeviation, ComparesWhatIsStatedWithTheFormalOne) {
    EXPECT_EQ((ParameterDeviation{"fx", 2.0, 2.5, 2.0, 3.0}.ratio()), 1.5);
    EXPECT_EQ((ParameterDeviation{"fx", 0.0, 0.0, std::nullopt, 0.0}.ratio()), 1.0);
}

// In the units in which the formal covariance is the identity.
Eigen::Matrix3d in_formal_units(const Eigen::MatrixXd& covariance, const Eigen::MatrixXd& formal) {
    const Eigen::LLT<Eigen::MatrixXd> root(formal);
    const Eigen::MatrixXd half = root.matrixL().solve(covariance);
    return root.matrixL().solve(half.transpose());
}

// The dense formula of Ledoit and Wolf (2004), their section 3.3, with the zero mean that scores
// have at the solution.
TEST(StatedCovariance, IsTheRobustOneDrawnTowardsTheFormalOne) {
    const double variance = 0.49;
    for (const int seed : {5, 6, 7}) {
        const Regression data = regression(seed, 1.4);
        const auto found = covariances_of(data.equations(), three_parameters, variance);
        const Eigen::Matrix3d s = in_formal_units(found.cluster_robust, found.formal),
                              ours = in_formal_units(found.stated, found.formal);
        const double mean = std::max(1.0, s.trace() / 3.0);
        EXPECT_NEAR(ours.trace(), 3.0 * mean, 1e-9 * mean);
        // What is not the identity is a share of the robust one's.
        const Eigen::Matrix3d of_ours = ours / mean - Eigen::Matrix3d::Identity(),
                              of_s = s / (s.trace() / 3.0) - Eigen::Matrix3d::Identity();
        const double share = of_ours.cwiseProduct(of_s).sum() / of_s.squaredNorm();
        EXPECT_GE(share, 0.0);
        EXPECT_LE(share, 1.0);
        EXPECT_LT((of_ours - share * of_s).norm(), 1e-9);
    }
}

// Fewer clusters than parameters: the robust covariance has no width in some directions.
TEST(StatedCovariance, HasNoDirectionNarrowerThanFewClustersAllow) {
    Regression data = regression(5, 0.7);
    data.x.resize(2);
    data.y.resize(2);
    const auto found = covariances_of(data.equations(), three_parameters, 0.49);
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> robust(
        Eigen::MatrixXd(in_formal_units(found.cluster_robust, found.formal)));
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> stated(
        Eigen::MatrixXd(in_formal_units(found.stated, found.formal)));
    EXPECT_LT(robust.eigenvalues()[0], 1e-9);
    EXPECT_GT(stated.eigenvalues()[0], 0.1);
}

// ---- projection uncertainty

const PixelUncertainty& nearest(const ProjectionUncertainty& map, double x, double y) {
    return *std::min_element(map.pixels.begin(), map.pixels.end(),
                             [&](const PixelUncertainty& a, const PixelUncertainty& b) {
                                 return (a.pixel - Eigen::Vector2d(x, y)).norm() <
                                        (b.pixel - Eigen::Vector2d(x, y)).norm();
                             });
}

// x = cx + fx u: an error of fx moves a ray by its distance from cx over fx, one of cx by itself.
TEST(ProjectionUncertainty, OfAPinholeIsItsAlgebra) {
    const CameraModel camera = camera_with(640, 480, {541, 533, 331, 243}, {});
    const CalibrationModel& model = calibration_model("pinhole");
    Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();
    covariance(0, 0) = 1.5 * 1.5;
    covariance(3, 3) = 0.4 * 0.4;
    const auto map = projection_uncertainty(camera, model, covariance, {});
    const PixelUncertainty& right = nearest(map, 639.5, 479.5);
    EXPECT_EQ(right.pixel, Eigen::Vector2d(639.5, 479.5));
    EXPECT_NEAR(right.held, 1.5 * (639.5 - 331) / 541, 1e-9);
    EXPECT_NEAR(nearest(map, 331, 0).held, 0.4, 1e-3);
    EXPECT_EQ(map.share_among_points(), 0.0);
}

// At 50 000 px the field of view is half a degree and a shift of the principal point is a turn of
// the camera to the square of that.
TEST(ProjectionUncertainty, ARotationTakesBackAShiftOfTheImage) {
    const CameraModel camera = camera_with(640, 480, {50000, 50000, 331, 243}, {});
    Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();
    covariance(2, 2) = 1.0;
    const auto map = projection_uncertainty(camera, calibration_model("pinhole"), covariance, {});
    EXPECT_NEAR(map.mean(&PixelUncertainty::held), 1.0, 1e-9);
    EXPECT_LT(map.worst(&PixelUncertainty::rotated), 1e-4);
}

TEST(ProjectionUncertainty, IsTheScatterOfRaysThroughDrawnCameras) {
    const CameraModel camera = calibration_truth();
    const CalibrationModel& model = calibration_model("standard");
    Eigen::VectorXd deviations(9);
    deviations << 0.8, 0.7, 0.5, 0.4, 0.004, 0.01, 3e-4, 2e-4, 0.01;
    const Eigen::MatrixXd covariance = deviations.cwiseAbs2().asDiagonal();
    const ImageRays rays = image_rays(camera);
    const std::size_t ray = rays.pixels.size() - 40;
    const int draws = 2000;
    Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
    RandomStream random(3, 1);
    for (int draw = 0; draw < draws; ++draw) {
        CameraModel drawn = camera;
        Eigen::VectorXd values = parameters_of(camera, model);
        for (int i = 0; i < 9; ++i)
            values[i] += deviations[i] * random.normal();
        set_parameters(drawn, model, values);
        const Intrinsics& k = drawn.intrinsics;
        const Eigen::Vector2d d = distort(drawn.distortion, rays.rays[ray].hnormalized()).point;
        const Eigen::Vector2d moved =
            Eigen::Vector2d(k.cx + k.fx * d.x(), k.cy + k.fy * d.y()) - rays.pixels[ray];
        scatter += moved * moved.transpose() / draws;
    }
    const double largest = std::sqrt(
        Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(Eigen::MatrixXd(scatter)).eigenvalues()[1]);
    const auto map = projection_uncertainty(camera, model, covariance, {});
    // Relative standard error of a standard deviation of 2000: 1 / sqrt(4000) = 0.016; 3.5 of it.
    EXPECT_NEAR(map.pixels[ray].held / largest, 1.0, 0.055);
}

// The hull of a triangle of legs 300 and 200 px is 30 000 of 307 200 px^2; a grid of 20 px counts
// it to about its border over the step: 20 of 600 px.
TEST(ProjectionUncertainty, CountsWhatLiesAmongThePoints) {
    const CameraModel camera = camera_with(640, 480, {541, 533, 331, 243}, {});
    const std::vector<Eigen::Vector2d> triangle{{100, 100}, {400, 100}, {100, 300}};
    const auto map = projection_uncertainty(camera, calibration_model("pinhole"),
                                            Eigen::Matrix4d::Identity(), triangle);
    EXPECT_NEAR(map.share_among_points(), 30000.0 / 307200.0, 0.02);
    EXPECT_TRUE(nearest(map, 200, 150).among_points);
    EXPECT_FALSE(nearest(map, 350, 260).among_points);
}

TEST(ProjectionDifference, OfACameraThatWasTurnedIsNone) {
    CameraModel camera = calibration_truth();
    camera.intrinsics = {20000, 20000, 331, 243};
    CameraModel shifted = camera;
    shifted.intrinsics.cx += 3.0;  // 3/20000 rad; the rest is 3 px times (320/20000)^2
    const ImageRays rays = image_rays(camera);
    const auto same =
        projection_difference(shifted, rays, Eigen::VectorXd::Ones(rays.pixels.size()));
    for (const Eigen::Vector2d& each : same.differences_px)
        EXPECT_LT(each.norm(), 2e-3);
    CameraModel larger = camera;
    larger.intrinsics.fx *= 1.01;
    larger.intrinsics.fy *= 1.01;
    const auto wider =
        projection_difference(larger, rays, Eigen::VectorXd::Ones(rays.pixels.size()));
    for (std::size_t i = 0; i < wider.pixels.size(); ++i)
        // A turn centres the enlargement on the grid, not on the principal point.
        EXPECT_NEAR(wider.differences_px[i].x(), 0.01 * (wider.pixels[i].x() - 319.5), 5e-3);
}

TEST(CrossValidation, NeedsSixViews) {
    const auto views = synthetic_views(calibration_truth(), 5, 0.2, 1);
    const CalibrationModel& model = calibration_model("radial");
    const CameraFit fit = fit_camera(views, image_size, model);
    EXPECT_THROW(cross_validate(views, fit), NumericalError);
}

}  // namespace
}  // namespace etalon
