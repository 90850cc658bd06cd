// The pixels along a known target's straight edges, each with its distance from the projected edge:
// the over-sampled edge spread function from which blur is measured. The distance is along the
// normal, in pixels of the photograph at that place; distortion is taken out. Pose and print do not
// tell an edge's place to a hundredth of a pixel: a fit of blur also fits each edge's shift and
// turn (compare/edges/edge_fit.h).
#pragma once

#include <span>
#include <vector>

#include "compare/photometric/compared_area.h"

namespace etalon {

// A piece of a cell grid's line with one radiance before it and another after it, each for so many
// cells away from it.
struct GridEdge {
    int axis;               // 0: u = line, 1: v = line (grid coordinates, in cells)
    int line, first, last;  // cells along it, last included
    int reach_before, reach_after;
    bool rises;      // radiance grows with u (v)
    float contrast;  // difference of the two radiances, above 0

    int cells() const { return last - first + 1; }
    // Grid coordinates of a place along it: `along` from first to last + 1.
    Eigen::Vector2d at(double along) const {
        return axis == 0 ? Eigen::Vector2d(line, along) : Eigen::Vector2d(along, line);
    }
};

// Lines of constant u first, each from the lower end on. The grid's outline is no edge: what lies
// outside is not known.
std::vector<GridEdge> grid_edges(const CellGrid& grid);

// Variance of a pixel's linear radiance (1 = full scale).
struct RadianceNoise {
    double constant = 0.0, per_radiance = 0.0;
    bool is_known = false;  // from the camera's gain; otherwise only its course, not its level
    double variance(double radiance) const {
        return constant + per_radiance * (radiance > 0.0 ? radiance : 0.0);
    }
};

// A photograph as the lens delivered it: black level and transfer curve undone.
struct LinearPhoto {
    Radiance radiance;  // CV_32FC1
    cv::Mat clipped;    // CV_8UC1: 255 where the code is 0 or full scale, thus only a bound
    RadianceNoise noise;
};

// With the camera's sensor section (without one: linear, black 0). Noise: shot, read and rounding
// where the sensor has a gain; otherwise equal for all pixels. Throws as SensorModel does.
LinearPhoto linear_photo(const CodeImage& photo, const CameraModel& camera);

struct EdgePixel {
    double distance_px;  // from the edge along its normal, positive on the lighter side
    double along_px;     // from the edge's middle
    double radiance;
    double depth_term = 0.0;  // of the target there, as StraightEdge's
};

// A piece of a grid line between a darker and a lighter cell, as seen in one photograph.
struct StraightEdge {
    Eigen::Vector2d centre_px = Eigen::Vector2d::Zero();
    Eigen::Vector2d normal = Eigen::Vector2d::UnitX();  // in the image, towards the lighter side
    double length_px = 0.0;                             // of the part that was used
    double clearance_px = 0.0;                          // from any pixel to the next edge, at least
    // Of the target along the edge: mean of 1/z and variance about it. Of a wide lens z is the
    // distance; a telecentric camera's term is z itself.
    double depth_term = 0.0, depth_term_variance = 0.0;
    Eigen::Vector2d undistorted = Eigen::Vector2d::Zero();  // of centre_px: normalised coordinates
    // A blur disk's radius in px is this times the aperture's times the difference of depth terms.
    // This and `undistorted` of a wide lens are in the frame that looks at the target
    // (turn_towards()).
    double px_per_unit = 0.0;
    double px_per_pitch = 1.0;  // px along the normal per pitch along x: hypot(nx, ny fy / fx)
    int photo = 0;              // whose edge it is, as numbered by the caller
    RadianceNoise noise;
    std::vector<EdgePixel> pixels;

    // Mean and variance of the depth term from the pixels; zero without any.
    void set_depth();
};

// The pixels of `within` that a band may cover: so far along and across an edge from its middle.
cv::Rect band_pixels(const Eigen::Vector2d& middle_px, const Eigen::Vector2d& normal,
                     double half_length_px, double half_width_px, const cv::Rect& within);

// Distance of the farthest pixel from its edge, px.
double reach_px(std::span<const StraightEdge> edges);

// Mean radiance beyond half of the reach on either side; both 0 where one side has no pixel there.
struct SideLevels {
    double dark = 0.0, light = 0.0;
};
SideLevels side_levels(const StraightEdge& edge);

struct EdgeSelection {
    double half_width_px = 7.0;  // to either side of the edge
    // Between a pixel and the next edge or the end of its own: at least three radii of the blur.
    double clearance_px = 4.0;
    double least_length_px = 6.0;    // of what the clearance leaves
    double least_contrast = 0.1;     // of radiance, in the photograph
    double least_half_width_px = 3;  // the levels at both sides must be seen
    // Edges with clipped pixels too: for an overshoot, which clipping makes smaller. Not for blur.
    bool with_clipped = false;
};

// The edges of a target in one photograph that the selection takes. Only pixels whose ray meets
// `area` are used (compared_area()). `photo_number` is copied into the edges. Throws NumericalError
// when the photograph has another size than the camera or the selection's numbers are not positive
// and finite. About a microsecond a pixel of the bands. Safe from every thread.
std::vector<StraightEdge> target_edges(const LinearPhoto& photo, const Projector& projector,
                                       const CellGrid& grid, const Rigid& camera_from_marker,
                                       const ComparedArea& area,
                                       const EdgeSelection& selection = {}, int photo_number = 0);

}  // namespace etalon
