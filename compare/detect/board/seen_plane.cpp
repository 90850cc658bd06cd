#include "compare/detect/board/seen_plane.h"

#include <Eigen/Dense>
#include <opencv2/calib3d.hpp>

namespace etalon {

std::optional<SeenPlane> SeenPlane::through(const std::vector<Eigen::Vector2d>& mm,
                                            const std::vector<Eigen::Vector2d>& pixels) {
    std::vector<cv::Point2d> from, to;
    for (std::size_t i = 0; i < mm.size(); ++i) {
        from.emplace_back(mm[i].x(), mm[i].y());
        to.emplace_back(pixels[i].x(), pixels[i].y());
    }
    const cv::Mat h = from.size() < 4 ? cv::Mat() : cv::findHomography(from, to, 0);
    if (h.empty())
        return std::nullopt;
    SeenPlane view;
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column)
            view.pixel_from_mm(row, column) = h.at<double>(row, column);
    return view;
}

Eigen::Vector2d SeenPlane::at(const Eigen::Vector2d& mm) const {
    return (pixel_from_mm * mm.homogeneous()).hnormalized();
}

Eigen::Matrix2d SeenPlane::px_per_mm(const Eigen::Vector2d& mm) const {
    const Eigen::Vector3d there = pixel_from_mm * mm.homogeneous();
    return (pixel_from_mm.topLeftCorner<2, 2>() -
            there.hnormalized() * pixel_from_mm.bottomLeftCorner<1, 2>()) /
           there.z();
}

}  // namespace etalon
