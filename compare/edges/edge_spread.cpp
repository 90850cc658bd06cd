#include "compare/edges/edge_spread.h"

#include <fmt/format.h>

#include <Eigen/Dense>

#include "core/program/errors.h"
#include "sim/scene/marker_view.h"
#include "sim/sensor/sensor_model.h"

namespace etalon {
namespace {

// How many rows of cells from `row` on in this direction are like it, from `first` to `last`.
int reach(const cv::Mat& cells, int row, int direction, int first, int last) {
    const float value = cells.at<float>(row, first);
    int count = 0;
    for (int r = row; r >= 0 && r < cells.rows; r += direction, ++count)
        for (int along = first; along <= last; ++along)
            if (cells.at<float>(r, along) != value)
                return count;
    return count;
}

// Between the rows of cells before and after the line.
void add_edges_of_line(const cv::Mat& cells, int axis, int line, std::vector<GridEdge>& edges) {
    const auto *before = cells.ptr<float>(line - 1), *after = cells.ptr<float>(line);
    for (int first = 0; first < cells.cols;) {
        int last = first;
        while (last + 1 < cells.cols && before[last + 1] == before[first] &&
               after[last + 1] == after[first])
            ++last;
        if (before[first] != after[first])
            edges.push_back({axis, line, first, last, reach(cells, line - 1, -1, first, last),
                             reach(cells, line, 1, first, last), after[first] > before[first],
                             std::abs(after[first] - before[first])});
        first = last + 1;
    }
}

}  // namespace

std::vector<GridEdge> grid_edges(const CellGrid& grid) {
    std::vector<GridEdge> edges;
    for (const int axis : {0, 1}) {
        const cv::Mat cells = axis == 0 ? cv::Mat(grid.cells.t()) : grid.cells;
        for (int line = 1; line < cells.rows; ++line)
            add_edges_of_line(cells, axis, line, edges);
    }
    return edges;
}

namespace {

// The target's plane as the camera sees it (sim/scene/marker_view.h's h and e).
struct PlaneView {
    PlaneView(const CellGrid& cells, const Rigid& camera_from_marker, Projection projection_)
        : grid(cells), projection(projection_) {
        const Eigen::Matrix3d rotation = camera_from_marker.rotation.toRotationMatrix();
        camera_from_grid.col(0) = grid.cell_mm.x() * rotation.col(0);
        camera_from_grid.col(1) = grid.cell_mm.y() * rotation.col(1);
        camera_from_grid.col(2) = camera_from_marker * grid.point_mm(0.0, 0.0);
        Eigen::Matrix3d sensor_from_grid = camera_from_grid;
        if (projection == Projection::telecentric)
            sensor_from_grid.row(2) << 0.0, 0.0, 1.0;
        grid_from_sensor = sensor_from_grid.inverse();
    }

    Eigen::Vector3d camera_point(double u, double v) const {
        return camera_from_grid * Eigen::Vector3d(u, v, 1.0);
    }
    // StraightEdge's, on the ray through grid coordinates.
    double depth_term(const Eigen::Vector2d& uv) const {
        const double depth = depth_mm({projection}, camera_point(uv.x(), uv.y()));
        return projection == Projection::telecentric ? depth : 1.0 / depth;
    }

    const CellGrid& grid;
    Projection projection;
    Eigen::Matrix3d camera_from_grid, grid_from_sensor;
};

// A grid line in the image: N(x) = 0, linear in the undistorted point.
struct LineInImage {
    LineInImage(const PlaneView& plane, const GridEdge& edge)
        : row((plane.grid_from_sensor.row(edge.axis) - edge.line * plane.grid_from_sensor.row(2))
                  .transpose() *
              (edge.rises ? 1.0 : -1.0)) {}

    // Gradient of N by the pixel.
    std::optional<Eigen::Vector2d> gradient(const Projector& projector,
                                            const Eigen::Vector2d& x) const {
        const auto projected = projector.project_with_jacobian(x.homogeneous());
        if (!projected)
            return {};
        const Eigen::Matrix2d by_point = projected->jacobian.leftCols<2>();
        return by_point.transpose().inverse() * row.head<2>();
    }

    Eigen::Vector3d row;  // positive on the light side
};

// An edge in the photograph, still without its pixels, and the half of its band.
struct EdgeFrame {
    StraightEdge edge;
    Eigen::Vector2d tangent;
    double half_length_px, half_width_px;
};

class EdgeReader {
public:
    EdgeReader(const LinearPhoto& photo, const Projector& projector, const PlaneView& plane,
               const ComparedArea& area, const EdgeSelection& selection)
        : photo_(photo), projector_(projector), plane_(plane), area_(area), selection_(selection) {}

