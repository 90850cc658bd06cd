// Where every point of the sensor looks: undistorted normalised coordinates, fast and with bounds.
//
// The sensor is divided into square tiles. Newton's inverse (calib/projector.h) is evaluated at
// their corners; inside a tile, the bicubic Lagrange polynomial through 4 x 4 corners replaces it
// (error below 1e-5 px, next to a fold below 1e-3 px; a test measures it). Its Bezier control
// points bound a tile's part of the scene rigorously. Tiles at the border of the valid region are
// evaluated with Newton's method point by point.
//
// Immutable after construction, safe from every thread; construction takes some 0.3 us per tile.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "calib/projector.h"
#include "sim/marker_view.h"

namespace etalon {

// An undistorted sensor point with its derivative by the pixel, d x / d pixel.
struct MappedPoint {
    Eigen::Vector2d x;
    Eigen::Matrix2d jacobian;
};

class UndistortionMap {
public:
    static constexpr int tile_px = 4;

    enum class Validity { all, some, none };

    // Covers the image and at least `margin_px` around it.
    UndistortionMap(const Projector& projector, int margin_px);

    // Tile indices: tile (i, j) covers the pixels tile_px * i ... tile_px * i + tile_px - 1.
    cv::Rect tiles() const { return tiles_; }

    Validity validity(int i, int j) const { return tile(i, j).validity; }

    // All undistorted points of the tile; only where validity() is `all`.
    const Box& bounds(int i, int j) const { return tile(i, j).bounds; }

    // The points of a tile on a regular grid of n x n, row by row, each at the centre of its n-th
    // part. Nothing where there is no ray.
    void sample(int i, int j, int n, std::vector<std::optional<MappedPoint>>& points) const;

    // Exact and slow, at any pixel.
    std::optional<MappedPoint> exact(const Eigen::Vector2d& pixel) const;

    const Projector& projector() const { return projector_; }

private:
    struct Tile {
        Validity validity;
        Box bounds;
    };
    using Nodes = Eigen::Matrix4d;  // one coordinate at 4 x 4 corners, rows along y

    const Tile& tile(int i, int j) const {
        return table_[static_cast<std::size_t>((j - tiles_.y) * tiles_.width + i - tiles_.x)];
    }
    const Eigen::Vector2d& node(int i, int j) const {
        return nodes_[static_cast<std::size_t>((j - tiles_.y + 1) * (tiles_.width + 3) + i -
                                               tiles_.x + 1)];
    }
    Nodes nodes(int i, int j, int axis) const;
    void make_nodes();
    Tile make_tile(int i, int j) const;

    Projector projector_;
    cv::Rect tiles_;
    std::vector<Eigen::Vector2d> nodes_;  // tile corners, one more on each side; NaN: no ray
    std::vector<Tile> table_;
};

}  // namespace etalon
