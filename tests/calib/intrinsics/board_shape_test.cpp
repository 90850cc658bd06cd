// Whether boards that are not flat are told from true ones and from lenses that the model does not
// have, and that their shape and camera are the joint minimum and the truth.
#include "calib/intrinsics/board_shape.h"

#include <Eigen/QR>

#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

const CalibrationModel& standard() {
    return calibration_model("standard");
}

BoardFlatness flatness_of(const std::vector<CalibrationView>& views,
                          const CalibrationModel& model = standard()) {
    return check_board(views, fit_camera(views, image_size, model)).value();
}

BoardShape shape_of(const std::vector<CalibrationView>& views) {
    return fit_board_shape(views, fit_camera(views, image_size, standard()));
}

TEST(BoardFlatness, BowedTwistedAndMisprintedBoardsAreFound) {
    for (const auto& displacement : {bow, twist, scatter}) {
        const BoardFlatness found = flatness_of(test::views_of(displacement, 10, 0.1, 5));
        EXPECT_TRUE(found.is_distorted()) << found.chance;
        EXPECT_GT(found.share, 0.15);
    }
    EXPECT_FALSE(flatness_of(test::views_of(flat, 10, 0.1, 5)).is_distorted());
}

TEST(BoardFlatness, SaysHowFarThePointsAre) {
    const BoardFlatness found = flatness_of(test::views_of(bow, 13, 0.05, 5));
    Eigen::VectorXd truth(54);
    const auto view = synthetic_views(calibration_truth(), 1, 0.0, 1).front();
    for (int i = 0; i < 54; ++i)
        truth[i] = bow(view.points_mm[std::size_t(i)], i).z();
    truth.array() -= truth.mean();
    EXPECT_NEAR(found.rms_mm, std::sqrt(truth.squaredNorm() / 54.0), 4 * found.rms_deviation_mm);
    EXPECT_LT(found.rms_deviation_mm, 0.02);
}

// A lens with k1 = -0.27 and no distortion in the model: residuals of a pixel that stay in the
// image.
TEST(BoardFlatness, AWrongModelOfTheLensIsNoBentBoard) {
    const auto views = test::views_of(flat, 13, 0.1, 8);
    const CameraFit fit = fit_camera(views, image_size, calibration_model("pinhole"));
    EXPECT_GT(fit.variance, 0.05);  // noise alone: 0.01
    const BoardFlatness found = *check_board(views, fit);
    EXPECT_FALSE(found.is_distorted()) << found.chance << " " << found.share;
}

TEST(BoardFlatness, NeedsEightViews) {
    const auto views = test::views_of(bow, 7, 0.1, 5);
    EXPECT_FALSE(check_board(views, fit_camera(views, image_size, standard())));
}

TEST(BoardShape, IsTheTruthWithinItsDeviations) {
    for (const auto& displacement : {bow, twist}) {
        const BoardShape shape = shape_of(test::views_of(displacement, 13, 0.1, 5));
        EXPECT_TRUE(shape.converged);
        const Eigen::Vector3d truth =
            displacement == bow ? Eigen::Vector3d(8e-5, 0, -2e-5) : Eigen::Vector3d(0, 8e-5, 0);
        for (int i = 0; i < 3; ++i)
            EXPECT_NEAR(shape.curvature_per_mm[i], truth[i],
                        4 * shape.curvature_deviation_per_mm[i]);
        EXPECT_NEAR(shape.variance, 0.01, 4 * 0.01 * std::sqrt(2.0 / 1300.0));
    }
}

TEST(BoardShape, KeepsPlaceAttitudeAndSizeOfTheDrawing) {
    const BoardShape shape = shape_of(test::views_of(scatter, 8, 0.1, 5));
    Eigen::Vector3d moved = Eigen::Vector3d::Zero();
    double turned = 0.0, grown = 0.0;
    for (const ShapedPoint& point : shape.points) {
        const Eigen::Vector2d arm = point.drawn_mm.head<2>() - Eigen::Vector2d(100, 62.5);
        moved += point.displacement_mm / 54.0;
        turned +=
            (arm.x() * point.displacement_mm.y() - arm.y() * point.displacement_mm.x()) / 54.0;
        grown += arm.dot(point.displacement_mm.head<2>()) / 54.0;
    }
    EXPECT_LT(moved.norm(), 1e-3);
    EXPECT_LT(std::abs(turned) / 100.0, 1e-3);
    EXPECT_LT(std::abs(grown) / 100.0, 1e-3);
}

// The joint problem without any elimination: camera, poses and all coordinates of the board, with
// derivatives by differences, from a start of its own.
class JointProblem {
public:
    JointProblem(const std::vector<CalibrationView>& views, const BoardShape& shape)
        : views_(views), shape_(shape) {
        Eigen::MatrixXd powers(54, 6);
        for (int i = 0; i < 54; ++i) {
            const double x = views[0].points_mm[std::size_t(i)].x() / 100.0 - 1.0,
                         y = views[0].points_mm[std::size_t(i)].y() / 100.0 - 0.625;
            powers.row(i) << 1, x, y, x * x, x * y, y * y;
        }
        const Eigen::MatrixXd all = powers.householderQr().householderQ();
        bows_ = all.middleCols(3, 3);
    }

