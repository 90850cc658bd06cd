#include "sim/scene/marker_view.h"

#include <fmt/format.h>

#include <Eigen/LU>

#include "core/program/errors.h"

namespace etalon {
namespace {

// Bounds are widened by this part of their size, far more than rounding can amount to.
constexpr double rounding_margin = 1e-9;

void check_marker(const PlacedMarker& marker) {
    const cv::Mat& cells = marker.grid.cells;
    if (cells.empty() || cells.type() != CV_32FC1)
        throw NumericalError("the marker's cells must be a non-empty CV_32FC1 matrix");
    if (!cv::checkRange(cells))
        throw NumericalError("a cell's radiance is not finite");
    const Rigid& pose = marker.camera_from_marker;
    const Eigen::Vector2d &corner = marker.grid.corner_mm, &cell = marker.grid.cell_mm;
    if (!pose.translation.allFinite() || !(std::abs(pose.rotation.norm() - 1.0) < 1e-6))
        throw NumericalError(fmt::format(
            "not a pose: quaternion of norm {}, translation {}, {}, {} mm", pose.rotation.norm(),
            pose.translation.x(), pose.translation.y(), pose.translation.z()));
    if (!corner.allFinite() || !cell.allFinite() || !(cell.minCoeff() > 0.0))
        throw NumericalError(fmt::format("not a grid: cells of {} x {} mm from ({}, {}) mm",
                                         cell.x(), cell.y(), corner.x(), corner.y()));
}

// The box and everything closer to it than `reach`, rounding included.
Box with_margin(const Box& box, double reach) {
    const Eigen::Vector2d scale = box.low.cwiseAbs().cwiseMax(box.high.cwiseAbs());
    const Eigen::Vector2d margin =
        Eigen::Vector2d::Constant(reach * (1.0 + rounding_margin) + 1e-15) +
        rounding_margin * (box.half() + 1e-4 * scale);
    return {box.low - margin, box.high + margin};
}

bool are_apart(const Box& a, const Box& b) {
    return (a.high.array() < b.low.array()).any() || (a.low.array() > b.high.array()).any();
}

}  // namespace

// The tilted sensor plane is r3 . p = r33 v with r3 the third row of the tilt's rotation. A sensor
// point in the direction (x, 1) lies at the depth v r33 / (r3 . (x, 1)), and 1/z_f = 1/f - 1/depth.
Aperture aperture_of(const CameraModel& camera) {
    Aperture aperture{.projection = camera.projection.of_normalised()};
    if (!camera.lens)
        return aperture;
    const bool has_blur = camera.lens->psf.kind != PointSpread::Kind::measured;
    if (camera.projection.kind == Projection::telecentric) {
        const TelecentricLens lens = telecentric_lens(camera);
        aperture.radius_mm = has_blur ? lens.cone_tangent : 0.0;
        aperture.focus_on_axis = lens.focus_distance_mm;
        return aperture;
    }
    const ThinLens lens = thin_lens(camera);
    aperture.radius_mm = has_blur ? lens.aperture_diameter_mm / 2.0 : 0.0;
    aperture.focus_on_axis = lens.inverse_focus_per_mm;
    aperture.faces_rays = !camera.projection.is_flat();
    if (aperture.faces_rays)
        return aperture;
    const Eigen::Vector3d r3 =
        tilt_matrix(camera.distortion.tau_x, camera.distortion.tau_y).row(2).transpose();
    aperture.focus_slope = -r3.head<2>() / (r3.z() * lens.image_distance_mm);
    return aperture;
}

// The root of I + x x^T stretches by |(x, 1)| along x and by 1 across.
Eigen::Matrix2d Aperture::pupil(const Eigen::Vector2d& x) const {
    Eigen::Matrix2d result = Eigen::Matrix2d::Identity();
    if (faces_rays)
        result += x * x.transpose() / (1.0 + x.homogeneous().norm());
    return result;
}

void check_scene(const Scene& scene) {
    for (const PlacedMarker& marker : scene.markers)
        check_marker(marker);
    if (!std::isfinite(scene.background))
        throw NumericalError(fmt::format("background radiance {}", scene.background));
}

MarkerView::MarkerView(const PlacedMarker& marker, double background, const Aperture& aperture)
    : aperture_(aperture), background_(background) {
    columns_ = marker.grid.columns();
    rows_ = marker.grid.rows();
    const Eigen::Matrix3d rotation = marker.camera_from_marker.rotation.toRotationMatrix();
    camera_from_grid_ << marker.grid.cell_mm.x() * rotation.col(0),
        marker.grid.cell_mm.y() * rotation.col(1),
        marker.camera_from_marker * marker.grid.point_mm(0, 0);
    for (const auto& [u, v] : {std::pair{0, 0}, {columns_, 0}, {0, rows_}, {columns_, rows_}}) {
        const double z = (camera_from_grid_ * Eigen::Vector3d(u, v, 1)).z();
        if (!(z > 0.0))
            throw NumericalError(fmt::format(
                "a corner of the marker lies at depth {:.6g} mm: not in front of the lens", z));
    }
    // How far before the marker's plane the lens is, mm; telecentric: the cosine between the
    // plane's normal and the chief rays.
    const bool is_telecentric = aperture.projection == Projection::telecentric;
    const Eigen::Vector3d normal =
        camera_from_grid_.col(0).cross(camera_from_grid_.col(1)).normalized();
    const double distance = is_telecentric ? normal.z() : normal.dot(camera_from_grid_.col(2));
    if (!(distance > 0.0))
        throw NumericalError(fmt::format(
            "the camera sees the marker's back or its edge ({:.6g} before its plane)", distance));
    sensor_from_grid_ = camera_from_grid_;
    if (is_telecentric)  // its rays keep their X and Y
        sensor_from_grid_.row(2) << 0, 0, 1;
    h_ = sensor_from_grid_.inverse();
    if (is_telecentric) {
        h_.row(2) << 0, 0, 1;  // without rounding: no horizon
        e_ = (camera_from_grid_.row(2) * h_).transpose();
    } else {
        e_ = h_.row(2).transpose();
    }
    outline_.low = outline_.high = sensor_point_of(0, 0);
    for (const auto& [u, v] : {std::pair{columns_, 0}, {0, rows_}, {columns_, rows_}}) {
        outline_.low = outline_.low.cwiseMin(sensor_point_of(u, v));
        outline_.high = outline_.high.cwiseMax(sensor_point_of(u, v));
    }
    bound_blur();
    cells_.assign(static_cast<std::size_t>((columns_ + 2) * (rows_ + 2)), background_);
    for (int j = 0; j < rows_; ++j)
        for (int i = 0; i < columns_; ++i)
            cells_[static_cast<std::size_t>((j + 1) * (columns_ + 2) + i + 1)] =
                marker.grid.cells.at<float>(j, i);
}

// The ray from the sensor point p of a marker's point through l meets the sensor where x = p - l
// (c(p) + focus(p) - focus(x)), so at most |l| |c(p)| / (1 - |l| |g|) away, with the steepest g of
// the focus; where a is the slope of c, focus(x) is continued to p by its own slope, and |g| counts
// twice. How long the pupil is as seen from there is found step by step.
void MarkerView::bound_blur() {
    const double farthest = defocus_of_marker().largest();
    double widest = widest_pupil(outline_);
    for (int step = 0; step < 20; ++step) {
        const double lens = aperture_.radius_mm * widest;
        const double cut = lens * aperture_.steepest_focus() * (aperture_.faces_rays ? 2.0 : 1.0);
        blurred_outline_ =
            with_margin(outline_, cut < 1.0 ? lens * farthest / (1.0 - cut)
                                            : std::numeric_limits<double>::infinity());
        const double there = aperture_.faces_rays ? widest_pupil(blurred_outline_) : widest;
        if (there <= widest)
            break;
        widest = 1.01 * there;
    }
    const double steepest = aperture_.faces_rays ? aperture_.steepest_focus() : 0.0;
    const double cut = (e_.head<2>().norm() + steepest) * aperture_.radius_mm * widest;
    if (!h_.allFinite() || !e_.allFinite() || !(cut < 1.0))
        throw NumericalError(fmt::format(
            "the marker's plane cuts the aperture or the cone of rays (|a| d/2 = {:.6g})", cut));
    lens_reach_ = aperture_.radius_mm / (1.0 - cut);
}

double MarkerView::contrast() const {
    double largest = 0.0;
    for (const double radiance : cells_)
        largest = std::max(largest, std::abs(radiance - background_));
    return largest;
}

// The focus sphere is convex in x, so c is concave: above, its tangent at the centre bounds it; it
// is least at a corner. Affine, both are the same.
DefocusRange MarkerView::defocus_over(const Box& box) const {
    const Eigen::Vector2d centre = box.centre(), half = box.half();
    const double middle = defocus(centre), reach = defocus_slope(centre).cwiseAbs().dot(half);
    if (!aperture_.faces_rays)
        return {middle - reach, middle + reach};
    double least = std::numeric_limits<double>::infinity();
    for (const double x : {-1.0, 1.0})
        for (const double y : {-1.0, 1.0})
            least = std::min(least, defocus(centre + half.cwiseProduct(Eigen::Vector2d(x, y))));
    return {least, middle + reach};
}

// Concave or affine (defocus_over()): least at a corner, and at most what the tangent at the
// marker's middle is at one.
DefocusRange MarkerView::defocus_of_marker() const {
    const Eigen::Vector2d middle = sensor_point_of(0.5 * columns_, 0.5 * rows_);
    const double there = defocus(middle);
    const Eigen::Vector2d slope = defocus_slope(middle);
    DefocusRange c{std::numeric_limits<double>::infinity(),
                   -std::numeric_limits<double>::infinity()};
    for (const auto& [u, v] : {std::pair{0, 0}, {columns_, 0}, {0, rows_}, {columns_, rows_}}) {
        const Eigen::Vector2d corner = sensor_point_of(u, v);
        const double at_corner = defocus(corner);
        c.low = std::min(c.low, at_corner);
        c.high =
            std::max(c.high, aperture_.faces_rays ? there + slope.dot(corner - middle) : at_corner);
    }
    return c;
}

// |P|, of the point of the box that is farthest from the axis.
double MarkerView::widest_pupil(const Box& box) const {
    return aperture_.faces_rays
               ? box.low.cwiseAbs().cwiseMax(box.high.cwiseAbs()).homogeneous().norm()
               : 1.0;
}

double MarkerView::largest_defocus(const Box& box) const {
    return defocus_over(box).largest() * widest_pupil(box);
}

double MarkerView::smallest_defocus(const Box& box) const {
    return defocus_over(box).smallest();
}

Eigen::Vector2d MarkerView::line_gradient(int axis, int index, const Eigen::Vector2d& x,
                                          const Eigen::Vector2d& l) const {
    // offset (1 - a.l) + c m.l with offset and c affine in x, m the line's own gradient.
    const Eigen::Vector3d h = h_.row(axis) - index * h_.row(2);
    const Eigen::Vector2d m = h.head<2>(), seen = aperture_.pupil(x) * l;
    return m * (1.0 - turn(x).dot(seen)) + defocus_slope(x) * m.dot(seen);
}

// The marker's outline is convex between u = 0, u = columns, v = 0 and v = rows, where W > 0.
// Convex shapes are apart if and only if a side parts them. No division; holds across the horizon.
// `centre`, `to_right`, `down`: (U, V, W) at the box's centre and half a box from there.
bool MarkerView::misses_marker(const Box& box, const Eigen::Vector3d& centre,
                               const Eigen::Vector3d& to_right, const Eigen::Vector3d& down) const {
    if (are_apart(box, outline_))
        return true;
    const auto all_negative = [](double at_centre, double by_x, double by_y) {
        return at_centre + std::abs(by_x) + std::abs(by_y) < 0.0;
    };
    const auto beyond = [&](Eigen::Index axis, double size) {
        return all_negative(centre[axis], to_right[axis], down[axis]) ||
               all_negative(size * centre[2] - centre[axis], size * to_right[2] - to_right[axis],
                            size * down[2] - down[axis]);
    };
    return beyond(0, columns_) || beyond(1, rows_);
}

// u and v are quotients of linear functions, extreme at the corners as long as W keeps its sign.
// Where it does not, the range is all cells: a ray with W < 0 has the background's radiance
// (docs/rendering.md, "Geometry"). So also where a window (aperture or box) leaves out lines before
// one that all of it is beyond, or after one that nothing of it is beyond: for such a ray they end
// in the frame.
std::optional<CellRange> MarkerView::footprint(const Box& sensor_box) const {
    if (are_apart(sensor_box, blurred_outline_))
        return std::nullopt;
    // |l c / (1 - a.l)| <= radius |c| / (1 - radius |a|) for every l on the lens.
    const Box box = with_margin(sensor_box, lens_reach_ * largest_defocus(sensor_box));
    const Eigen::Vector2d half = box.half();
    const Eigen::Vector3d centre = h_ * box.centre().homogeneous();
    const Eigen::Vector3d to_right = half.x() * h_.col(0), down = half.y() * h_.col(1);
    if (misses_marker(box, centre, to_right, down))
        return std::nullopt;
    Eigen::Array2d least = Eigen::Array2d::Constant(std::numeric_limits<double>::infinity());
    Eigen::Array2d most = -least;
    for (int corner = 0; corner < 4; ++corner) {
        const double x = corner % 2 == 0 ? -1.0 : 1.0, y = corner / 2 == 0 ? -1.0 : 1.0;
        const Eigen::Vector3d uvw = centre + x * to_right + y * down;
        if (!(uvw.z() > 0.0))
            return CellRange{-1, columns_, -1, rows_};
        const Eigen::Array2d place = uvw.head<2>().array() * (1.0 / uvw.z());
        least = least.min(place);
        most = most.max(place);
    }
    const auto clamped = [](double value, int size) {
        return static_cast<int>(std::clamp(std::floor(value), -1.0, static_cast<double>(size)));
    };
    return narrowed({clamped(least.x(), columns_), clamped(most.x(), columns_),
                     clamped(least.y(), rows_), clamped(most.y(), rows_)},
                    sensor_box);
}

// The lens is round: lines pass beside it within a square around it (docs/rendering.md, "Bounds").
// With m the line's gradient, D + w . l is at least |D| (1 - rho |a|) - rho |c| |m| from zero for
// every l, and |D| on the box at least what it is at the centre less the half sides' parts along m.
CellRange MarkerView::narrowed(const CellRange& range, const Box& box) const {
    CellRange result = range;
    if (range.is_single())
        return result;
    const Eigen::Vector3d centre = h_ * box.centre().homogeneous();
    const Eigen::Vector2d half = with_margin(box, 0.0).half();
    const double reach = lens_reach_ * largest_defocus(box);
    // Positive: every ray passes beyond the line; negative: none does; 0: some may.
    const auto side = [&](int axis, int index) {
        const double mx = h_(axis, 0) - index * h_(2, 0), my = h_(axis, 1) - index * h_(2, 1);
        const double offset = centre[axis] - index * centre[2];
        const double closest = std::abs(offset) - std::abs(mx) * half.x() - std::abs(my) * half.y();
        const bool is_clear =
            closest > 0.0 && closest * closest > reach * reach * (mx * mx + my * my);
        return is_clear ? offset : 0.0;
    };
    const auto leave_out_lines = [&](int axis, int& first, int& last) {
        while (first < last && side(axis, first + 1) > 0.0)
            ++first;
        while (first < last && side(axis, last) < 0.0)
            --last;
    };
    leave_out_lines(0, result.first_column, result.last_column);
    leave_out_lines(1, result.first_row, result.last_row);
    return result;
}

std::optional<double> MarkerView::uniform_radiance(const CellRange& range) const {
    const double first = cell(range.first_column, range.first_row);
    for (int j = range.first_row; j <= range.last_row; ++j)
        for (int i = range.first_column; i <= range.last_column; ++i)
            if (cell(i, j) != first)
                return std::nullopt;
    return first;
}

BlurRange blur_over_marker(const MarkerView& view, const Intrinsics& intrinsics) {
    const DefocusRange c = view.defocus_of_marker();
    const double rho = view.aperture().radius_mm;
    return {rho * c.smallest() * std::min(intrinsics.fx, intrinsics.fy),
            rho * c.largest() * view.widest_pupil(view.outline()) *
                std::max(intrinsics.fx, intrinsics.fy)};
}

namespace {

// The plane passes before all of the lens (telecentric: no ray of the cone runs along it).
bool shows_front(const CameraModel& camera, const Rigid& camera_from_marker) {
    const Eigen::Vector3d inward = camera_from_marker.rotation * Eigen::Vector3d::UnitZ();
    const double radius = camera.lens ? aperture_of(camera).radius_mm : 0.0;
    const double before = camera.projection.kind == Projection::telecentric
                              ? inward.z()
                              : inward.dot(camera_from_marker.translation);
    return before > radius * (camera.projection.is_flat() ? inward.head<2>().norm() : 1.0);
}

}  // namespace

bool is_in_view(const Projector& projector, const CellGrid& grid, const Rigid& camera_from_marker,
                double margin_px) {
    const CameraModel& camera = projector.camera();
    if (!shows_front(camera, camera_from_marker))
        return false;
    const auto is_seen = [&](double u, double v) {
        const auto pixel = projector.project(camera_from_marker * grid.point_mm(u, v));
        return pixel && (pixel->array() >= margin_px).all() &&
               pixel->x() <= camera.width - 1 - margin_px &&
               pixel->y() <= camera.height - 1 - margin_px;
    };
    const double columns = grid.columns(), rows = grid.rows();
    constexpr int parts_of_bent_edge = 8;
    const int parts = images_lines_straight(camera) ? 1 : parts_of_bent_edge;
    for (int part = 0; part < parts; ++part) {  // the corners first: they decide most cases
        const double along = static_cast<double>(part) / parts, back = 1.0 - along;
        if (!is_seen(along * columns, 0.0) || !is_seen(columns, along * rows) ||
            !is_seen(back * columns, rows) || !is_seen(0.0, back * rows))
            return false;
    }
    return true;
}

std::vector<Eigen::Vector2d> marker_outline(const MarkerView& view, const Projector& projector,
                                            int points_per_side) {
    std::vector<Eigen::Vector2d> pixels;
    pixels.reserve(static_cast<std::size_t>(4 * points_per_side));
    for (int n = 0; n < 4 * points_per_side; ++n) {
        const double along = (n % points_per_side) / (points_per_side - 1.0);
        const double s[] = {along, 1.0, 1.0 - along, 0.0};
        const double t[] = {0.0, along, 1.0, 1.0 - along};
        const int side = n / points_per_side;
        const auto pixel = projector.project(
            view.camera_from_grid() *
            Eigen::Vector3d(s[side] * view.columns(), t[side] * view.rows(), 1.0));
        if (!pixel)
            return {};
        pixels.push_back(*pixel);
    }
    return pixels;
}

cv::Rect pixels_around(const std::vector<Eigen::Vector2d>& outline, const Eigen::Array2d& margin,
                       const cv::Rect& limit) {
    if (outline.empty())
        return limit;
    Eigen::Array2d low = outline.front(), high = low;
    for (const Eigen::Vector2d& pixel : outline) {
        low = low.min(pixel.array());
        high = high.max(pixel.array());
    }
    const auto clamped = [](double px) { return static_cast<int>(std::clamp(px, -1e8, 1e8)); };
    low -= margin;
    high += margin;
    return cv::Rect(cv::Point(clamped(low.x()), clamped(low.y())),
                    cv::Point(clamped(high.x()), clamped(high.y()))) &
           limit;
}

}  // namespace etalon
