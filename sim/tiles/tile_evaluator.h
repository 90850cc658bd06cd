// The samples of one tile that is not uniform: by the tile kernels where the whole tile has rays;
// at the border of the valid region by them pixel by pixel, or point by point in double precision.
#pragma once

#include "sim/psf/deconvolved_psf.h"
#include "sim/tiles/lens_average.h"
#include "sim/tiles/render_plan.h"
#include "sim/tiles/tile_interpolation.h"
#include "sim/tiles/undistortion_map.h"

namespace etalon {

// The lens points that exact areas need at this blur.
LensRule lens_rule(double blur_radius_px, double sharp_up_to_px);

// What does not change from tile to tile of an image.
struct TilePositionsOf {
    // For tiles that are sampled on another grid than the frame's.
    struct Grid {
        int k;
        TilePositions positions;  // with the interpolation's margin
        TileInterpolation interpolation;
    };

    explicit TilePositionsOf(const Sampling& sampling);
    TilePositions samples;
    std::optional<TilePositions> quarters;  // 2 x 2 per sample, where boxes take lens averages
    std::vector<Grid> coarser;              // as in Sampling
    std::optional<Grid> finer;              // of twice as many samples a side
};

// Scratch memory of one thread. View, map and positions must outlive it.
class TileEvaluator {
public:
    TileEvaluator(const MarkerView& view, const UndistortionMap& map, const Sampling& sampling,
                  const TilePositionsOf& positions);

    // `values`: (4 k)^2 differences from the background, row by row; of pixels another 4 x 4 behind
    // them, the averages before the spread. `range`: what the tile's rays can meet; nothing for a
    // tile at the border of the valid region. Says how it was done (with `tiles` 1).
    TileUse evaluate(int i, int j, const std::optional<CellRange>& range, float* values);

private:
    using Grid = TilePositionsOf::Grid;

    Box box_of(const Grid& grid, const TilePolynomial& place) const;
    TileUse sample_grid(const Grid& grid, const TilePolynomial& place, float* values);
    void set_lens_geometry(const TilePolynomial& place, const CellRange& range);
    TileUse sample_disks(const TilePolynomial& place, const Box& box, const CellRange& range,
                         const TilePositions& positions, float* values);
    TileUse sample_pixels(const TilePolynomial& place, const CellRange& range, float* values);
    TileUse sample_blurred_boxes(float* values);
    TileUse sample_boxes(const LensRule& rule, float* values);
    bool find_points(const Grid& grid, int i, int j);
    std::optional<TileUse> sample_grid_one_by_one(int i, int j, float* values);
    void sample_pixel(const TilePolynomial& cubic, const cv::Rect& samples, float* values);
    std::vector<bool> find_points_by_pixel(int i, int j, float* values);
    CellTable<char> rays_around(int i, int j) const;
    TileUse sample_one_by_one(int i, int j, float* values);
    double least_blur_px(const Box& box) const;
    double largest_blur_px(const Box& box) const;
    double mean_of_parts(int i, int j, int column, int row);
    double lens_average_at(const Eigen::Vector2d& x);
    double radiance_at(const MappedPoint& point, double side_px);

    const MarkerView& view_;
    const UndistortionMap& map_;
    const Sampling& sampling_;
    const TilePositionsOf& positions_;
    double fx_, smaller_focal_px_, larger_focal_px_;  // the latter two with the blur's scales
    TileGeometry geometry_;
    std::vector<float> lens_averages_, of_disk_, scratch_;
    std::vector<ConcentricDisk> disks_;
    std::vector<UnitLensPoint> lens_points_;
    int lens_points_of_ = -1;  // the rule that they are of, by its number of points
    // For tiles at the border.
    LensAverage lens_average_;
    std::optional<CellCoverage> coverage_;          // made when first needed
    int coverage_of_ = 0;                           // its number of lens points
    std::optional<TilePositions> pixel_positions_;  // of one pixel's samples; when first needed
    std::vector<std::optional<MappedPoint>> points_;
};

}  // namespace etalon
