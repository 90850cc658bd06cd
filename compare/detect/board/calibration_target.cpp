#include "compare/detect/board/calibration_target.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/camera/projector.h"
#include "calib/intrinsics/calibrate.h"
#include "compare/detect/board/chessboard_corners.h"
#include "compare/detect/detector_adaptors.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

FoundBoard find_chessboard_points(const Marker& board, const CodeImage& image) {
    const auto corners = find_chessboard_corners(image, board.columns, board.rows);
    FoundBoard found;
    for (std::size_t i = 0; corners && i < corners->pixels.size(); ++i)
        if (corners->refined[i])
            found.points.push_back({static_cast<int>(i), corners->pixels[i]});
    return found;
}

FoundBoard find_points(const Marker& board, const CodeImage& image) {
    if (board.kind == Marker::Kind::chessboard)
        return find_chessboard_points(board, image);
    BoardPhoto photo{{}, as_8_bit(image)};
    image.pixels.convertTo(photo.pixels, CV_32F, 1.0 / image.full_scale());
    if (board.kind == Marker::Kind::charuco)
        return find_charuco_corners(board, photo);
    if (board.kind == Marker::Kind::aprilgrid)
        return find_tag_grid_corners(board, photo);
    if (board.kind == Marker::Kind::squares)
        return find_square_corners(board, photo);
    return find_circle_centroids(board, photo);
}

// Whether the points leave the plane's two directions determined: not fewer than two rows of them.
bool spread_over_the_plane(const CalibrationView& view) {
    Eigen::Vector2d mean = Eigen::Vector2d::Zero();
    for (const Eigen::Vector3d& point : view.points_mm)
        mean += point.head<2>() / static_cast<double>(view.points_mm.size());
    Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
    for (const Eigen::Vector3d& point : view.points_mm)
        scatter += (point.head<2>() - mean) * (point.head<2>() - mean).transpose();
    const Eigen::Vector2d eigenvalues =
        Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(Eigen::MatrixXd(scatter)).eigenvalues();
    return eigenvalues[0] > 1e-6 * eigenvalues[1];
}

// The centroid of a projected disk, by Green's theorem along its outline: the trapezoidal rule,
// which converges exponentially on a closed smooth curve. Nothing when part of it has no image.
std::optional<Eigen::Vector2d> disk_centroid(const Projector& projector,
                                             const Rigid& camera_from_target,
                                             const Eigen::Vector3d& centre_mm, double radius_mm) {
    constexpr int steps = 64;
    const auto origin = projector.project(camera_from_target * centre_mm);
    if (!origin)
        return std::nullopt;
    double area = 0.0;
    Eigen::Vector2d moment = Eigen::Vector2d::Zero();
    for (int i = 0; i < steps; ++i) {
        const double angle = 2.0 * std::numbers::pi * i / steps;
        const Eigen::Vector3d outward(std::cos(angle), std::sin(angle), 0.0),
            forward(-std::sin(angle), std::cos(angle), 0.0);
        const auto seen =
            projector.project_with_jacobian(camera_from_target * (centre_mm + radius_mm * outward));
        if (!seen)
            return std::nullopt;
        const Eigen::Vector2d p = seen->pixel - *origin,
                              dp = seen->jacobian * (camera_from_target.rotation * forward);
        area += 0.5 * (p.x() * dp.y() - p.y() * dp.x());
        moment += 0.5 * Eigen::Vector2d(p.x() * p.x() * dp.y(), -p.y() * p.y() * dp.x());
    }
    if (!(std::abs(area) > 0.0))
        return std::nullopt;
    return Eigen::Vector2d(*origin + moment / area);
}

}  // namespace

CalibrationTarget parse_calibration_target(const std::string& spec, const std::string& place) {
    return calibration_target(parse_marker(spec, place), place);
}

CalibrationTarget calibration_target(const Marker& board, const std::string& place) {
    const auto require = [&](int least_columns, int least_rows, const char* what) {
        const auto [small, large] = std::minmax(board.columns, board.rows);
        if (small < std::min(least_columns, least_rows) ||
            large < std::max(least_columns, least_rows))
            throw ConfigError(
                {place, 0, board.spec},
                fmt::format("a board of {}x{} {} is too small to calibrate with: "
                            "{}x{} at least",
                            board.columns, board.rows, what, least_columns, least_rows));
    };
    switch (board.kind) {
        case Marker::Kind::chessboard:
            require(3, 3, "inner corners");
            return {board};
        case Marker::Kind::charuco:
            require(3, 3, "squares");
            return {board};
        case Marker::Kind::aprilgrid:
            require(2, 2, "tags");
            return {board};
        case Marker::Kind::squares:
            require(2, 2, "squares");
            return {board};
        case Marker::Kind::circles:
        case Marker::Kind::acircles:
        case Marker::Kind::hexcircles:
            require(3, 3, "circles");
            return {board};
        default:
            throw ConfigError({place, 0, board.spec},
                              "a camera is calibrated with a board, for instance "
                              "chessboard:9x6@25mm");
    }
}

