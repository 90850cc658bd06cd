// A marker as one camera's lens meets it: the map from sensor points and lens points to grid cells,
// and rigorous bounds of what a patch of the sensor can see.
//
// Notation (docs/rendering.md, "Geometry"). A sensor point x is where the chief ray passes:
// undistorted normalised coordinates, (X/Z, Y/Z), or (X, Y) in mm for a telecentric camera. The
// homography from the grid (u, v, 1) to x has the inverse rows h0, h1, h2, and e . (x, 1) over the
// plane is
//     perspective   inverse depth, 1/mm   (e = h2)
//     telecentric   depth, mm             (h2 = (0, 0, 1))
// c = e . (x, 1) - focus, with the focus in the same terms (1/z_f, or z_f), is the defocus. The ray
// through the lens point l meets the plane where the chief ray x + l c / (1 - a . l) does, with
// a = (ex, ey); l is in mm, telecentric the tangents of the ray's angles.
#pragma once

#include "calib/camera/projector.h"
#include "sim/scene/scene.h"

namespace etalon {

// What of the lens matters to the geometry. A flat projection's focus is affine in the sensor
// point (Scheimpflug). A wide lens's pupil faces each ray; its focus is a sphere.
struct Aperture {
    Projection projection = Projection::perspective;
    double radius_mm = 0.0;      // 0: pinhole; telecentric: of the cone of rays 1 mm from its tip
    double focus_on_axis = 0.0;  // 1/z_f, 1/mm; telecentric: z_f, mm
    Eigen::Vector2d focus_slope = Eigen::Vector2d::Zero();  // d focus / dx
    bool faces_rays = false;                                // of a wide lens

    double focus(const Eigen::Vector2d& x) const {
        return faces_rays ? focus_on_axis * x.homogeneous().norm()
                          : focus_on_axis + focus_slope.dot(x);
    }
    Eigen::Vector2d focus_gradient(const Eigen::Vector2d& x) const {
        return faces_rays ? Eigen::Vector2d(focus_on_axis * x / x.homogeneous().norm())
                          : focus_slope;
    }
    // At most |focus_gradient()|.
    double steepest_focus() const { return faces_rays ? focus_on_axis : focus_slope.norm(); }

    // From points of the round pupil to lens points l, as the ray of a sensor point sees it:
    // symmetric, its square I + x x^T; the identity of a flat projection.
    Eigen::Matrix2d pupil(const Eigen::Vector2d& x) const;
};

// A pinhole for a camera without a lens section, and for one whose measured point spread holds all
// its blur. Throws NumericalError as thin_lens() and telecentric_lens() do.
Aperture aperture_of(const CameraModel& camera);

// Throws NumericalError for a number that is not finite, a cell without size, a rotation that is
// not a unit quaternion, and a grid that is empty or not CV_32FC1.
void check_scene(const Scene& scene);

// Axis-parallel box of undistorted sensor points.
struct Box {
    Eigen::Vector2d low, high;

    Eigen::Vector2d centre() const { return 0.5 * (low + high); }
    Eigen::Vector2d half() const { return 0.5 * (high - low); }
};

struct DefocusRange {
    double low, high;

    // Of the magnitude.
    double largest() const { return std::max(std::abs(low), std::abs(high)); }
    double smallest() const { return std::max({0.0, low, -high}); }
};

// Cells by column and row, both ends included; -1 and the grid's size stand for all background on
// that side.
struct CellRange {
    int first_column, last_column, first_row, last_row;

    bool is_single() const { return first_column == last_column && first_row == last_row; }
};

// A grid line on the lens: the ray through the point l of the round pupil sees beyond the line
// where offset + slope . l >= 0.
struct LensLine {
    double offset;
    Eigen::Vector2d slope;  // 1/mm
};

// h0, h1, h2 . (x, 1) of a sensor point (u = uvw[0] / uvw[2] on the chief ray), its c, how it sees
// the pupil, and its a.
struct SensorPoint {
    Eigen::Vector3d uvw;
    double defocus;
    Eigen::Matrix2d pupil;
    Eigen::Vector2d turn;
};

class MarkerView {
public:
    // Throws NumericalError when a corner is not in front of the lens, the back is seen, or the
    // plane cuts the aperture (|a| d/2 >= 1).
    MarkerView(const PlacedMarker& marker, double background, const Aperture& aperture);

    int columns() const { return columns_; }
    int rows() const { return rows_; }
    double background() const { return background_; }
    // Largest difference of a cell from the background.
    double contrast() const;
    const Aperture& aperture() const { return aperture_; }
    const Eigen::Matrix3d& camera_from_grid() const { return camera_from_grid_; }

    // Rows h0, h1, h2, and e.
    const Eigen::Matrix3d& h() const { return h_; }
    const Eigen::Vector3d& depth_row() const { return e_; }
    // d c / d x.
    Eigen::Vector2d defocus_slope(const Eigen::Vector2d& x) const {
        return e_.head<2>() - aperture_.focus_gradient(x);
    }
    // a, in units of 1/l. Where the pupil faces the ray, its disc leans out of the plane Z = 0 and
    // a is the slope of c.
    Eigen::Vector2d turn(const Eigen::Vector2d& x) const {
        return aperture_.faces_rays ? defocus_slope(x) : Eigen::Vector2d(e_.head<2>());
    }