    // The unknowns: nine of the camera, six of each pose, 162 of the board.
    Eigen::VectorXd residuals(const Eigen::VectorXd& at, const CameraFit& about) const {
        CameraModel camera = about.camera;
        set_parameters(camera, standard(), parameters_of(about.camera, standard()) + at.head(9));
        const PixelModel<double> projector(camera.projection, all_parameters(camera));
        const Eigen::Index count = std::ssize(views_);
        Eigen::VectorXd all(108 * count + 162);
        const Eigen::VectorXd board = at.tail(162);
        for (Eigen::Index v = 0; v < count; ++v) {
            const Eigen::VectorXd step = at.segment(9 + 6 * v, 6);
            const Rigid& pose = about.camera_from_target[std::size_t(v)];
            for (Eigen::Index i = 0; i < 54; ++i) {
                const Eigen::Vector3d p =
                    views_[std::size_t(v)].points_mm[std::size_t(i)] + board.segment<3>(3 * i);
                const Eigen::Vector3d seen =
                    rotation_from_vector(step.head<3>()) * (pose.rotation * p) + pose.translation +
                    step.tail<3>();
                all.segment<2>(108 * v + 2 * i) =
                    (views_[std::size_t(v)].pixels[std::size_t(i)] - projector(seen).pixel) /
                    std::sqrt(shape_.variance);
            }
        }
        const double extent = std::hypot(200.0, 125.0);
        Eigen::VectorXd height(54);
        for (Eigen::Index i = 0; i < 54; ++i) {
            all.segment<2>(108 * count + 3 * i) =
                board.segment<2>(3 * i) / shape_.prior.in_plane_mm;
            height[i] = board[3 * i + 2];
        }
        const double tau = shape_.prior.out_of_plane_mm;
        const double wide = std::hypot(tau, 0.01 * extent * std::sqrt(54.0));
        const Eigen::VectorXd amount = bows_.transpose() * height;
        const Eigen::VectorXd rows = (height - bows_ * amount) / tau + bows_ * amount / wide;
        for (Eigen::Index i = 0; i < 54; ++i)
            all[108 * count + 3 * i + 2] = rows[i];
        return all;
    }

    Eigen::VectorXd minimum(const CameraFit& about) const {
        Eigen::VectorXd at = Eigen::VectorXd::Zero(9 + 6 * std::ssize(views_) + 162);
        for (int iteration = 0; iteration < 5; ++iteration) {
            const Eigen::VectorXd here = residuals(at, about);
            Eigen::MatrixXd jacobian(here.size(), at.size());
            for (Eigen::Index i = 0; i < at.size(); ++i) {
                const double by = i < 9 + 6 * std::ssize(views_) ? 1e-6 : 1e-4;
                Eigen::VectorXd up = at, down = at;
                up[i] += by;
                down[i] -= by;
                jacobian.col(i) = (residuals(up, about) - residuals(down, about)) / (2 * by);
            }
            at -= jacobian.colPivHouseholderQr().solve(here);
        }
        return at;
    }

private:
    const std::vector<CalibrationView>& views_;
    const BoardShape& shape_;
    Eigen::MatrixXd bows_;
};

TEST(BoardShape, IsTheMinimumOfCameraPosesAndBoardTogether) {
    const auto views =
        test::views_of([](const Eigen::Vector3d& p,
                          int id) -> Eigen::Vector3d { return bow(p, id) + scatter(p, id); },
                       5, 0.1, 6);
    const CameraFit flat = fit_camera(views, image_size, standard());
    const BoardShape shape = fit_board_shape(views, flat);
    std::vector<CalibrationView> shaped;
    for (const CalibrationView& view : views)
        shaped.push_back(shape.shaped(view));
    const CameraFit fit = fit_camera(shaped, image_size, standard());

    const Eigen::VectorXd joint = JointProblem(views, shape).minimum(flat);
    for (std::size_t i = 0; i < 54; ++i) {
        const Eigen::Vector3d expected =
            joint.segment<3>(9 + 6 * std::ssize(views) + 3 * static_cast<Eigen::Index>(i));
        for (int k = 0; k < 3; ++k)
            EXPECT_NEAR(shape.points[i].displacement_mm[k], expected[k],
                        5e-3 * shape.points[i].deviation_mm[k]);
    }
    const Eigen::VectorXd camera = parameters_of(flat.camera, standard()) + joint.head(9);
    const Eigen::VectorXd difference = parameters_of(fit.camera, standard()) - camera;
    for (Eigen::Index i = 0; i < 9; ++i)
        EXPECT_LT(std::abs(difference[i]), 5e-3 * std::sqrt(shape.camera_covariance(i, i)));
}

TEST(BoardShape, APointInTwoPlacesIsRefused) {
    auto views = test::views_of(flat, 8, 0.1, 5);
    const CameraFit fit = fit_camera(views, image_size, standard());
    views[3].points_mm[4].x() += 1.0;
    EXPECT_THAT(text_of_error<NumericalError>([&] { fit_board_shape(views, fit); }),
                HasSubstr("the point with id 4 is in two places"));
}

}  // namespace
}  // namespace etalon
