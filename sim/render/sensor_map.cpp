#include "sim/render/sensor_map.h"

#include <tbb/parallel_for.h>

namespace etalon {
namespace {

int margin_px(const ImageFilter& filter) {
    return filter.reach_px() + 4 * tile_px;
}

// Pixels of points along the box's border; nothing where one has no image, or where the box holds
// the backward axis.
std::vector<Eigen::Vector2d> box_outline(const Box& box, const Projector& projector) {
    constexpr int points_per_side = 31;
    std::vector<Eigen::Vector2d> pixels;
    const Eigen::Vector3d backward = -projector.axis();
    if (backward.z() > 0.0) {
        const Eigen::Array2d at = backward.hnormalized();
        if ((at >= box.low.array()).all() && (at <= box.high.array()).all())
            return pixels;
    }
    for (int n = 0; n < 4 * points_per_side; ++n) {
        const double along = (n % points_per_side) / double(points_per_side);
        const Eigen::Vector2d shares[] = {
            {along, 0.0}, {1.0, along}, {1.0 - along, 1.0}, {0.0, 1.0 - along}};
        const Eigen::Vector2d x =
            box.low + shares[n / points_per_side].cwiseProduct(box.high - box.low);
        const auto pixel = projector.project(x.homogeneous());
        if (!pixel)
            return {};
        pixels.push_back(*pixel);
    }
    return pixels;
}

}  // namespace

SensorMap::SensorMap(const ImageFilter& filter, const Projector& projector, const cv::Rect& pixels)
    : rays(projector, grown(pixels, margin_px(filter), margin_px(filter))),
      tail(filter, rays.projector(), pixels) {}

// What surrounds the blurred outline on the marker's plane does so on the sensor, too, but where
// the marker lies about the backward axis, around which no ray may be: then it is the whole image.
std::unique_ptr<const SensorMap> sensor_towards(const Projector& projector,
                                                const ImageFilter& filter, const MarkerView& view) {
    constexpr double bulge_px = 4.0 * tile_px;  // what bends between two points
    const CameraModel& camera = projector.camera();
    const int margin = margin_px(filter);
    const cv::Rect limit = grown({0, 0, camera.width, camera.height}, margin, margin);
    const auto around = box_outline(view.blurred_outline(), projector);
    return std::make_unique<const SensorMap>(
        filter, projector, pixels_around(around, Eigen::Array2d::Constant(bulge_px), limit));
}

cv::Mat valid_mask(const CameraModel& camera, const UndistortionMap& map) {
    cv::Mat valid(camera.height, camera.width, CV_8UC1);
    const cv::Rect image({0, 0}, valid.size());
    const auto put = [&](int level, int i, int j) {
        const int side = tile_px << (2 * level);
        const cv::Rect pixels = cv::Rect(i * side, j * side, side, side) & image;
        const auto validity = map.group(level, i, j).validity;
        valid(pixels).setTo(validity == UndistortionMap::Validity::all ? 255 : 0);
        return validity == UndistortionMap::Validity::some ? pixels : cv::Rect();
    };
    constexpr int level = UndistortionMap::block_level, side = tile_px << (2 * level);
    for_each_cell(cells_of(image, side), [&](int i, int j) {
        for_each_cell(cells_of(put(level, i, j), tile_px), [&](int x, int y) {
            for_each_cell(put(0, x, y), [&](int column, int row) {
                const auto ray = map.projector().unproject(Eigen::Vector2d(column, row));
                valid.at<uchar>(row, column) = ray ? 255 : 0;
            });
        });
    });
    return valid;
}

// By the corners of the tiles, as the map has it.
cv::Mat valid_mask(const Projector& projector) {
    const cv::Size size(projector.camera().width, projector.camera().height);
    const cv::Rect image({0, 0}, size), tiles = cells_of(image, tile_px);
    const auto has_ray = [&](double x, double y) { return projector.ray({x, y}).has_value(); };
    cv::Mat corners(tiles.height + 3, tiles.width + 3, CV_8UC1);  // one more on each side
    tbb::parallel_for(0, corners.rows, [&](int j) {
        for (int i = 0; i < corners.cols; ++i) {
            const Eigen::Vector2d at = UndistortionMap::tile_corner_px(i - 1, j - 1);
            corners.at<uchar>(j, i) = has_ray(at.x(), at.y()) ? 255 : 0;
        }
    });
    cv::Mat valid(size, CV_8UC1);
    tbb::parallel_for(0, tiles.height, [&](int j) {
        for (int i = 0; i < tiles.width; ++i) {
            const cv::Rect tile = cv::Rect(i * tile_px, j * tile_px, tile_px, tile_px) & image;
            const int with_ray = cv::countNonZero(corners(cv::Rect(i, j, 4, 4)));
            valid(tile).setTo(with_ray > 0 ? 255 : 0);
            if (with_ray == 0 || with_ray == 16)
                continue;
            for (int y = tile.y; y < tile.br().y; ++y)
                for (int x = tile.x; x < tile.br().x; ++x)
                    valid.at<uchar>(y, x) = has_ray(x, y) ? 255 : 0;
        }
    });
    return valid;
}

}  // namespace etalon
