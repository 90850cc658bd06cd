// Where every point of the sensor looks: undistorted normalised coordinates, fast and with bounds.
//
// In each square tile the bicubic polynomial through 4 x 4 corners replaces Newton's inverse
// (calib/camera/projector.h): error below 1e-4 px, mostly 1e-5. A tile that bends too much has a
// cubic through 4 x 4 inner points, 46 times better; at the valid region's border and beyond that
// Newton's method. Bezier control points bound what a tile sees, a group of 4 x 4 tiles, of 4 x 4
// groups and so on.
//
// Blocks of 16 x 16 tiles are made on demand (before, one cubic bounds a block); results do not
// depend on that. Every thread. 1 us per block, a tile 0.3 us, 10 us with a cubic of its own.
#pragma once

#include <atomic>

#include "sim/scene/marker_view.h"
#include "sim/tiles/tile_kernel.h"
#include "sim/tiles/tile_map.h"

namespace etalon {

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
    static constexpr int block_level = 2, block_side = group_side * group_side;  // tiles

    enum class Validity { all, some, none };

    // How much the undistortion bends among some tiles.
    struct Bend {
        // Largest change of its derivative from one pixel to the next, relative to the derivative:
        // px of sagitta times 8 over a length of 1 px. At most `most`, which a fold has.
        double curvature = 0.0;
        bool is_polynomial = true;  // the validity is `all` everywhere
        // The distortion's own magnification in any direction, at least (of the smaller focal
        // length) and at most (of the larger); not of tiles at the border of the valid region.
        double least_scale = 1.0, largest_scale = 1.0;
        static constexpr double most = 1.0;
    };

    // A tile or a group of tiles.
    struct Group {
        Validity validity = Validity::none;  // of all its points: have they a ray?
        Box bounds{Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero()};  // of what has a ray
        // See Bend; not of groups larger than a block.
        double curvature = 0.0;
        double least_scale = std::numeric_limits<double>::infinity(), largest_scale = 0.0;

        void unite(const Group& other);
    };

    // Covers the image and at least `margin_px` around it, or these pixels, which may lie outside
    // of the image.
    UndistortionMap(const Projector& projector, int margin_px);
    UndistortionMap(const Projector& projector, const cv::Rect& pixels);

    // Tile indices: tile (i, j) covers the pixels tile_px * i ... tile_px * i + tile_px - 1.
    cv::Rect tiles() const { return tiles_; }

    // The pixel coordinates of a tile's upper left corner.
    static Eigen::Vector2d tile_corner_px(int i, int j) {
        return {tile_px * i - 0.5, tile_px * j - 0.5};
    }

    // Groups of tiles: level 0 are the tiles, group (i, j) of level n + 1 holds 4 x 4 of level n
    // from (4 i, 4 j) on. The last level has at most 4 x 4, blocks or groups of them.
    int levels() const { return block_level + static_cast<int>(levels_.size()); }
    cv::Rect groups(int level) const;
    const Group& group(int level, int i, int j) const {
        if (level >= block_level)
            return levels_[static_cast<std::size_t>(level - block_level)].at(i, j);
        return level == 0 ? tile(i, j) : block(i >> 2, j >> 2).groups[place_in<group_side>(i, j)];
    }
    // Says that these will be asked for soon: most of the table is not in a core's cache.
    void prefetch(int level, const cv::Rect& groups) const;
    Validity validity(int i, int j) const { return tile(i, j).validity; }
    const Box& bounds(int i, int j) const { return tile(i, j).bounds; }

    // Of these tiles and some around them.
    Bend bend(const cv::Rect& tiles) const;
    // Of a group that is not larger than a block.
    Bend bend(int level, int i, int j) const;

    // Of a tile whose validity() is `all`.
    TilePolynomial polynomial(int i, int j) const;
    // Says that a tile's will be asked for soon.
    void prefetch_polynomial(int i, int j) const;

    // The corner of a tile of group (i, j) of level 1, counted from the group's first: 0 to 4. Not
    // a number where there is no ray.
    const Eigen::Vector2d& corner_in_group(int i, int j, int column, int row) const {
        return node(block(i >> 2, j >> 2), group_side * i, group_side * j, row + 1, column + 1);
    }

    // The centres of a tile's n x n parts, row by row. Nothing where there is no ray.
    void sample(int i, int j, int n, std::vector<std::optional<MappedPoint>>& points) const;

    // Exact and slow, at any pixel; less so where a point `near` it is known.
    std::optional<MappedPoint> exact(const Eigen::Vector2d& pixel,
                                     const std::optional<MappedPoint>& near = std::nullopt) const;

    // Of a square that lies anywhere, its points roughly known; nothing where a cubic misses them
    // by 1e-4 px or some of it has no ray.
    std::optional<TilePolynomial> cubic_within(const Eigen::Vector2d& corner_px, double side_px,
                                               const TilePolynomial& rough) const;

    const Projector& projector() const { return projector_; }

private:
    struct Tile : Group {
        int own_cubic = -1;  // index in own_cubics
    };
    static constexpr int nodes_a_side = block_side + 3;
    // Of tiles outside of the map's nothing is made.
    struct Block {
        // The tiles' corners, one more on each side, and those of the map's tiles alone; NaN: no
        // ray.
        std::array<Eigen::Vector2d, nodes_a_side * nodes_a_side> nodes;
        std::array<Tile, block_side * block_side> tiles;
        std::array<Group, group_side * group_side> groups;
        Group whole;
        std::vector<TilePolynomial> own_cubics;
    };
    struct BlockSlot {
        std::atomic<const Block*> made{nullptr};
        ~BlockSlot() { delete made.load(); }
    };

    // Of `side` a row in the next larger one.
    template <int side>
    static std::size_t place_in(int i, int j) {
        return static_cast<std::size_t>((j & (side - 1)) * side + (i & (side - 1)));
    }
    const Block& block(int i, int j) const;
    const Block& block_of(int i, int j) const { return block(i >> 4, j >> 4); }  // of a tile
    const Tile& tile(int i, int j) const {
        return block_of(i, j).tiles[place_in<block_side>(i, j)];
    }

    void make_blocks();
    std::optional<Group> group_of_block(int i, int j, const TilePolynomial& cubic) const;
    std::unique_ptr<const Block> make_block(int i, int j) const;
    void make_nodes(int i, int j, const cv::Rect& tiles, Block& block) const;
    static const Eigen::Vector2d& node(const Block& block, int i, int j, int row, int column);
    static TilePolynomial through_nodes(const Block& block, int i, int j);
    Tile make_tile(int i, int j, Block& block) const;
    static double bend_of_nodes(const Block& block, int i, int j);
    std::optional<double> error_at(const Eigen::Vector2d& rough,
                                   const Eigen::Vector2d& pixel) const;
    void set_bend(const Block& block, int i, int j, Group& tile) const;
    Tile make_border_tile(int i, int j) const;

    Projector projector_;
    cv::Rect tiles_;
    std::vector<CellTable<Group>> levels_;  // from blocks on
    std::unique_ptr<CellTable<BlockSlot>> blocks_;
};

}  // namespace etalon