    void read(const GridEdge& edge, int photo_number, std::vector<StraightEdge>& edges) const {
        const LineInImage line(plane_, edge);
        auto frame = frame_of(edge, line);
        if (!frame || frame->half_width_px < selection_.least_half_width_px ||
            2.0 * frame->half_length_px < selection_.least_length_px)
            return;
        StraightEdge& found = frame->edge;
        found.photo = photo_number;
        if (!add_pixels(line, *frame, found) || found.pixels.size() < min_pixels ||
            found.length_px < selection_.least_length_px)
            return;
        const SideLevels levels = side_levels(found);
        if (!(levels.light - levels.dark < selection_.least_contrast))
            edges.push_back(std::move(found));
    }

private:
    static constexpr std::size_t min_pixels = 40;  // several for each of an edge's parameters

    std::optional<EdgeFrame> frame_of(const GridEdge& edge, const LineInImage& line) const {
        const Eigen::Vector2d middle = edge.at(0.5 * (edge.first + edge.last + 1));
        const auto first = pixel_of(edge.at(edge.first));
        const auto last = pixel_of(edge.at(edge.last + 1));
        const auto centre = pixel_of(middle);
        if (!first || !last || !centre)
            return {};
        const auto x = projector_.unproject(*centre);
        const auto gradient = x ? line.gradient(projector_, *x) : std::nullopt;
        if (!gradient)
            return {};
        EdgeFrame frame;
        const Intrinsics& intrinsics = projector_.camera().intrinsics;
        const Eigen::Vector2d normal = gradient->normalized();
        frame.tangent = {-normal.y(), normal.x()};
        frame.edge.centre_px = *centre;
        frame.edge.undistorted = *x;
        frame.edge.normal = normal;
        frame.edge.px_per_unit = px_per_unit(line.row.head<2>(), *x) / gradient->norm();
        frame.edge.px_per_pitch =
            std::hypot(normal.x(), normal.y() * intrinsics.fy / intrinsics.fx);
        frame.edge.noise = photo_.noise;
        frame.edge.clearance_px = selection_.clearance_px;
        const double half = std::min(std::abs((*last - *centre).dot(frame.tangent)),
                                     std::abs((*first - *centre).dot(frame.tangent)));
        frame.half_length_px = half - selection_.clearance_px;
        const double w = plane_.grid_from_sensor.row(2).dot(x->homogeneous());
        const double cell_px = std::abs(w) / gradient->norm();
        frame.half_width_px = std::min(
            selection_.half_width_px,
            std::min(edge.reach_before, edge.reach_after) * cell_px - selection_.clearance_px);
        return frame;
    }

    // How far the line's equation moves per unit of blur, of depths along the frame's axis.
    double px_per_unit(const Eigen::Vector2d& row, const Eigen::Vector2d& x) const {
        if (projector_.camera().projection.is_flat())
            return row.norm();
        const Aperture pupil{.faces_rays = true};
        return (pupil.pupil(x) * row).norm() * x.homogeneous().norm();
    }

    std::optional<Eigen::Vector2d> pixel_of(const Eigen::Vector2d& uv) const {
        return projector_.project(plane_.camera_point(uv.x(), uv.y()));
    }

    bool is_inside(const Eigen::Vector2d& uv) const {
        const Eigen::Vector2d point = plane_.grid.point_mm(uv.x(), uv.y()).head<2>();
        return (point.array() >= area_.low_mm.array()).all() &&
               (point.array() <= area_.high_mm.array()).all();
    }

    // False when one of them is clipped.
    bool add_pixels(const LineInImage& line, const EdgeFrame& frame, StraightEdge& edge) const {
        const cv::Rect band =
            band_pixels(frame.edge.centre_px, frame.edge.normal, frame.half_length_px,
                        frame.half_width_px, cv::Rect({0, 0}, photo_.radiance.size()));
        for (int y = band.y; y < band.br().y; ++y)
            for (int x = band.x; x < band.br().x; ++x) {
                const Eigen::Vector2d from_centre = Eigen::Vector2d(x, y) - frame.edge.centre_px;
                const double along = from_centre.dot(frame.tangent);
                if (std::abs(along) > frame.half_length_px)
                    continue;
                const auto point = projector_.unproject({x, y});
                const auto gradient = point ? line.gradient(projector_, *point) : std::nullopt;
                if (!gradient)
                    continue;
                const double distance = line.row.dot(point->homogeneous()) / gradient->norm();
                const Eigen::Vector2d uv =
                    (plane_.grid_from_sensor * point->homogeneous()).hnormalized();
                if (!(std::abs(distance) <= frame.half_width_px) || !is_inside(uv))
                    continue;
                if (photo_.clipped.at<uchar>(y, x) && !selection_.with_clipped)
                    return false;
                edge.pixels.push_back(
                    {distance, along, photo_.radiance.at<float>(y, x), plane_.depth_term(uv)});
            }
        edge.set_depth();
        if (!edge.pixels.empty()) {
            const auto [first, last] = std::ranges::minmax(edge.pixels, {}, &EdgePixel::along_px);
            edge.length_px = last.along_px - first.along_px;
        }
        return true;
    }

