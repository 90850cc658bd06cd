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

// Calls body(i, j) for each cell, row by row.
template <class Body>
void for_each_cell(const cv::Rect& cells, const Body& body) {
    for (int j = cells.y; j < cells.br().y; ++j)
        for (int i = cells.x; i < cells.br().x; ++i)
            body(i, j);
}

// One T for each cell of a rectangle, row by row.
template <class T>
struct CellTable {
    cv::Rect rect;
    std::vector<T> cells;

    explicit CellTable(const cv::Rect& of = {})
        : rect(of), cells(static_cast<std::size_t>(of.area())) {}

    std::size_t index(int i, int j) const {
        return static_cast<std::size_t>(j - rect.y) * static_cast<std::size_t>(rect.width) +
               static_cast<std::size_t>(i - rect.x);
    }
    T& at(int i, int j) { return cells[index(i, j)]; }
    const T& at(int i, int j) const { return cells[index(i, j)]; }
    // T() outside.
    T find(int i, int j) const { return rect.contains({i, j}) ? at(i, j) : T(); }
};

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

// One value for each tile of a grid, zero outside, and where it is the same throughout. A refined
// tile has finer values elsewhere and counts as different from its neighbours.
class TileMap {
public:
    // All zero and none of them refined.
    explicit TileMap(const cv::Rect& tiles = {});

    void set(int i, int j, float value, TileDetail detail = TileDetail::none,
             const float* finer = nullptr) {
        const std::size_t n = values_.index(i, j);
        values_.cells[n] = value;
        details_[n] = detail;
        finer_[n] = finer;
    }
    // The same for every tile of a part of the map.
    void fill(const cv::Rect& part, float value);
    // The tiles that both have become the other's.
    void copy(const TileMap& other);
    // After the last change: prepares is_constant().
    void finish();

    const cv::Rect& tiles() const { return values_.rect; }

    // Whether a part is surely one value throughout (a part to the right of or below a different
    // tile may be missed). O(1).
    bool is_constant(const cv::Rect& part) const;

    float at(const cv::Point& tile) const { return values_.find(tile.x, tile.y); }
    bool refined(int i, int j) const { return details_[values_.index(i, j)] != TileDetail::none; }
    // From a tile on, to the end of its row.
    const float* from(const cv::Point& tile) const { return &values_.at(tile.x, tile.y); }
    float* from(const cv::Point& tile) { return &values_.at(tile.x, tile.y); }
    const TileDetail* details_from(const cv::Point& tile) const {
        return &details_[values_.index(tile.x, tile.y)];
    }
    const float* const* finer_from(const cv::Point& tile) const {
        return &finer_[values_.index(tile.x, tile.y)];
    }

private:
    CellTable<float> values_;
    std::vector<TileDetail> details_;
    std::vector<const float*> finer_;
    cv::Rect counted_;  // the tiles and one more on each side
    cv::Mat counts_;  // summed-area table over them of tiles that are refined or unlike their left
                      // or upper neighbour
};

// Groups of 4 x 4 tiles by how their pixels are found.
enum class GroupKind : unsigned char {
    constant,  // as far as a pixel's filter looks
    sampled,
    edge,       // from an edge's response; there are samples for others
    edge_only,  // there are none
};

// Samples on a regular grid in square tiles. Each tile with the detail `least` or more has `side` x
// `side` of them, row by row, `offset` behind the map's finer values. Elsewhere the tile is taken
// as the map's value throughout. With the side 1 the map says it all. The map must outlive it.
struct SampleField {
    const TileMap& map;
    int side = 1;
    std::ptrdiff_t offset = 0;
    TileDetail least = TileDetail::quarters;
    const CellTable<GroupKind>* groups = nullptr;  // where the result need not be from samples
};

}  // namespace etalon
