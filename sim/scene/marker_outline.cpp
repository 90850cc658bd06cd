#include "sim/scene/marker_outline.h"

namespace etalon {

std::vector<Eigen::Vector2d> marker_outline(const MarkerView& view, const Projector& projector,
                                            int points_per_side) {
    std::vector<Eigen::Vector2d> pixels;
    pixels.reserve(static_cast<std::size_t>(4 * points_per_side));
    for (int n = 0; n < 4 * points_per_side; ++n) {
        const double along = (n % points_per_side) / (points_per_side - 1.0);
        const double s[] = {along, 1.0, 1.0 - along, 0.0};
        const double t[] = {0.0, along, 1.0, 1.0 - along};
        const int side = n / points_per_side;
        const auto pixel = projector.project(
            view.camera_from_grid() *
            Eigen::Vector3d(s[side] * view.columns(), t[side] * view.rows(), 1.0));
        if (!pixel)
            return {};
        pixels.push_back(*pixel);
    }
    return pixels;
}

cv::Rect pixels_around(const std::vector<Eigen::Vector2d>& outline, const Eigen::Array2d& margin,
                       const cv::Rect& limit) {
    if (outline.empty())
        return limit;
    Eigen::Array2d low = outline.front(), high = low;
    for (const Eigen::Vector2d& pixel : outline) {
        low = low.min(pixel.array());
        high = high.max(pixel.array());
    }
    const auto clamped = [](double px) { return static_cast<int>(std::clamp(px, -1e8, 1e8)); };
    low -= margin;
    high += margin;
    return cv::Rect(cv::Point(clamped(low.x()), clamped(low.y())),
                    cv::Point(clamped(high.x()), clamped(high.y()))) &
           limit;
}

}  // namespace etalon
