#include "compare/detect/board/dark_shapes.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <optional>

namespace etalon {
namespace {

using Outline = std::vector<cv::Point>;

// Second moments of the area within an outline, over the area.
Eigen::Matrix2d spread_of(const cv::Moments& moments) {
    Eigen::Matrix2d spread;
    spread << moments.mu20, moments.mu11, moments.mu11, moments.mu02;
    return spread / moments.m00;
}

// Of an ellipse with these second moments every point of the outline is 2 standard deviations away.
bool is_ellipse(const Outline& outline, const Eigen::Vector2d& centre,
                const Eigen::Matrix2d& spread, double short_half_axis) {
    constexpr double shape = 0.11, steps_px = 0.6;  // a square's corners are 0.22 away
    const double allowed = shape + steps_px / short_half_axis;
    const Eigen::Matrix2d inverse = spread.inverse();
    return std::ranges::all_of(outline, [&](const cv::Point& point) {
        const Eigen::Vector2d arm = Eigen::Vector2d(point.x, point.y) - centre;
        return std::abs(0.5 * std::sqrt(arm.dot(inverse * arm)) - 1.0) < allowed;
    });
}

// Outlines run through the centres of border pixels: half a pixel inside the true one.
std::optional<DarkShape> ellipse_of(const Outline& outline) {
    constexpr double min_area_px2 = 8.0, max_axes_ratio = 6.0;
    const cv::Moments moments = cv::moments(outline);
    if (!(moments.m00 >= min_area_px2))
        return std::nullopt;
    const Eigen::Vector2d centre(moments.m10 / moments.m00, moments.m01 / moments.m00);
    const Eigen::Matrix2d spread = spread_of(moments);
    const double mean = 0.5 * spread.trace(),
                 apart = std::sqrt(std::max(0.0, mean * mean - spread.determinant()));
    const double longer = 2.0 * std::sqrt(mean + apart),
                 shorter = 2.0 * std::sqrt(std::max(0.0, mean - apart));
    if (!(longer < max_axes_ratio * shorter) || !is_ellipse(outline, centre, spread, shorter))
        return std::nullopt;
    return DarkShape{centre, std::numbers::pi * (longer + 0.5) * (shorter + 0.5)};
}

// Clockwise as seen, the image's y down; where the diagonals cross is the image of the middle.
std::optional<DarkShape> square_of(const Outline& outline) {
    constexpr double min_area_px2 = 40.0, bend = 0.03;  // of the outline's length
    Outline corners;
    cv::approxPolyDP(outline, corners, bend * cv::arcLength(outline, true), true);
    if (corners.size() != 4 || !cv::isContourConvex(corners))
        return std::nullopt;
    const double area = cv::contourArea(corners, /*oriented=*/true);
    if (!(std::abs(area) >= min_area_px2))
        return std::nullopt;
    if (area < 0.0)
        std::ranges::reverse(corners);
    DarkShape square;
    square.area_px2 = std::abs(area);
    for (const cv::Point& corner : corners)
        square.corners.emplace_back(corner.x, corner.y);
    const Eigen::Vector2d one = square.corners[2] - square.corners[0],
                          other = square.corners[3] - square.corners[1],
                          apart = square.corners[1] - square.corners[0];
    const double share = (apart.x() * other.y() - apart.y() * other.x()) /
                         (one.x() * other.y() - one.y() * other.x());
    square.centre = square.corners[0] + share * one;
    return square;
}

// Pixels of the halved image in those of the whole one.
Eigen::Vector2d in_whole(const Eigen::Vector2d& pixel, double factor) {
    return (factor * (pixel.array() + 0.5) - 0.5).matrix();
}

using Recognise = std::optional<DarkShape> (*)(const Outline& outline);

std::vector<DarkShape> find_dark(const cv::Mat& image, const ShapeScale& scale,
                                 Recognise recognise) {
    constexpr double darker_by = 6.0;  // of 255: less is noise
    cv::Mat halved = image;
    for (int i = 0; i < scale.halvings; ++i)
        cv::resize(halved, halved, {}, 0.5, 0.5, cv::INTER_AREA);
    cv::Mat dark;
    cv::adaptiveThreshold(halved, dark, 255, cv::ADAPTIVE_THRESH_MEAN_C, cv::THRESH_BINARY_INV,
                          scale.window, darker_by);
    std::vector<Outline> outlines;
    std::vector<cv::Vec4i> relatives;  // the last is the outline that this one is a hole in
    cv::findContours(dark, outlines, relatives, cv::RETR_CCOMP, cv::CHAIN_APPROX_NONE);
    const double factor = 1 << scale.halvings;
    std::vector<DarkShape> found;
    for (std::size_t i = 0; i < outlines.size(); ++i) {
        auto shape = relatives[i][3] < 0 ? recognise(outlines[i]) : std::nullopt;
        if (!shape)
            continue;
        shape->centre = in_whole(shape->centre, factor);
        shape->area_px2 *= factor * factor;
        for (Eigen::Vector2d& corner : shape->corners)
            corner = in_whole(corner, factor);
        found.push_back(std::move(*shape));
    }
    return found;
}

}  // namespace

std::vector<ShapeScale> shape_scales(cv::Size image_size) {
    constexpr int min_side_px = 100, narrow_window = 15, wide_window = 45;
    std::vector<ShapeScale> scales;
    for (int halvings = 0;
         halvings == 0 || std::min(image_size.width, image_size.height) >> halvings >= min_side_px;
         ++halvings)
        for (const int window : {narrow_window, wide_window})
            scales.insert(scales.begin(), {halvings, window});
    return scales;
}

std::vector<DarkShape> find_dark_ellipses(const cv::Mat& image, const ShapeScale& scale) {
    return find_dark(image, scale, ellipse_of);
}

std::vector<DarkShape> find_dark_squares(const cv::Mat& image, const ShapeScale& scale) {
    return find_dark(image, scale, square_of);
}

}  // namespace etalon