    // The sensor point whose chief ray meets the grid at (u, v).
    Eigen::Vector2d sensor_point_of(double u, double v) const {
        return (sensor_from_grid_ * Eigen::Vector3d(u, v, 1.0)).hnormalized();
    }

    // Radiance of a cell; the background for the indices -1 and columns() or rows().
    double cell(int column, int row) const {
        return cells_[static_cast<std::size_t>((row + 1) * (columns_ + 2) + column + 1)];
    }

    // c at a sensor point; 1/mm, telecentric mm.
    double defocus(const Eigen::Vector2d& x) const {
        return e_.x() * x.x() + e_.y() * x.y() + e_.z() - aperture_.focus(x);
    }

    // How far the chief ray's point moves per mm of the round pupil, |P| |c|: at most in a box, and
    // at least (0 where c changes sign).
    double largest_defocus(const Box& box) const;
    double smallest_defocus(const Box& box) const;

    // Around the marker's sensor points, and around all that see it through some point of the lens.
    const Box& outline() const { return outline_; }
    const Box& blurred_outline() const { return blurred_outline_; }
    // Of c over the marker, at least so wide.
    DefocusRange defocus_of_marker() const;
    // |P|, at most in a box.
    double widest_pupil(const Box& box) const;

    SensorPoint sensor_point(const Eigen::Vector2d& x) const {
        return {h_.leftCols<2>() * x + h_.col(2), defocus(x), aperture_.pupil(x), turn(x)};
    }

    // The line u = index (axis 0) or v = index (axis 1) on the lens, for a sensor point.
    LensLine lens_line(int axis, int index, const SensorPoint& point) const {
        const double offset = point.uvw[axis] - index * point.uvw.z();
        const double mx = h_(axis, 0) - index * h_(2, 0), my = h_(axis, 1) - index * h_(2, 1);
        const Eigen::Vector2d slope(point.defocus * mx - offset * point.turn.x(),
                                    point.defocus * my - offset * point.turn.y());
        return {offset, point.pupil * slope};
    }

    // d/dx of the line's offset + slope . l for a fixed point l of the round pupil: the line is
    // affine in x, of a wide lens to first order in the blur.
    Eigen::Vector2d line_gradient(int axis, int index, const Eigen::Vector2d& x,
                                  const Eigen::Vector2d& l) const;

    // Cells whose lines tell what any ray from the box through the lens meets; nothing: all meet
    // the background. All cells and the frame where the plane's horizon may come between.
    std::optional<CellRange> footprint(const Box& box) const;

    // Such a range for a box within one for which this range holds: lines that the box does not see
    // left out from both ends.
    CellRange narrowed(const CellRange& range, const Box& box) const;

    // The radiance that all cells of the range share, if they do.
    std::optional<double> uniform_radiance(const CellRange& range) const;

private:
    DefocusRange defocus_over(const Box& box) const;
    void bound_blur();
    bool misses_marker(const Box& box, const Eigen::Vector3d& centre,
                       const Eigen::Vector3d& to_right, const Eigen::Vector3d& down) const;

    Aperture aperture_;
    double background_;
    int columns_, rows_;
    std::vector<double> cells_;  // with a frame of background
    Eigen::Matrix3d camera_from_grid_, sensor_from_grid_, h_;
    Eigen::Vector3d e_;
    double lens_reach_;  // farthest that the lens sees from a pinhole's point, by the defocus there
    Box outline_, blurred_outline_;
};

// Blur radii over the marker, px (of x and y the smaller and the larger); smallest is 0 when the
// plane of sharp focus crosses the marker.
struct BlurRange {
    double smallest_px, largest_px;
};
BlurRange blur_over_marker(const MarkerView& view, const Intrinsics& intrinsics);

// True when all of the lens sees all of the marker's front, and the grid's outline keeps
// `margin_px` from the centres of the image's outermost pixels: its corners, with distortion also
// seven points along each edge (one that bulges out by b px may come nearer by b / 64). Throws
// NumericalError when the camera's lens section is of no lens. 0.3 us, with distortion 1.5 us.
bool is_in_view(const Projector& projector, const CellGrid& grid, const Rigid& camera_from_marker,
                double margin_px);

// Pixels along the outline, side after side (upper, right, lower, left) with the same number of
// points on each, its ends included; nothing when some of it has no image.
std::vector<Eigen::Vector2d> marker_outline(const MarkerView& view, const Projector& projector,
                                            int points_per_side);

// The pixels within `margin` (px, x and y) of the outline's bounding box, within `limit`; all of
// that for an empty outline. The margin must hold distortion's bulges too.
cv::Rect pixels_around(const std::vector<Eigen::Vector2d>& outline, const Eigen::Array2d& margin,
                       const cv::Rect& limit);

}  // namespace etalon
