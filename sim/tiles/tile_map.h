// Images that are mostly constant, tile by tile: what the aperture's samples and the averages of
// the diffraction tail are kept in.
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <vector>

namespace etalon {

// a / b rounded down; b > 0.
int floor_div(int a, int b);

// The cells of `size` pixels that hold a pixel of the rectangle.
cv::Rect cells_of(const cv::Rect& pixels, int size);

// The rectangle with margins of x and y on both sides.
cv::Rect grown(const cv::Rect& rect, int x, int y);

// Whether an image is too large to be still in the caches when all of it has been written.
bool is_past_caches(const cv::Mat& pixels);

// Writes the value to the region's `pixels` (CV_32FC1, its size) outside of `inner`, a part of the
// region, which may be empty.
void set_outside(const cv::Rect& inner, const cv::Rect& region, float value, cv::Mat& pixels);

// What is known of a tile besides one value.
enum class TileDetail : unsigned char {
    none,      // it is this value throughout
    quarters,  // their averages
    samples,   // and finer ones
};

// One value for each tile of a grid, zero outside, and where it is the same throughout.
class TileMap {
public:
    // All zero and none of them refined.
    explicit TileMap(const cv::Rect& tiles = {});

    // A refined tile, of which there is any detail elsewhere, counts as different from its
    // neighbours.
    void set(int i, int j, float value, TileDetail detail = TileDetail::none) {
        values_[index(i, j)] = value;
        details_[index(i, j)] = detail;
    }
    // The same for every tile of a part of the map.
    void fill(const cv::Rect& part, float value);
    // The tiles that both have become the other's.
    void copy(const TileMap& other);
    // After the last change: prepares is_constant().
    void finish();

    const cv::Rect& tiles() const { return tiles_; }

    // Whether a part is surely one value throughout (a part to the right of or below a different
    // tile may be missed). O(1).
    bool is_constant(const cv::Rect& part) const;

    bool refined(int i, int j) const { return refined(index(i, j)); }
    bool refined(std::size_t index) const { return details_[index] != TileDetail::none; }
    TileDetail detail(int i, int j) const { return details_[index(i, j)]; }
    std::size_t refined_count() const;
    float at(const cv::Point& tile) const {
        return tiles_.contains(tile) ? values_[index(tile.x, tile.y)] : 0.0f;
    }
    // The values from a tile on, to the end of its row, and their details.
    const float* from(const cv::Point& tile) const { return &values_[index(tile.x, tile.y)]; }
    float* from(const cv::Point& tile) { return &values_[index(tile.x, tile.y)]; }
    const TileDetail* details_from(const cv::Point& tile) const {
        return &details_[index(tile.x, tile.y)];
    }

    std::size_t index(int i, int j) const {
        return static_cast<std::size_t>(j - tiles_.y) * static_cast<std::size_t>(tiles_.width) +
               static_cast<std::size_t>(i - tiles_.x);
    }

private:
    cv::Rect tiles_;
    std::vector<float> values_;
    std::vector<TileDetail> details_;
    cv::Rect counted_;         // the tiles and one more on each side
    std::vector<int> counts_;  // summed-area table over them of tiles that are refined or unlike
                               // their left or upper neighbour
};

// Groups of 4 x 4 tiles by how their pixels are found.
enum class GroupKind : unsigned char {
    constant,  // as far as a pixel's filter looks
    sampled,
    edge,       // from an edge's response; there are samples for others
    edge_only,  // there are none
};

// `constant` outside of its groups.
class GroupMap {
public:
    explicit GroupMap(const cv::Rect& groups = {})
        : groups_(groups), kinds_(static_cast<std::size_t>(groups.area())) {}

    const cv::Rect& groups() const { return groups_; }
    GroupKind at(int i, int j) const {
        return groups_.contains({i, j}) ? kinds_[index(i, j)] : GroupKind::constant;
    }
    void set(int i, int j, GroupKind kind) { kinds_[index(i, j)] = kind; }

private:
    std::size_t index(int i, int j) const {
        return static_cast<std::size_t>(j - groups_.y) * static_cast<std::size_t>(groups_.width) +
               static_cast<std::size_t>(i - groups_.x);
    }

    cv::Rect groups_;
    std::vector<GroupKind> kinds_;
};

// Samples on a regular grid in square tiles. For each tile with the detail `least` or more `finer`
// holds a pointer, by TileMap::index(): `side` x `side` samples stand row by row `offset` behind
// it. Elsewhere the tile is taken as the map's value throughout. With the side 1 the map says it
// all. The map and `finer` must outlive it.
struct SampleField {
    const TileMap& map;
    int side = 1;
    const float* const* finer = nullptr;
    std::ptrdiff_t offset = 0;
    TileDetail least = TileDetail::quarters;
    const GroupMap* groups = nullptr;  // where the result need not be found from samples
};

}  // namespace etalon