    const LinearPhoto& photo_;
    const Projector& projector_;
    const PlaneView& plane_;
    const ComparedArea& area_;
    const EdgeSelection& selection_;
};

void require_usable(const LinearPhoto& photo, const CameraModel& camera,
                    const EdgeSelection& selection) {
    const cv::Size size = photo.radiance.size();
    if (size != cv::Size(camera.width, camera.height) || photo.clipped.size() != size ||
        photo.radiance.type() != CV_32FC1 || photo.clipped.type() != CV_8UC1)
        throw NumericalError(fmt::format("edges: a photograph of {} x {} px, a camera of {} x {}",
                                         size.width, size.height, camera.width, camera.height));
    for (const double value :
         {selection.half_width_px, selection.clearance_px, selection.least_length_px,
          selection.least_contrast, selection.least_half_width_px})
        if (!(value > 0.0) || !std::isfinite(value))
            throw NumericalError(fmt::format("edges: a selection with {}", value));
}

RadianceNoise noise_of(const CameraModel& camera) {
    constexpr double rounding_variance = 1.0 / 12.0;  // DN^2
    const Sensor sensor = camera.sensor.value_or(Sensor{});
    const double range = (1 << sensor.bits) - 1 - sensor.black_dn;
    if (sensor.gain_e_per_dn <= 0.0)
        return {rounding_variance / (range * range), 0.0, false};
    const double read_dn = sensor.read_noise_e / sensor.gain_e_per_dn;
    return {(read_dn * read_dn + rounding_variance) / (range * range),
            1.0 / (sensor.gain_e_per_dn * range), true};
}

}  // namespace

void StraightEdge::set_depth() {
    double sum = 0.0, squares = 0.0;
    for (const EdgePixel& pixel : pixels) {
        sum += pixel.depth_term;
        squares += pixel.depth_term * pixel.depth_term;
    }
    const double n = std::max(1.0, static_cast<double>(pixels.size()));
    depth_term = sum / n;
    depth_term_variance = std::max(0.0, squares / n - depth_term * depth_term);
}

cv::Rect band_pixels(const Eigen::Vector2d& middle_px, const Eigen::Vector2d& normal,
                     double half_length_px, double half_width_px, const cv::Rect& within) {
    const Eigen::Array2d half =
        half_length_px * normal.reverse().cwiseAbs() + half_width_px * normal.cwiseAbs();
    const Eigen::Array2d first(within.x, within.y), end(within.br().x, within.br().y);
    const auto whole = [&](const Eigen::Array2d& place) -> Eigen::Array2i {
        return place.max(first).min(end).cast<int>();
    };
    const Eigen::Array2i low = whole((middle_px.array() - half).floor()),
                         high = whole((middle_px.array() + half).floor() + 2.0);
    return {cv::Point(low.x(), low.y()), cv::Point(high.x(), high.y())};
}

double reach_px(std::span<const StraightEdge> edges) {
    double reach = 0.0;
    for (const StraightEdge& edge : edges)
        for (const EdgePixel& pixel : edge.pixels)
            reach = std::max(reach, std::abs(pixel.distance_px));
    return reach;
}

SideLevels side_levels(const StraightEdge& edge) {
    const double widest = reach_px({&edge, 1});
    double sum[2] = {}, count[2] = {};
    for (const EdgePixel& pixel : edge.pixels)
        if (std::abs(pixel.distance_px) >= 0.5 * widest) {
            sum[pixel.distance_px > 0.0] += pixel.radiance;
            ++count[pixel.distance_px > 0.0];
        }
    if (count[0] == 0.0 || count[1] == 0.0)
        return {};
    return {sum[0] / count[0], sum[1] / count[1]};
}

LinearPhoto linear_photo(const CodeImage& photo, const CameraModel& camera) {
    LinearPhoto linear;
    linear.radiance = SensorModel(camera).linear_radiance(photo);
    linear.clipped = (photo.pixels == 0) | (photo.pixels >= photo.full_scale());
    linear.noise = noise_of(camera);
    return linear;
}

std::vector<StraightEdge> target_edges(const LinearPhoto& photo, const Projector& projector,
                                       const CellGrid& grid, const Rigid& camera_from_marker,
                                       const ComparedArea& area, const EdgeSelection& selection,
                                       int photo_number) {
    const CameraModel& camera = projector.camera();
    require_usable(photo, camera, selection);
    const PlacedMarker placed{grid, camera_from_marker};
    const Eigen::Quaterniond turn = turn_towards(placed, camera);
    const bool is_flat = camera.projection.is_flat();
    const Projector seen_by = is_flat ? projector : projector.turned(turn);
    const PlaneView plane(grid,
                          is_flat ? camera_from_marker : turned(placed, turn).camera_from_marker,
                          camera.projection.kind);
    const EdgeReader reader(photo, seen_by, plane, area, selection);
    std::vector<StraightEdge> edges;
    for (const GridEdge& edge : grid_edges(grid))
        reader.read(edge, photo_number, edges);
    return edges;
}

}  // namespace etalon