ObservedTarget observe(const CalibrationTarget& target, const CodeImage& image) {
    if (image.pixels.empty())
        return {{}, "an empty image"};
    const FoundBoard found = find_points(target.board, image);
    if (found.points.empty())
        return {{}, found.reason};
    CalibrationView view;
    for (const BoardPoint& point : found.points) {
        view.points_mm.push_back(target.board.points_mm[static_cast<std::size_t>(point.id)]);
        view.pixels.push_back(point.pixel);
        view.ids.push_back(point.id);
    }
    constexpr std::size_t min_points = 6;  // of fewer none is known to be wrong
    const std::size_t enough = std::min(min_points, target.board.points_mm.size());
    if (view.pixels.size() < enough || !spread_over_the_plane(view))
        return {{},
                fmt::format("only {} of its points are seen: {} of them, not all in a line, are "
                            "needed",
                            view.pixels.size(), enough)};
    return {std::move(view), {}, found.shown_as};
}

bool has_circles(const CalibrationTarget& target) {
    const Marker::Kind kind = target.board.kind;
    return kind == Marker::Kind::circles || kind == Marker::Kind::acircles ||
           kind == Marker::Kind::hexcircles;
}

CalibrationView with_circle_centres(const CalibrationTarget& target,
                                    const CalibrationView& observed, const CameraModel& camera,
                                    const Rigid& camera_from_target) {
    CalibrationView view = observed;
    if (!has_circles(target))
        return view;
    const Projector projector(camera);
    for (std::size_t i = 0; i < view.pixels.size(); ++i) {
        const Eigen::Vector3d& centre = view.points_mm[i];
        const auto seen = projector.project(camera_from_target * centre);
        const auto centroid =
            disk_centroid(projector, camera_from_target, centre, target.board.part_mm / 2.0);
        if (seen && centroid)
            view.pixels[i] -= *centroid - *seen;
    }
    return view;
}

std::vector<CalibrationView> with_circle_centres(const CalibrationTarget& target,
                                                 std::vector<CalibrationView> views,
                                                 cv::Size image_size,
                                                 const std::optional<std::string>& model) {
    if (!has_circles(target))
        return views;
    const CameraCalibration first = calibrate_camera(
        views, image_size, {.model = model, .leave_one_out = false, .resamples = 0});
    for (std::size_t i = 0; i < views.size(); ++i)
        if (const auto& pose = first.views[i].camera_from_target)
            views[i] = with_circle_centres(target, views[i], first.camera, *pose);
    return views;
}

// The boards of compare/detect/board/calibration_target.h behind the Detector interface.

namespace {

// Empty for what is no board.
std::string detector_of(Marker::Kind kind) {
    switch (kind) {
        case Marker::Kind::charuco:
            return "charuco";
        case Marker::Kind::aprilgrid:
            return "aprilgrid";
        case Marker::Kind::circles:
        case Marker::Kind::acircles:
        case Marker::Kind::hexcircles:
            return "circles";
        case Marker::Kind::squares:
            return "squares";
        default:
            return "";
    }
}

class BoardDetector final : public Detector {
public:
    BoardDetector(const std::string& name, CalibrationTarget target)
        : Detector(name), target_(std::move(target)) {}

    Detection detect(const CodeImage& image) override {
        const auto [view, reason, shown_as] = observe(target_, image);
        if (!view)
            return {{}, reason.empty() ? "marker not found" : "marker not found: " + reason};
        const bool is_whole = view->ids.size() == target_.board.points_mm.size();
        return {DetectedCorners{0, view->pixels, is_whole ? std::vector<int>() : view->ids},
                {},
                {},
                shown_as};
    }

private:
    CalibrationTarget target_;
};

}  // namespace

std::unique_ptr<Detector> make_board_detector(const Marker& marker, const std::string& place) {
    const std::string name = detector_of(marker.kind);
    if (name.empty())
        throw ConfigError({place}, marker.spec + " is no board");
    return std::make_unique<BoardDetector>(name, parse_calibration_target(marker.spec, place));
}

}  // namespace etalon
