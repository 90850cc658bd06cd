// Where every point of the sensor looks: undistorted normalised coordinates, fast and with bounds.
//
// The sensor is divided into square tiles. Newton's inverse (calib/camera/projector.h) is evaluated
// at their corners; inside a tile, the bicubic Lagrange polynomial through 4 x 4 corners replaces
// it (error below 1e-4 px, mostly below 1e-5 px; a test measures it). Where that bends too much, as
// far from the axis of a wide-angle lens, a tile has a cubic of its own through 4 x 4 points within
// it, which errs 46 times less. The Bezier control points bound a tile's part of the scene
// rigorously. Tiles at the border of the valid region, and those that bend too much even so, are
// evaluated with Newton's method point by point. Groups of 4 x 4 tiles, of 4 x 4 groups and so on
// have bounds as well: a search for a marker passes over most of the image in a few steps.
//
// Immutable after construction, safe from every thread; construction takes some 0.6 us per tile, 10
// where it has a cubic of its own.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "calib/camera/projector.h"
#include "sim/scene/marker_view.h"

namespace etalon {

inline constexpr int tile_px = 4;  // side of a tile

// An undistorted sensor point with its derivative by the pixel, d x / d pixel.
struct MappedPoint {
    Eigen::Vector2d x;
    Eigen::Matrix2d jacobian;
};

// A tile's undistorted points as polynomials of the place in it: with s and t from -0.5 to 0.5
// across the tile, x = centre + sum of coefficients(j, i) t^j s^i (without the term 0, 0).
struct TilePolynomial {
    Eigen::Vector2d centre;
    Eigen::Matrix4d x, y;
};

// The same points in a frame that is turned about the lens: (X, Y) / Z of turn * (x, 1).
TilePolynomial turned(const TilePolynomial& polynomial, const Eigen::Matrix3d& turn);

class UndistortionMap {
public:
    static constexpr int group_side = 4;

    enum class Validity { all, some, none };

    // Covers the image and at least `margin_px` around it, or these pixels, which may lie outside
    // of the image.
    UndistortionMap(const Projector& projector, int margin_px);
    UndistortionMap(const Projector& projector, const cv::Rect& pixels);

    // Tile indices: tile (i, j) covers the pixels tile_px * i ... tile_px * i + tile_px - 1.
    cv::Rect tiles() const { return tiles_; }

    Validity validity(int i, int j) const { return tile(i, j).validity; }

    // The pixel coordinates of a tile's upper left corner.
    static Eigen::Vector2d tile_corner_px(int i, int j) {
        return {tile_px * i - 0.5, tile_px * j - 0.5};
    }

    // All undistorted points of the tile; not where validity() is `none`.
    const Box& bounds(int i, int j) const { return tile(i, j).bounds; }

    // Groups of tiles: level 0 are the tiles, a group of level n + 1 holds 4 x 4 of level n (group
    // (i, j) those from 4 i and 4 j on). The last level has at most 4 x 4.
    int levels() const { return static_cast<int>(groups_.size()); }
    cv::Rect groups(int level) const { return groups_[static_cast<std::size_t>(level)].rect; }
    Validity validity(int level, int i, int j) const { return group(level, i, j).validity; }
    const Box& bounds(int level, int i, int j) const { return group(level, i, j).bounds; }
    // Says that these will be asked for soon: most of the table is not in a core's cache.
    void prefetch(int level, const cv::Rect& groups) const;

    // How much the undistortion bends among these tiles and some around them.
    struct Bend {
        // Largest change of its derivative from one pixel to the next, relative to the derivative:
        // px of sagitta times 8 over a length of 1 px. Beside a fold, where it is infinite, and
        // beyond this: `most`.
        double curvature = 0.0;
        bool is_polynomial = true;  // validity() is `all` everywhere
        // The distortion's own magnification in any direction, at least (of the smaller focal
        // length) and at most (of the larger); not of tiles at the border of the valid region.
        double least_scale = 1.0, largest_scale = 1.0;
        static constexpr double most = 1.0;
    };
    Bend bend(const cv::Rect& tiles) const;
    Bend bend(int level, int i, int j) const;  // of a group

    // Of a tile whose validity() is `all`.
    TilePolynomial polynomial(int i, int j) const;
    // Says that a tile's will be asked for soon.
    void prefetch_polynomial(int i, int j) const;

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
        double curvature = 0.0;  // see Bend
        int own_cubic = -1;      // index in own_cubics_
        double least_scale = std::numeric_limits<double>::infinity(), largest_scale = 0.0;
    };
    using Nodes = Eigen::Matrix4d;  // one coordinate at 4 x 4 corners, rows along y

    struct Level {
        cv::Rect rect;
        std::vector<Tile> table;

        const Tile& at(int i, int j) const {
            return table[static_cast<std::size_t>(j - rect.y) *
                             static_cast<std::size_t>(rect.width) +
                         static_cast<std::size_t>(i - rect.x)];
        }
    };

    const Tile& group(int level, int i, int j) const {
        return groups_[static_cast<std::size_t>(level)].at(i, j);
    }
    const Tile& tile(int i, int j) const { return group(0, i, j); }
    const Eigen::Vector2d& node(int i, int j) const {
        return nodes_[static_cast<std::size_t>(j - tiles_.y + 1) *
                          static_cast<std::size_t>(tiles_.width + 3) +
                      static_cast<std::size_t>(i - tiles_.x + 1)];
    }
    Nodes nodes(int i, int j, int axis) const;
    void make_nodes();
    Tile make_tile(int i, int j);
    std::optional<TilePolynomial> own_cubic(int i, int j) const;
    double error_in_the_middle(int i, int j, const Nodes& x, const Nodes& y) const;
    void set_bend(const Nodes& x, const Nodes& y, Tile& tile) const;
    Tile make_border_tile(int i, int j) const;
    static Tile united(const Tile& a, const Tile& b);
    static Level group_up(const Level& below);

    Projector projector_;
    cv::Rect tiles_;
    std::vector<Eigen::Vector2d> nodes_;  // tile corners, one more on each side; NaN: no ray
    std::vector<Level> groups_;           // [0]: the tiles
    std::vector<TilePolynomial> own_cubics_;
};

}  // namespace etalon
