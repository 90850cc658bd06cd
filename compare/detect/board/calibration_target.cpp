#include "compare/detect/board/calibration_target.h"

#include <fmt/format.h>

#include <Eigen/Dense>

#include "calib/intrinsics/calibrate.h"
#include "compare/detect/board/chessboard_corners.h"
#include "compare/detect/detector_adaptors.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

FoundBoard find_points(const Marker& board, const CodeImage& image) {
    if (board.kind == Marker::Kind::chessboard) {
        const auto corners = find_chessboard_corners(image, board.columns, board.rows);
        FoundBoard found;
        for (std::size_t i = 0; corners && i < corners->pixels.size(); ++i)
            if (corners->refined[i])
                found.add(static_cast<int>(i), corners->pixels[i]);
        return found;
    }
    const BoardPhoto photo{as_float(image), as_8_bit(image)};
    if (board.kind == Marker::Kind::charuco)
        return find_charuco_corners(board, photo);
    if (board.kind == Marker::Kind::aprilgrid)
        return find_tag_grid_corners(board, photo);
    if (board.kind == Marker::Kind::squares)
        return find_square_corners(board, photo);
    return find_circle_centroids(board, photo);
}

// The centroid of a projected disk by Green's theorem, trapezoidal rule along its outline.
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
    using enum Marker::Kind;
    static const std::map<Marker::Kind, std::pair<int, const char*>> least_of = {
        {chessboard, {3, "inner corners"}}, {charuco, {3, "squares"}}, {aprilgrid, {2, "tags"}},
        {squares, {2, "squares"}},          {circles, {3, "circles"}}, {acircles, {3, "circles"}},
        {hexcircles, {3, "circles"}}};
    const auto found = least_of.find(board.kind);
    if (found == least_of.end())
        throw ConfigError({place, 0, board.spec},
                          "a camera is calibrated with a board, for instance chessboard:9x6@25mm");
    const auto& [least, what] = found->second;
    if (std::min(board.columns, board.rows) < least)
        throw ConfigError(
            {place, 0, board.spec},
            fmt::format("a board of {}x{} {} is too small to calibrate with: {}x{} at least",
                        board.columns, board.rows, what, least, least));
    return {board};
}

ObservedTarget observe(const CalibrationTarget& target, const CodeImage& image) {
    if (image.pixels.empty())
        return {{}, "an empty image"};
    const FoundBoard found = find_points(target.board, image);
    if (found.points.empty())
        return {{}, found.reason};
    CalibrationView view;
    for (const auto& [id, pixel] : found.points) {
        view.points_mm.push_back(target.board.points_mm[static_cast<std::size_t>(id)]);
        view.pixels.push_back(pixel);
        view.ids.push_back(id);
    }
    constexpr std::size_t min_points = 6;  // of fewer none is known to be wrong
    const std::size_t enough = std::min(min_points, target.board.points_mm.size());
    // Not fewer than two rows of them: else the plane's two directions are not determined.
    const Eigen::Vector3d spread = principal_spreads(view.points_mm);
    if (view.pixels.size() < enough || !(spread[1] > 1e-3 * spread[0]))
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

std::unique_ptr<Detector> make_board_detector(const std::string& name, const Marker& marker,
                                              const std::string& place) {
    return std::make_unique<Detector>(
        name, [target = calibration_target(marker, place)](const CodeImage& image) -> Detection {
            const auto [view, reason, shown_as] = observe(target, image);
            if (!view)
                return {{}, reason.empty() ? "marker not found" : "marker not found: " + reason};
            const bool is_whole = view->ids.size() == target.board.points_mm.size();
            return {DetectedCorners{0, view->pixels, is_whole ? std::vector<int>() : view->ids},
                    {},
                    {},
                    shown_as};
        });
}

}  // namespace etalon
